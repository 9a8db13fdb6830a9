"""How an arm becomes known: a stretch whose first half does not foretell its second is made longer, or refused."""

from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Array
from dtwin.cli import main
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.errors import RecordingError
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.learning import acquainted, passed
from dtwin.monitoring.chain.monitor import ArmMonitor
from dtwin.monitoring.chain.record import read_arm_record, record_of, write_arm_record
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, run
from dtwin.services.chain import check

LATE_WRIST = ArmCell(arm="six-axis", machine="2413").settings(46.0, 13)
"""The wrist of this arm begins to turn after 10 s: what it needs is not known before."""
PLANAR = ArmCell(arm="planar-2r", machine="2302").settings(42.0, 2302)


def rows_of(ran: ChainRun) -> tuple[Array, Array, Array, Array]:
    return ran.t, ran.q, ran.target, ran.effort


def fed(monitor: ArmMonitor, rows: tuple[Array, Array, Array, Array], size: int = 200) -> ArmMonitor:
    for first in range(0, len(rows[0]), size):
        t, q, target, effort = (row[first : first + size] for row in rows)
        monitor.follow(t, q, target, effort)
    return monitor


def test_a_monitor_learns_for_longer_where_half_of_the_stretch_does_not_foretell_the_rest() -> None:
    """The words are those with which a log is refused; with what it learns then it tells nothing false."""
    ran = run(LATE_WRIST)
    with pytest.raises(RecordingError, match="expected at least 30 s") as refused:
        acquainted(LATE_WRIST.arm, ran.samples, 20.0)
    words = str(refused.value).partition("; expected")[0]
    assert words.startswith("the first 20 s do not suffice to know the arm: who knows half of them would tell 10.1")
    monitor = ArmMonitor(LATE_WRIST.arm, 20.0)
    fed(monitor, rows_of(run(replace(LATE_WRIST, duration=30.0))))
    unit = monitor.verdict().units["joint 1"]
    assert (unit.state, unit.text) == (
        "not commissioned",
        f"the arm is learned from its motion until 40 s, as {words}",
    )
    for size in (len(ran.t), 20):
        monitor = fed(ArmMonitor(LATE_WRIST.arm, 20.0), rows_of(ran), size)
        assert [(event.kind, event.text) for event in monitor.events] == [
            ("misfit", f"{words}; it is learned for longer"),
            ("fits", "the healthy arm is known from its motion"),
        ]
        assert monitor.history == []
        assert monitor.healthy == 40.0
    whole = passed(LATE_WRIST.arm, ran.samples, 20.0)
    assert whole.until == 40.0
    assert whole.watch is not None
    assert whole.watch.finding is None


def test_a_stretch_that_never_suffices_is_begun_anew() -> None:
    """The torque grows all the time: 20, 40 and 80 s do not suffice, and the next stretch begins at 80 s."""
    settings = replace(PLANAR, duration=90.0)
    ran = run(settings)
    grown = ran.effort * np.exp(ran.t / 20.0)[:, None]
    monitor = fed(ArmMonitor(settings.arm, 20.0), (ran.t, ran.q, ran.target, grown))
    assert monitor.learned is False
    assert [event.kind for event in monitor.events] == ["misfit"] * 3
    assert "until 100 s" in monitor.verdict().units["tool"].text


def test_what_the_blocks_count_on_while_an_arm_is_learned_is_taken_off() -> None:
    ran = run(PLANAR)
    monitor = ArmMonitor(PLANAR.arm, 30.0)
    monitor.adjust(Adjustment((0.2, 0.0), (1.0, 0.5), (1.0, 1.0), 0.0))
    fed(monitor, (ran.t, ran.q + np.array([0.2, 0.0]), ran.target, ran.effort * [1.0, 2.0]))
    assert monitor.learned
    assert monitor.finding is None


@pytest.mark.parametrize("fault", ["", "K1*=0.8@34"])
def test_a_monitor_that_knows_the_record_finds_from_the_first_sample_on_what_one_finds_that_has_learned(
    fault: str, tmp_path: Path
) -> None:
    ran = run(replace(PLANAR, faults=(parse_chain_fault(fault, 2),) if fault else ()))
    known = round(30.0 / PLANAR.arm.period)
    record = record_of(acquainted(PLANAR.arm, ran.samples.rows(slice(known)), 29.9), PLANAR.arm, 29.9)
    write_arm_record(record, tmp_path / "arm.json")
    watch = read_arm_record(tmp_path / "arm.json", PLANAR.arm).watch(PLANAR.arm)
    assert watch.learned
    watch.follow(ran.t[known:], ran.q[known:], ran.target[known:], ran.effort[known:])
    watch.end()
    told = acquainted(PLANAR.arm, ran.samples, 29.9).finding
    if not fault:
        assert told is watch.finding is None
        return
    assert isinstance(watch.finding, ChainFinding)
    assert isinstance(told, ChainFinding)
    assert (watch.finding.cause, told.cause) == ("K1", "K1")
    assert watch.finding.time == pytest.approx(told.time, abs=0.1)
    assert watch.finding.size == pytest.approx(told.size, abs=0.02)


def test_intervals_of_what_is_recorded_hold_what_the_machine_has() -> None:
    """Friction and rotors of an arm whose drives are the data sheet's, so that torques are known."""
    settings = ArmCell(arm="planar-2r", machine="nominal").settings(60.0, 5)
    ran = run(settings)
    watch = acquainted(settings.arm, ran.samples, 59.0)
    record = record_of(watch, settings.arm, 59.0)
    deviations = np.sqrt(np.diag(np.array(record.covariance)))[22:26]
    truth = [joint.friction.viscous for joint in settings.arm.joints]
    assert np.all(np.abs(np.array(record.values)[22:24] - truth) < 3.0 * deviations[:2] + 0.05 * np.array(truth))
    assert np.all(deviations > 0.0)


def test_commission_keeps_a_record_that_monitor_and_up_take(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, later, out = (str(tmp_path / name) for name in ("run.parquet", "later.parquet", "arm.json"))
    arm = ("--arm", "planar-2r")
    words = ("--machine", "2302", "--seed")
    assert main(["run", *arm, *words, "2302", "--duration", "40", "--log", log]) == 0
    assert main(["run", *arm, *words, "7", "--duration", "12", "--fault", "K1*=0.7@6", "--log", later]) == 0
    capsys.readouterr()
    assert main(["commission", log, *arm, "--out", out]) == 0
    said = capsys.readouterr().out
    assert "arm planar-2r: 39.99 s, whose first half foretells the second one" in said
    assert "shoulder" in said
    assert main(["monitor", later, *arm, "--commissioned", out]) == 1
    said = capsys.readouterr().out
    assert "learned in 39.99 s, judged until 11.99 s" in said
    assert "drive of shoulder: part of its torque lost, about " in said
    assert abs(float(said.split()[-1]) - 0.3) < 0.05
    assert main(["monitor", log, *arm, "--commissioned", out]) == 0, "its own start is none of its faults"
    capsys.readouterr()
    assert main(["monitor", later, "--arm", "six-axis", "--commissioned", out]) == 2
    assert (
        "arm.json: the record is of planar-2r with the joints shoulder, elbow every 0.01 s" in capsys.readouterr().err
    )
    assert check.main("check", check.Options, ["--kind", "planar-2r", "--machine", "7", "--commissioned", out]) == 0
    assert check.main("check", check.Options, ["--kind", "six-axis", "--machine", "7", "--commissioned", out]) != 0


def test_what_is_no_record_and_logs_that_are_too_short_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, arm, bad = str(tmp_path / "run.parquet"), ("--arm", "planar-2r"), tmp_path / "bad.json"
    assert main(["run", *arm, "--duration", "12", "--log", log]) == 0
    capsys.readouterr()
    assert main(["commission", log, *arm]) == 2
    assert "expected a healthy stretch of at least 20 s, got 11.985 s" in capsys.readouterr().err
    assert main(["commission", log, *arm, "--motion", "200"]) == 2
    assert "--motion: has no meaning for another arm than the thesis's" in capsys.readouterr().err
    assert main(["commission", *arm]) == 2
    assert "expected a log" in capsys.readouterr().err
    bad.write_bytes(msgspec.json.encode({"schema": "other"}))
    assert main(["monitor", log, *arm, "--commissioned", str(bad)]) == 2
    assert "bad.json: expected a file that dtwin commission LOG --arm ARM --out FILE.json wrote" in (
        capsys.readouterr().err
    )


def test_an_arm_that_was_learned_for_a_short_time_needs_more_evidence() -> None:
    """Poses that 20 s do not show alike told a stronger drive of wrist_1; a drive that grows weak is still told."""
    cell = ArmCell(arm="six-axis", machine="5700")
    working = cell.settings(40.0, 5700)
    healthy = passed(working.arm, run(working).samples, 20.0)
    assert healthy.until == 20.0
    assert healthy.watch is not None
    assert healthy.watch.finding is None
    settings = replace(cell.settings(34.0, 5700), faults=(parse_chain_fault("K2*=0.8@30", 6),))
    watch = passed(settings.arm, run(settings).samples, 20.0).watch
    assert watch is not None
    assert watch.finding is not None
    assert watch.finding.cause == "K2"


def test_a_record_of_less_than_a_minute_asks_for_more_evidence_at_first() -> None:
    ran = run(replace(PLANAR, faults=(parse_chain_fault("K1*=0.88@34", 2),)))
    known, times = round(30.0 / PLANAR.arm.period), []
    learned = acquainted(PLANAR.arm, ran.samples.rows(slice(known)), 29.9)
    for seconds in (30.0, 61.0):
        watch = record_of(learned, PLANAR.arm, seconds).watch(PLANAR.arm)
        watch.follow(ran.t[known:], ran.q[known:], ran.target[known:], ran.effort[known:])
        watch.end()
        assert watch.finding is not None
        assert watch.finding.cause == "K1"
        times.append(watch.finding.time)
    assert 34.0 < times[1] < times[0]
