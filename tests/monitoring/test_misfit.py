"""A model that does not fit the arm: said once, and no fault of the arm is named for it."""

from collections.abc import Callable

import numpy as np
import pytest

from dtwin.emulation.machine.files import machine_of
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import Belief, assumed
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.modes import PROVEN, Probation, Turn, Turns
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings

MISFIT = "not commissioned"


def watched(machine: str, duration: float = 40.0) -> Monitor:
    """A monitor with the data sheet's model, after some seconds of a machine's normal work."""
    cell = Cell(CellSettings(duration, seed=5, noise=0.0, machine=machine_of(machine)))
    cell.run()
    seen = stream(cell.log.freeze())
    monitor = Monitor(assumed(ArmParameters(), (0.0, 0.0, 0.0)))
    seen.feed(monitor, 0, len(seen))
    return monitor


@pytest.mark.parametrize(
    "machine",
    [
        "delay",
        "elastic",
        "17",
        *(pytest.param(name, marks=pytest.mark.thorough) for name in ("lag", "servo", "stribeck")),
    ],
)
def test_an_arm_that_is_not_the_models_is_told_once(machine: str) -> None:
    monitor = watched(machine)
    assert [event.kind for event in monitor.events if event.kind != "spike"] == ["misfit"]
    assert monitor.history == monitor.standing() == []
    assert {unit.state for unit in monitor.verdict().units.values()} == {MISFIT}
    assert any("identify the arm" in event.text for event in monitor.events)


def test_encoders_that_are_quieter_than_those_that_were_known_are_not_called_stopped() -> None:
    """At rest they repeat readings that noisier ones would not: what is known is that of another arm."""
    cell = Cell(CellSettings(40.0, seed=5, machine=machine_of("9402")))
    cell.run()
    seen = stream(cell.log.freeze())
    monitor = Monitor(assumed(ArmParameters(), (5e-4, 5e-4, 5e-4)))
    seen.feed(monitor, 0, len(seen))
    assert [event.kind for event in monitor.events] == ["misfit"]
    assert monitor.history == []


def test_other_links_are_not_called_faults(run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell(40.0, 5, *(f"l{joint}*=1.02@0" for joint in (1, 2, 3))))
    monitor = Monitor(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)))
    seen.feed(monitor, 0, len(seen))
    assert [event.kind for event in monitor.events] == ["misfit"]


def test_a_model_that_explains_the_motion_later_fits_after_all(belief: Belief, run_cell: Callable[..., Log]) -> None:
    """The arm is pushed aside in the first seconds, and healthy from then on."""
    seen = stream(run_cell(100.0, 3, "K1*=0.6@2-9"))
    monitor = Monitor(belief)
    seen.feed(monitor, 0, len(seen))
    assert [event.kind for event in monitor.events] == ["misfit", "fits"]
    assert {unit.state for unit in monitor.verdict().units.values()} == {"nominal"}


def test_an_arm_that_rests_is_not_taken_for_an_encoder_that_has_stopped(run_cell: Callable[..., Log]) -> None:
    """An encoder without noise repeats itself at rest, where a model that does not fit expects the arm to fall."""
    weak, without = "K3*=0.5@3.9", assumed(ArmParameters(), (0.0, 0.0, 0.0))
    for faults, told in (((weak,), []), ((weak, "freeze1@20"), ["freeze1"])):
        seen = stream(run_cell(24.0, 0, *faults, noise=0.0))
        monitor = Monitor(without)
        seen.feed(monitor, 0, len(seen))
        assert next(event.kind for event in monitor.events if event.kind not in ("spike", "burst")) == "misfit"
        assert [found.parameter for found in monitor.history] == told


def test_the_same_change_after_some_motion_is_a_fault(belief: Belief, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell(45.0, 3, "K1*=0.6@31"))
    monitor = Monitor(belief)
    seen.feed(monitor, 0, len(seen))
    assert [found.parameter for found in monitor.history] == ["K1"]


def test_the_joints_that_are_off_are_named(belief: Belief) -> None:
    probation, estimator = Probation(), Monitor(belief).estimator
    estimator.variance[:], estimator.x[3] = 1e-6, 1.0
    used = np.array([True, True, False])
    for k in range(PROVEN):
        assert not probation.passed
        estimator.innovation[:] = np.array([1e-3, 7e-3 if k == 3 else 0.0, 1.0])
        probation.update(estimator, used, counts=k > 0)
    assert probation.passed
    assert list(probation.misfit()) == [2]
    assert "joint 2 is up to 7.0 standard deviations" in probation.misfit()[2]


def test_frozen_encoders_of_an_arm_that_is_not_the_models_are_not_told() -> None:
    """Where a wrong model says that a joint moves, an encoder that repeats itself need not have stopped."""
    monitor = watched("17", 15.0)
    sample = monitor.sample
    for k in range(1, 300):
        monitor.update(sample + k, np.array([0.1, 0.2, 0.3]), np.full(4, 4.0), False)
    assert [event.kind for event in monitor.events if event.kind not in ("spike", "restart")] == ["misfit"]
    assert monitor.time == pytest.approx((sample + 299) * PERIOD)


@pytest.mark.parametrize(
    ("named", "every", "astray"),
    [
        (["payload", "supply", "mu3"], 500, 0),
        (["payload", "supply", "mu3"], 1000, None),
        (["K2 D3", "D3", "K2"], 300, None),
        (["supply", "K2 D3", "mu3"], 300, None),
        (["payload", "slip", "payload", "supply"], 300, None),
        (["", "", "K1", "", "D2"], 300, None),
        (["D1", "K1", "K1", "mu1", "bias2"], 300, 0),
        (["K1"] * 3, 1500, None),
        (["K1", "K1", "mu1"], 1400, 0),
        (["payload", "K1", "K1 D2", "K1"], 800, 800),
        (["bias1"] * 5, 120, 0),
        (["bias1"] * 5, 200, None),
    ],
)
def test_diagnoses_of_many_matters_or_of_one_again_and_again_show_that_none_was_right(
    named: list[str], every: int, astray: int | None, belief: Belief
) -> None:
    turns, estimator, found = Turns(), Estimator(belief, Tuning()), None
    for k, names in enumerate(named):
        faults = tuple(map(parse_fault_id, names.split()))
        turns.enter(Turn(k * every, k * every * PERIOD, estimator, {}, faults))
        found = turns.astray(k * every) or found
    assert (None if found is None else found.sample) == astray
