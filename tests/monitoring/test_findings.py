"""How findings end: undone, refined away, put down with the box, explained, acknowledged."""

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from scipy.special import chdtrc

from dtwin.errors import ParameterError
from dtwin.logs.log import Log
from dtwin.monitoring.candidate import Candidate, Conclusion
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.findings import PUT_DOWN, Findings
from dtwin.monitoring.kinds import FaultId, parse_fault_id, plausible_sizes
from dtwin.monitoring.modes import Diagnosing
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.sensing.gripper import GripperWatch
from dtwin.monitoring.signatures import Onset
from dtwin.monitoring.verdict import UNITS, finding, monitored_units, told, verdict_on
from evidence.monitoring.trial import identified_belief


def watched(belief: Belief, log: Log, *stops: int) -> Monitor:
    monitor, seen = Monitor(belief), stream(log)
    seen.feed(monitor, 0, stops[0] if stops else len(seen))
    return monitor


def kinds(monitor: Monitor) -> list[str]:
    return [event.kind for event in monitor.events]


def test_what_no_hypothesis_explains_is_said_once_and_ends_when_the_arm_moves_as_believed(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    monitor = watched(belief, run_cell(80.0, 3, "l2*=1.1@31-36"))
    unknown = [event for event in monitor.events if "unknown of joint 2" in event.text and event.kind == "failed"]
    assert unknown[-1].time < 36.0
    assert [event.kind for event in monitor.events if event.time > unknown[-1].time] == ["recovered"]
    assert monitor.findings.current == {}
    assert {unit.state for unit in monitor.verdict().units.values()} == {"nominal"}


def test_what_no_hypothesis_explains_lasts_as_long_as_it_shows(belief: Belief, run_cell: Callable[..., Log]) -> None:
    monitor = watched(belief, run_cell(45.0, 3, "l2*=1.1@31"))
    assert list(monitor.findings.current) == ["unknown2"]
    assert monitor.findings.current["unknown2"].since == pytest.approx(31.0, abs=0.05)
    assert monitor.events[-1].time < 36.0
    assert kinds(monitor)[-1] == "failed"


@pytest.mark.parametrize(("viscous", "dry", "told"), [(0.055, -0.0104, "D1"), (-0.01, -0.01, "mu1")])
def test_of_the_two_numbers_of_a_friction_the_surer_change_is_told(
    belief: Belief, viscous: float, dry: float, told: str
) -> None:
    sizes, estimator = plausible_sizes(belief.arm), Estimator(belief, Tuning())
    estimator.x[INDEX["mu1"]] = 0.012
    candidate = Candidate(parse_fault_id("friction1"), Onset(10, 1, estimator), sizes)
    for name, change, deviation in (("D1", viscous, 0.006), ("mu1", dry, 0.003)):
        index = INDEX[name]
        candidate.estimator.x[index] += change
        candidate.estimator.P[index, index] += deviation**2
    found = Findings(sizes, GripperWatch()).assess(Conclusion(candidate, 0.93), 0.2)
    assert found.parameter == told
    assert found.size == pytest.approx({"D1": viscous, "mu1": dry}[told])


def test_a_box_takes_what_was_wrong_with_it_along(belief: Belief, run_cell: Callable[..., Log]) -> None:
    log = run_cell(55.0, 3, "payload+=0.05@31")
    monitor = watched(belief, log)
    released = np.flatnonzero(np.diff(log.columns["box_gripped"].astype(int)) < 0) + 1
    (finding,) = monitor.history
    ended = [event.time for event in monitor.events if event.kind == "recovered"]
    assert finding.parameter == "payload"
    assert finding.since == pytest.approx(39.04, abs=0.03)
    assert ended == [pytest.approx(0.01 * released[0.01 * released > finding.since][0], abs=0.02)]
    assert monitor.verdict().units["gripper"].state == "nominal"


def test_a_box_put_down_in_a_gap_takes_it_along_too(belief: Belief, run_cell: Callable[..., Log]) -> None:
    log = run_cell(55.0, 3, "payload+=0.05@31")
    seen = stream(log)
    monitor = watched(belief, log, 4500)
    assert list(monitor.findings.current) == ["payload"]
    assert seen.gripped[4499]
    later = int(np.flatnonzero(~seen.gripped[4500:])[0]) + 4520
    seen.feed(monitor, later, later + 1)
    assert monitor.findings.current == {}
    assert kinds(monitor)[-2:] == ["restart", "recovered"] or kinds(monitor)[-2:] == ["recovered", "restart"]


def test_a_diagnosis_that_a_box_does_not_outlast_ends_at_once(belief: Belief, run_cell: Callable[..., Log]) -> None:
    log = run_cell(55.0, 3, "payload+=0.05@31")
    seen = stream(log)
    monitor = Monitor(belief)
    row = 0
    while [finding.parameter for finding in monitor.standing()] != ["payload"]:
        seen.feed(monitor, row, row + 1)
        row += 1
    findings, mode = monitor.findings, monitor._mode
    assert isinstance(mode, Diagnosing)
    (finding,) = monitor.standing()
    assert finding == mode.pending
    assert not finding.settled
    candidate = mode.diagnosis.best()[0]
    assert findings.put_down(monitor.time) == PUT_DOWN
    assert findings.settle(monitor.time, candidate, finding) == PUT_DOWN._replace(jumped="payload")
    assert kinds(monitor)[-2:] == ["failed", "recovered"]
    assert findings.current == {}
    # What ends within the sample in which it is told is told by the verdicts of a second, with the size that it had.
    (told,) = findings.standing(monitor.time + 0.5, monitor.estimator)
    assert told == msgspec.structs.replace(finding, settled=True)
    assert findings.standing(monitor.time + 1.5, monitor.estimator) == []


def test_a_slip_that_is_settled_once_the_box_is_gone_stands_until_the_next_one(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    """Else it would end within the sample in which it is told, and no verdict would say it."""
    seen, monitor, row = stream(run_cell(40.0, 3, "slip@29")), Monitor(belief), 0
    while [finding.parameter for finding in monitor.standing()] != ["slip"]:
        seen.feed(monitor, row, row + 1)
        row += 1
    findings, mode = monitor.findings, monitor._mode
    assert isinstance(mode, Diagnosing)
    findings.put_down(monitor.time)
    after = findings.settle(monitor.time, mode.diagnosis.best()[0], monitor.standing()[0])
    assert after == PUT_DOWN._replace(jumped="slip")
    assert [*findings.current] == ["slip"]
    findings.pick_up(monitor.time + 5.0)
    assert findings.current == {}


def test_a_motor_without_voltage_is_no_weak_one_besides(belief: Belief, run_cell: Callable[..., Log]) -> None:
    """The jump of the constant to nothing and the loss of the voltage are one cause, which is settled at once."""
    seen, monitor = stream(run_cell(30.0, 3, "cut2@16.5")), Monitor(belief)
    seen.feed(monitor, 0, 1655)
    row, causes = 1655, []
    while not monitor.history:
        if isinstance(monitor._mode, Diagnosing):
            causes.append([str(candidate.isolated) for candidate, _ in monitor._mode.diagnosis.ranked()])
        seen.feed(monitor, row, row + 1)
        row += 1
    assert causes
    assert all("K2" not in told for told in causes[-5:])
    (found,) = monitor.history
    assert (found.parameter, found.others) == ("cut2", ())
    assert found.confidence > 0.999
    assert row < 1700


def test_the_change_of_a_box_hardly_weighed_is_as_uncertain_as_it_says(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    """The faults come 90 ms after a grip; the squared errors are those that the deviations tell."""
    squares = []
    for seed in (3, 4, 5, 6, 7):
        grips = 0.01 * np.flatnonzero(np.diff(run_cell(45.0, seed).columns["box_gripped"].astype(int)) > 0)
        grip = float(grips[grips > 25.0][0])
        log = run_cell(grip + 1.4, seed, f"payload+=0.05@{grip + 0.09:.2f}")
        monitor = watched(belief, log)
        (finding,) = monitor.standing()
        assert finding.parameter == "payload"
        assert monitor.estimator.deviation("payload") < finding.deviation < 0.005
        squares.append(((finding.size - 0.05) / finding.deviation) ** 2)
    assert chdtrc(len(squares), sum(squares)) > 0.01


def test_an_acknowledged_change_is_the_arm_from_then_on(belief: Belief, run_cell: Callable[..., Log]) -> None:
    log = run_cell(60.0, 3, "K1*=0.6@31-45")
    seen = stream(log)
    monitor = watched(belief, log, 4400)
    assert monitor.verdict().units["joint 1"].state == "failed"
    assert monitor.acknowledge("K1") == ["K1"]
    assert kinds(monitor)[-1] == "acknowledged"
    assert monitor.verdict().units["joint 1"].state == "nominal"
    seen.feed(monitor, 4400, 4500)
    assert monitor.findings.current == {}
    seen.feed(monitor, 4500, len(seen))
    (finding,) = monitor.standing()
    assert finding.parameter == "K1"
    assert finding.size == pytest.approx(0.4, abs=0.02)
    assert finding.since == pytest.approx(45.0, abs=0.1)


@pytest.mark.parametrize("parameter", ["", "K1"])
def test_a_change_that_is_acknowledged_while_it_is_diagnosed_is_the_arm_once_it_is_settled(
    belief: Belief, run_cell: Callable[..., Log], parameter: str
) -> None:
    log = run_cell(60.0, 3, "K1*=0.6@31-45")
    seen = stream(log)
    monitor, row = watched(belief, log, 3100), 3100
    while not monitor.standing():
        seen.feed(monitor, row, row + 1)
        row += 1
    assert monitor.verdict().units["joint 1"].state == "failed"
    assert monitor.findings.current == {}
    with pytest.raises(ParameterError, match=r"'D2': expected K1$"):
        monitor.acknowledge("D2")
    monitor.acknowledge(parameter)
    for later in range(row, 4490):
        seen.feed(monitor, later, later + 1)
        assert monitor.verdict().units["joint 1"].state == "nominal"
    assert kinds(monitor)[-3:] == ["suspected", "failed", "acknowledged"]
    seen.feed(monitor, 4490, len(seen))
    (finding,) = monitor.standing()
    assert finding.size == pytest.approx(0.4, abs=0.02)


def test_an_acknowledged_encoder_is_reported_again_once_it_has_worked(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    log = run_cell(50.0, 3, "freeze2@31-34", "freeze2@40-42")
    seen = stream(log)
    monitor = watched(belief, log, 3200)
    assert monitor.acknowledge() == ["freeze2"]
    seen.feed(monitor, 3200, 3390)
    assert monitor.findings.current == {}
    seen.feed(monitor, 3390, len(seen))
    assert kinds(monitor) == ["failed", "acknowledged", "failed", "recovered"]


def test_only_what_is_wrong_can_be_acknowledged(belief: Belief, run_cell: Callable[..., Log]) -> None:
    monitor = watched(belief, run_cell(), 1000)
    assert monitor.acknowledge() == []
    with pytest.raises(ParameterError, match="nothing to acknowledge"):
        monitor.acknowledge("K1")
    monitor = watched(belief, run_cell(45.0, 3, "K1*=0.6@31-38"), 3500)
    with pytest.raises(ParameterError, match=r"'D2': expected K1$"):
        monitor.acknowledge("D2")


def test_an_acknowledged_trend_counts_from_now(belief: Belief) -> None:
    monitor = Monitor(belief)
    healthy = belief.arm.get("K1")
    for k in range(360):
        monitor.estimator.x[6] = healthy * (0.95 - 0.2 * k / 360)
        monitor.trend.enter(10.0 * k, monitor.estimator)
    assert monitor.verdict().units["joint 1"].state == "failed"
    assert monitor.acknowledge() == ["K1"]
    assert monitor.verdict().units["joint 1"].state == "nominal"
    for k in range(360, 720):
        monitor.trend.enter(10.0 * k, monitor.estimator)
    assert monitor.trend.forecasts() == []


@pytest.mark.parametrize(
    ("faults", "names"),
    [
        (("late@31",), ["late"]),
        (("supply*=0.8@31",), ["supply"]),
        (("bias1+=0.01@32", "K3*=0.7@32"), ["K3", "bias1"]),
    ],
)
def test_what_befalls_several_joints_is_named(
    faults: tuple[str, ...], names: list[str], belief: Belief, run_cell: Callable[..., Log]
) -> None:
    monitor = watched(belief, run_cell(36.0, 3, *faults))
    assert sorted(found.parameter for found in monitor.history) == names
    assert all(0.0 < found.detected - float(faults[0].partition("@")[2]) < 0.5 for found in monitor.history)
    failed = {unit for unit, state in monitor.verdict().units.items() if state.state == "failed"}
    assert failed == ({"joint 1", "joint 3"} if len(names) == 2 else {"joint 1", "joint 2", "joint 3"})


def test_commands_that_come_in_time_again_end_the_finding(belief: Belief, run_cell: Callable[..., Log]) -> None:
    monitor = watched(belief, run_cell(50.0, 3, "late@31-38"))
    assert [found.parameter for found in monitor.history] == ["late"]
    assert monitor.findings.current == {}


@pytest.mark.parametrize("push", ["push2+=0.3@31.5-31.6", "push2+=0.12@31.5-31.57", "push2+=-0.5@31.5-31.52"])
def test_a_push_is_told_and_nothing_is_wrong_afterwards(
    push: str, belief: Belief, run_cell: Callable[..., Log]
) -> None:
    monitor = watched(belief, run_cell(50.0, 3, push))
    assert [found.parameter for found in monitor.history] == ["push2"]
    assert kinds(monitor) == ["suspected", "push"]
    assert monitor.findings.current == {}
    assert {unit.state for unit in monitor.verdict().units.values()} == {"nominal"}


def test_a_slow_drift_that_is_hardly_known_when_it_is_confirmed_becomes_a_finding(
    run_cell: Callable[..., Log],
) -> None:
    """It is not taken for a property of the arm, and the estimator goes on to learn it."""
    monitor = watched(identified_belief(0.01, "uniform", 1), run_cell(75.0, 4, "drift3+=-0.0006@31", noise=0.01))
    told = [(event.kind, event.time) for event in monitor.events if "encoder drift of joint 3" in event.text]
    dismissed = [time for kind, time in told if kind == "dismissed"]
    (failed,) = (time for kind, time in told if kind == "failed")
    assert dismissed[0] < failed
    assert failed < dismissed[0] + 60.0
    assert monitor.findings.current["drift3"].size == pytest.approx(-0.0006, abs=4e-4)


@pytest.mark.parametrize(
    ("found", "told"),
    [
        ("grip slip", "grip"),
        ("slip grip", "grip"),
        ("freeze2 K2", "freeze2"),
        ("K2 mu2", "mu2"),
        ("cut2 bias2", "cut2"),
    ],
)
def test_what_an_encoder_itself_tells_is_not_hidden_by_what_follows_from_it(found: str, told: str) -> None:
    """Nobody would stop a gripper that does not follow for a box that was lost because of that."""
    faults = [finding(parse_fault_id(name), 1.0 + k, 1.0 + k) for k, name in enumerate(found.split())]
    units = monitored_units(dict.fromkeys(UNITS, "failed"), faults)
    assert [unit.parameter for unit in units.values() if unit.parameter] == [told]


def test_a_verdict_tells_all_that_is_wrong_though_a_unit_tells_the_gravest_alone() -> None:
    found = [finding(parse_fault_id(name), 1.0, 2.0) for name in ("mu2", "late", "freeze2", "K1")]
    told = verdict_on(3.0, None, (), found, {}, (), 0, 0)
    assert [each.parameter for each in told.findings] == ["freeze2", "K1", "late", "mu2"]
    assert [told.units[unit].parameter for unit in UNITS[:3]] == ["K1", "freeze2", "late"]
    assert all(each.state == "failed" for each in told.findings)


@pytest.mark.parametrize("others", [(), ("lock1", "cut1")])
def test_confidence_and_time_are_read_from_the_line_that_tells_them(others: tuple[str, ...]) -> None:
    line = finding(FaultId("push", 1), 20.04, 20.5, confidence=0.33, others=others).text()
    assert told(line) == (0.33, 20.04)
    confidence, since = told("the model does not fit this arm")
    assert confidence == 0.0
    assert math.isnan(since)
