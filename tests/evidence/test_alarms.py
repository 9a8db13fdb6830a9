"""The scorecard of the watched machines: what counts."""

import msgspec
import pytest

from dtwin.cli import main
from dtwin.emulation.faults import parse_fault
from dtwin.monitoring.kinds import NAMED, parse_fault_id
from dtwin.monitoring.offline import stream
from dtwin.parameters import ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.settings import CellSettings
from evidence.monitoring.alarms import alarms_report, calibration, false_alarms, good
from evidence.monitoring.baselines import METHODS, Method, baseline
from evidence.monitoring.watching import SCENARIOS, Noticed, Outcome, WatchedMachine


def names_of(number: int) -> list[str]:
    """Findings that name all faults of a scenario right."""
    targets = [change.partition("*")[0].partition("+")[0] for change in SCENARIOS[number].changes]
    return [NAMED.get(target, target) for target in targets]


LATER: dict[Method, Noticed] = {"momentum observer": Noticed(2.1, 0), "CUSUM": Noticed(None, 1)}
RIGHT = [Outcome(number, 30.0, [], 1.0, names_of(number), [], 0.999, LATER) for number in range(len(SCENARIOS))]
FINE = WatchedMachine(7, "identified", "", 0.2, [], RIGHT, {"momentum observer": 2, "CUSUM": 0}, ["misfit"])


def changed(**values: object) -> WatchedMachine:
    """A machine whose first outcome differs."""
    return msgspec.structs.replace(FINE, outcomes=[msgspec.structs.replace(RIGHT[0], **values), *RIGHT[1:]])


def test_the_faults_of_a_scenario_are_their_own_names() -> None:
    assert all(outcome.right and not outcome.wrong for outcome in RIGHT)
    assert {parse_fault_id(name).kind for outcome in RIGHT for name in outcome.named} >= {"late", "supply", "push"}


def test_viscous_and_dry_friction_are_one_cause_and_unknown_is_not_wrong() -> None:
    (damping,) = [number for number, scenario in enumerate(SCENARIOS) if scenario.changes == ("D1*=2",)]
    assert Outcome(damping, 30.0, [], 1.0, ["mu1"], [], 1.0, LATER).right
    for name, wrong in (("D2", True), ("unknown1", False)):
        outcome = Outcome(damping, 30.0, [], 1.0, [name], [], 1.0, LATER)
        assert (outcome.right, outcome.wrong) == (False, wrong)


def test_of_two_faults_both_have_to_be_named() -> None:
    (both,) = [number for number, scenario in enumerate(SCENARIOS) if len(scenario.changes) == 2]
    assert Outcome(both, 30.0, [], 1.0, ["D3", "K2"], [], 1.0, LATER).right
    for names in (["K2"], ["K2", "D1", "D3"], ["K1", "D3"]):
        assert not Outcome(both, 30.0, [], 1.0, names, [], 1.0, LATER).right


def test_what_counts_against_the_monitor() -> None:
    assert good([FINE])
    assert not good([])
    for one in (
        msgspec.structs.replace(FINE, alarms=["voltage constant of joint 1"]),
        msgspec.structs.replace(FINE, remark="the log is of no use"),
        *(msgspec.structs.replace(FINE, foreign=foreign) for foreign in ([], ["failed"], ["misfit", "failed"])),
        changed(early=["misfit"]),
        changed(after=2.5),
        changed(after=None, named=[]),
        changed(named=["K1"], confidence=0.96),
    ):
        assert not good([one])
    assert good([changed(named=["K1"], confidence=0.9)])


def test_a_baseline_may_not_notice_more_of_any_fault() -> None:
    quicker: dict[Method, Noticed] = {**LATER, "CUSUM": Noticed(0.5, 0)}
    one, late = changed(others=quicker), changed(others=quicker, after=2.5)
    assert good([FINE, one])
    assert good([*[FINE] * 30, late])
    assert not good([*[one] * 30, late])


def test_baselines_notice_a_push_that_a_healthy_arm_never_feels() -> None:
    control = ControlOptions().control()
    healthy = Cell(CellSettings(60.0, 1, 0.002, control=control))
    pushed = Cell(CellSettings(31.0, 2, 0.002, control=control, faults=(parse_fault("push2+=3@30-30.2"),)))
    for cell in (healthy, pushed):
        cell.run()
    for method in METHODS:
        found = baseline(method, ArmParameters(), stream(healthy.log.freeze()))
        assert not len(found.alarms(stream(healthy.log.freeze())))
        first, *_ = found.alarms(stream(pushed.log.freeze()))
        assert 30.0 < first < 30.3, method


def test_the_report_counts_every_fault_and_false_alarm() -> None:
    one = changed(after=None, named=["K1"], early=["friction of joint 1"])
    one = msgspec.structs.replace(one, number=9, foreign=["failed"])
    text = str(alarms_report([FINE, one], 600.0))
    assert "1 of 2 healthy ones were said not to be commissioned" in text
    assert "not so: 10 with the record of 9" in text
    assert false_alarms([FINE, one]) == 1
    assert "1 false alarms in 0.40 h, 1800 a month" in text
    assert "1 of 2" in text
    assert "K2 1, K1 1" in text
    assert f"On the same data 4 by momentum observer and {2 * len(SCENARIOS)} by CUSUM." in text
    assert all(f"`{scenario.name}`" in text for scenario in SCENARIOS)


def test_a_confidence_of_nine_tenths_is_right_nine_times_of_ten() -> None:
    told = [Outcome(0, 30.0, [], 1.0, ["K2"], [], 0.9, LATER)] * 9 + [
        Outcome(0, 30.0, [], 1.0, ["K1"], [], 0.9, LATER)
    ]
    classes, error = calibration(told)
    assert classes == [(pytest.approx(0.9), pytest.approx(0.9), 10)]
    assert error == pytest.approx(0.0, abs=1e-9)
    _, error = calibration([msgspec.structs.replace(outcome, confidence=1.0) for outcome in told])
    assert error == pytest.approx(0.1)


def test_machines_that_the_method_was_tuned_on_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(("experiment", "alarms", "--first", "500")) == 2
    assert "expected machines that nobody tuned to, got 501" in capsys.readouterr().err
