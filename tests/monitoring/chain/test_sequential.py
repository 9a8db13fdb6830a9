"""The first fault of an arm in its own log: noticed soon, named, and nothing where nothing is."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from dtwin.cli import main
from dtwin.emulation.chain.faults import parse_chain_fault
from dtwin.errors import FaultError, RecordingError
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.learning import acquainted
from dtwin.monitoring.chain.monitor import SHOWN, ArmMonitor
from dtwin.monitoring.chain.sequential import FirstFault
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainRun, ChainSettings, run

HEALTHY = 30.0
BEGIN = 38.0
SETTINGS: ChainSettings = ArmCell(arm="planar-2r", machine="2302").settings(BEGIN + 6.0, 2302)


@cache
def weakened() -> ChainRun:
    """A run whose first drive loses a fifth of its torque."""
    return run(replace(SETTINGS, faults=(parse_chain_fault("K1*=0.8@38", 2),)))


def found(*faults: str) -> ChainFinding | None:
    parsed = tuple(parse_chain_fault(fault, 2) for fault in faults)
    ran = run(replace(SETTINGS, faults=parsed))
    return acquainted(SETTINGS.arm, ran.samples, HEALTHY).finding


def test_nothing_is_found_in_a_healthy_log() -> None:
    assert found() is None


@pytest.mark.parametrize(
    ("fault", "cause"),
    [
        ("K1*=0.8@38", "K1"),
        ("friction2*=2@38", "friction2"),
        ("load+=0.1@38", "load"),
        ("bias1+=0.01@38", "bias1"),
        ("freeze2@38", "freeze2"),
        ("lock1@38", "lock1"),
        ("push1+=4@38-38.5", "push1"),
    ],
)
def test_a_fault_is_noticed_soon_and_its_cause_is_among_those_that_are_told(fault: str, cause: str) -> None:
    told = found(fault)
    assert told is not None
    assert 0.0 <= told.time - BEGIN <= 3.0
    assert cause in (told.cause, *told.others)


def test_a_monitor_that_takes_samples_as_they_come_finds_what_is_found_in_the_whole_log() -> None:
    ran = weakened()
    told = acquainted(SETTINGS.arm, ran.samples, HEALTHY).finding
    monitor = ArmMonitor(SETTINGS.arm, HEALTHY)
    states = []
    for first in range(0, len(ran.t), 17):
        part = slice(first, first + 17)
        monitor.follow(ran.t[part], ran.q[part], ran.target[part], ran.effort[part])
        states.append(monitor.verdict().units["joint 1"].state)
    assert told is not None
    assert monitor.finding is not None
    assert (monitor.finding.time, monitor.finding.cause) == (told.time, told.cause)
    assert monitor.finding.size == pytest.approx(told.size, rel=1e-9)
    assert list(dict.fromkeys(states)) == ["not commissioned", "nominal", "may be degrading", "failed"]
    monitor.acknowledge()
    assert monitor.verdict().units["joint 1"].state == "not commissioned"
    assert [event.kind for event in monitor.events] == ["fits", "suspected", "failed", "acknowledged"]


@cache
def noticed(lost: bool, size: int) -> ChainFinding | None:
    """What is found in the weakened run if so many samples come together, and some are lost before."""
    ran = weakened()
    rows = ran.t, ran.q, ran.target, ran.effort
    known, begin = round(HEALTHY / SETTINGS.arm.period), round(37.0 / SETTINGS.arm.period)
    watch = FirstFault(SETTINGS.arm, HEALTHY)
    watch.follow(*(row[: known + 1] for row in rows))
    if lost:
        watch.forget()
    for first in range(begin if lost else known + 1, len(ran.t), size):
        watch.follow(*(row[first : first + size] for row in rows))
    return watch.finding


@pytest.mark.parametrize("together", [1, 5, 11])
@pytest.mark.parametrize("lost", [False, True])
def test_it_does_not_matter_how_many_samples_come_together(together: int, lost: bool) -> None:
    """The filter takes as many as it needs, and not one more."""
    few, many = noticed(lost, together), noticed(lost, len(weakened().t))
    assert few is not None
    assert many is not None
    assert (few.cause, few.time, few.size) == (many.cause, many.time, pytest.approx(many.size))


def test_a_monitor_goes_on_after_a_push_and_after_samples_that_are_missing() -> None:
    ran = run(replace(SETTINGS, duration=BEGIN + 12.0, faults=(parse_chain_fault("push2+=2@38-38.5", 2),)))
    monitor = ArmMonitor(SETTINGS.arm, HEALTHY)
    for part in (slice(0, 3500), slice(3520, 4200), slice(4200, 5000)):
        if part.start == 3520:
            monitor.miss(20)
        for first in range(part.start, part.stop, 20):
            rows = slice(first, min(first + 20, part.stop))
            monitor.follow(ran.t[rows], ran.q[rows], ran.target[rows], ran.effort[rows])
    assert monitor.missed == 20
    assert [found.cause for found in monitor.history] == ["push2"]
    assert monitor.history[0].time - BEGIN < 2.0
    assert monitor.time > monitor.history[0].time + SHOWN
    assert {unit.state for unit in monitor.verdict().units.values()} == {"nominal"}


def test_a_log_that_ends_with_what_is_learned_is_refused() -> None:
    ran = run(replace(SETTINGS, duration=HEALTHY))
    with pytest.raises(RecordingError, match="expected a log of more than 30 s, in which the arm is learned, got"):
        acquainted(SETTINGS.arm, ran.samples, HEALTHY)


def test_the_command_tells_the_fault_of_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(tmp_path / "run.parquet")
    arm = ("--arm", "planar-2r")
    assert (
        main(
            [
                "run",
                *arm,
                "--machine",
                "2302",
                "--seed",
                "2302",
                "--duration",
                "44",
                "--log",
                log,
                "--fault",
                "K1*=0.8@38",
            ]
        )
        == 0
    )
    capsys.readouterr()
    assert main(["monitor", log, *arm, "--healthy", "30"]) == 1
    assert "drive of shoulder: part of its torque lost, about 0." in capsys.readouterr().out
    assert main(["monitor", log, *arm, "--healthy", "1"]) == 2
    assert "--healthy: expected at least 20 s, got 1" in capsys.readouterr().err
    assert main(["monitor", log, *arm, "--method", "thesis"]) == 2
    assert "--method: has no meaning here" in capsys.readouterr().err


def test_a_healthy_stretch_too_short_for_the_work_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The wrist of this arm begins to turn after half of that time: what it needs is not known before."""
    log, arm = str(tmp_path / "run.parquet"), ("--arm", "six-axis")
    assert main(["run", *arm, "--machine", "2413", "--seed", "13", "--duration", "34", "--log", log]) == 0
    capsys.readouterr()
    assert main(["monitor", log, *arm, "--healthy", "20"]) == 2
    said = capsys.readouterr().err
    assert "the first 20 s do not suffice to know the arm: who knows half of them would tell 10.10 s: push on" in said
    assert "expected at least 30 s, without a fault and with all of the arm's work (--healthy)" in said
    assert said.count("\n") == 1
    assert main(["monitor", log, *arm, "--healthy", "30"]) == 0
    assert "nothing is wrong" in capsys.readouterr().out


def test_what_no_encoder_can_be_off_by_is_not_told_as_what_would_have_been_seen() -> None:
    settings = ArmCell(arm="six-axis", machine="nominal").settings(28.0, 3)
    ran = run(settings)
    hidden = acquainted(settings.arm, ran.samples, 25.0).hidden()
    assert hidden["bias6"] == np.inf
    assert 0.0 < hidden["bias5"] < 1.0


@pytest.mark.parametrize(
    "fault", ["K2*=0.8@30", "friction1*=2@30", "load+=0.5@30", "freeze2@30-31", "push2+=20@30-30.3"]
)
def test_a_fault_reads_as_it_was_written(fault: str) -> None:
    assert str(parse_chain_fault(fault, 2)) == fault


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("K3*=0.8@30", "expected a joint from 1 to 2, got 3"),
        ("mass2*=2@30", "got none of K, friction"),
        ("K2+=0.8@30", "expected the form of"),
        ("load2+=1@30", "expected the form of"),
        ("K2*=nan@30", "expected a finite value"),
        ("lock1@30-20", "an end after the start"),
        ("K2*=x@30", "expected numbers"),
        ("K2*=0.8", "expected K2*=0.8@30"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(fault: str, said: str) -> None:
    with pytest.raises(FaultError) as error:
        parse_chain_fault(fault, 2)
    assert said in str(error.value)


def test_faults_act_on_the_arm_alone_in_their_time() -> None:
    """Without them the run is what it was, bit by bit, and so is it until they begin."""
    plain = run(replace(SETTINGS, duration=4.0))
    late = run(replace(SETTINGS, duration=4.0, faults=(parse_chain_fault("bias2+=0.01@2-3", 2),)))
    before = plain.t < 2.0 - 1e-9
    np.testing.assert_array_equal(plain.q[before], late.q[before])
    first = int(np.argmin(before))
    assert late.q[first, 1] - plain.q[first, 1] == pytest.approx(0.01)


def test_what_an_arm_could_not_have_shown_is_told_with_the_size_from_which_on_it_would() -> None:
    """In motion nothing of what is asked for is hidden; an arm that stands shows nothing."""
    ran = run(SETTINGS)
    monitor = ArmMonitor(SETTINGS.arm, HEALTHY)
    assert monitor.verdict().unobservable == ()
    monitor.follow(ran.t, ran.q, ran.target, ran.effort)
    assert monitor.verdict().unobservable == ()
    count = round(10.0 / SETTINGS.arm.period)
    t = ran.t[-1] + SETTINGS.arm.period * np.arange(1, count + 1)
    still = [np.tile(rows[-1], (count, 1)) for rows in (ran.q, ran.target, ran.effort)]
    monitor.follow(t, *still)
    told = monitor.verdict().unobservable
    assert "drive of elbow: part of its torque lost" in told
    assert "encoder of elbow reads too much without a jump" in told
    assert "another load at the tool (kg)" in told


@pytest.mark.parametrize("cause", ["K", "friction"])
def test_the_size_that_is_told_is_the_one_from_which_on_a_fault_is_noticed(cause: str) -> None:
    watch = FirstFault(SETTINGS.arm, HEALTHY)
    healthy = run(replace(SETTINGS, duration=BEGIN))
    watch.follow(healthy.t, healthy.q, healthy.target, healthy.effort)
    assert watch.hidden() == {}
    assert watch.drives is not None
    size = watch.drives.visible()[f"{cause}2"]
    sign = -1.0 if cause == "K" else 1.0
    noticed = [found(f"{cause}2*={1.0 + sign * part * size:g}@38") is not None for part in (0.2, 1.5)]
    assert noticed == [False, True]
