"""`dtwin monitor` and the monitoring experiments on the command line."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from dtwin.campaign.spread import Workforce
from dtwin.cli import main
from dtwin.emulation.machine.sections import Machine, Structure
from dtwin.logs.log import Log
from evidence.monitoring.scorecard import Scorecard, faults_experiment, label, summary
from evidence.monitoring.scorecard_report import faults_report
from evidence.monitoring.trial import FaultOutcome, FaultTrial, run_trial, true_cause


@pytest.fixture(scope="module")
def faulty(run_cell: Callable[..., Log], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "faulty.parquet"
    run_cell(25.0, 3, "K1*=0.6@12.5").write_parquet(path)
    return path


@pytest.fixture(scope="module")
def collapsed(run_cell: Callable[..., Log], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("logs") / "collapsed.parquet"
    run_cell(25.0, 3, "K2*=0.1@12.5").write_parquet(path)
    return path


def run(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    status = main(arguments)
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_a_faulty_log_is_reported_and_fails(faulty: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(["monitor", str(faulty)], capsys)
    assert status == 1
    assert "joint 1   failed" in out
    assert re.search(r"s  monitor_failed +voltage constant of joint 1", out)
    assert (
        "finding   voltage constant of joint 1, -40." in out or "finding   voltage constant of joint 1, -39." in out
    )


@pytest.mark.parametrize("method", ["default", "thesis"])
def test_json_says_the_same_to_programs(method: str, collapsed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = run(["monitor", str(collapsed), "--method", method, "--json"], capsys)
    report = json.loads(out)
    assert status == 1
    assert report["method"] == method
    assert set(report["verdict"]["states"]) == {"joint 1", "joint 2", "joint 3", "gripper"}
    assert "failed" in report["verdict"]["states"].values()
    assert report["findings"]
    assert report["real_time_factor"] > 1.0
    # the name that the event has on the bus
    assert "monitor_failed" in {event["kind"] for event in report["events"]}
    if method == "default":
        assert report["verdict"]["states"]["joint 2"] == "failed"
        assert report["findings"][0]["cause"] == "voltage constant"
        assert report["findings"][0]["size"] == pytest.approx(-0.9, abs=0.09)


def test_a_healthy_log_passes(
    run_cell: Callable[..., Log], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "healthy.parquet"
    run_cell().write_parquet(path)
    status, out, _ = run(["monitor", str(path)], capsys)
    assert status == 0
    assert "failed" not in out


def test_a_recording_shows_what_the_monitor_made_of_it(
    faulty: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "monitor.rrd"
    run(["monitor", str(faulty), "--record", str(path), "--json"], capsys)
    content = path.read_bytes()
    for entity in (
        b"/monitor/angles/joint_1/predicted",
        b"/monitor/residuals/joint_3",
        b"/monitor/evidence/statistic",
    ):
        assert entity in content
    for entity in (b"/monitor/verdicts/joint_1", b"/monitor/findings"):
        assert entity in content


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (["monitor", "nowhere.parquet"], "nowhere.parquet"),
        (["monitor", "LOG", "--model", "nobody"], "no model 'nobody'"),
        (["monitor", "LOG", "--alarms-per-hour", "0"], "--alarms-per-hour: expected a number above 0"),
        (["monitor", "LOG", "--method", "thesis", "--step", "0.003"], "step"),
        (["monitor", "LOG", "--method", "thesis", "--record", "x.rrd"], "--record"),
        (["monitor", "LOG", "--commissioned", "none.json"], "none.json: No such file"),
        (["monitor", "LOG", "--commissioned", "a.json", "--model", "b.json"], "--commissioned: expected no --model"),
        (["monitor", "LOG", "--commissioned", "a.json", "--method", "thesis"], "the default method"),
        (["experiment", "alarms", "--machines", "0"], "--machines"),
        (["experiment", "alarms", "--duration", "60"], "--duration"),
        (["experiment", "faults", "--fault", "K9*=2"], "unknown fault target"),
        (["experiment", "faults", "--runs", "0"], "--runs"),
        (["experiment", "faults", "--hours", "-1"], "--hours"),
        (["experiment", "failure", "--runs", "0"], "--runs"),
        (["experiment", "stop", "--runs", "0"], "--runs"),
        *(
            ([*command, "--machine", "oops"], "machine 'oops': expected a file")
            for command in (
                ["identify"],
                ["demo", "recovery"],
                *(["experiment", name] for name in ("faults", "failure", "stop", "sampling")),
                *(["experiment", name] for name in ("noise", "mass", "friction", "accuracy", "upload", "soak")),
            )
        ),
        (["experiment", "stop", "--seed", "-1"], "--seed"),
        (["experiment", "stop", "--workers", "0"], "--workers"),
        (["experiment", "stop", "--out", "/dev/null/page"], "/dev/null"),
        (["experiment", "soak", "chaos", "9"], "expected no amount"),
        (["experiment", "stop", "--fault", "K9*=2"], "unknown fault target"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    arguments: list[str],
    match: str,
    faulty: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run([str(faulty) if a == "LOG" else a for a in arguments], capsys)
    assert status == 2
    assert out == ""
    assert match in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def outcome(fault: str, cause: str, joint: int, **values: Any) -> FaultOutcome:
    defaults = {"latency_s": 0.1, "motion_latency_s": 0.1, "size": -0.19, "size_true": -0.2, "deviation": 0.004}
    merged = {"detected": True, **defaults, **values}
    return FaultOutcome(
        seed=0,
        fault=fault,
        method="default",
        moving=True,
        cause=cause,
        joint=joint,
        confidence=1.0,
        named=(cause, joint) == true_cause(fault),
        false_alarms=0,
        hours=0.01,
        **merged,
    )


def test_a_line_of_the_scorecard_counts_what_was_missed() -> None:
    missed = {"latency_s": None, "motion_latency_s": None, "detected": False, "size": None}
    line = summary(
        "K2*=0.8",
        [
            outcome("K2*=0.8", "voltage constant", 2),
            outcome("K2*=0.8", "friction", 2, motion_latency_s=3.0, latency_s=5.0),
            outcome("K2*=0.8", "", 0, **missed),
            outcome("K2*=0.8", "voltage constant", 2, size=-0.2),
        ],
    )
    assert (line.runs, line.detected, line.in_motion, line.named) == (4, 0.75, 0.5, 0.5)
    assert line.latency_median == 0.1
    assert math.isinf(line.latency_95)
    assert line.size_worst == pytest.approx(0.05)
    assert line.covered == 0.5
    card = Scorecard((outcome("slip", "payload differs", 0), outcome("lock3", "locked joint", 3)), ())
    assert card.confusion() == {("gripper slip", "payload differs"): 1, ("locked joint 3", "locked joint 3"): 1}
    assert label("", 0) == "not named"


def test_equal_trials_have_equal_outcomes() -> None:
    trial = FaultTrial(3, "bias1+=0.02", noise=0.002, start=12.0)
    assert run_trial(trial) == run_trial(trial)


def test_a_fault_is_found_on_a_machine_that_was_identified() -> None:
    heavier = Machine("heavier", structure=Structure(inertia=(1.1, 1.1, 1.1), com=(1.01, 1.01, 1.01)))
    seen = run_trial(FaultTrial(3, "K2*=0.5", noise=0.002, start=12.5, machine=heavier))
    assert (seen.detected, seen.cause, seen.joint) == (True, *true_cause("K2*=0.5"))
    assert seen != run_trial(FaultTrial(3, "K2*=0.5", noise=0.002, start=12.5))


def test_the_thesis_monitor_watches_the_same_trials() -> None:
    seen = run_trial(FaultTrial(3, "K2*=0.1", "thesis", noise=0.003, start=12.5, patience=12.0, motion=math.inf))
    assert seen.detected
    assert seen.latency_s is not None
    assert 4.5 < seen.latency_s < 12.0
    assert not seen.named


def test_a_scorecard_is_written_as_a_page_with_a_chart(tmp_path: Path) -> None:
    card = faults_experiment(seeds=1, hours=0.01, faults=("cut1", "bias2+=0.02"), workforce=Workforce(1))
    assert card.false_alarms == 0
    assert card.hours > 0.01
    report = faults_report(card)
    text = report.text
    assert max(map(len, re.findall(r"^\|.*\|$", text, re.M))) <= 80
    assert "| `cut1` | 1 | 100 % |" in text
    assert "| encoder bias 2 | 1 | 1 |  |" in text
    assert "0 false alarms" in text
    assert report.write(tmp_path / "out", "").read_text().count("<svg") == 1
