import numpy as np
import pytest

from dtwin.emulation.machine.files import machine_of
from dtwin.errors import ParameterError
from dtwin.identification.estimation.problem import Problem
from dtwin.identification.excitation.plan import HELD_OUT, PLAIN, Excitation, Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PayloadModel
from tests.support.identification import ARM, blocks, clean, measured


@pytest.mark.parametrize("signal", [PLAIN, HELD_OUT, Excitation((-1.0, 8.0, 0.0), 1, (7, 0, 60))])
def test_the_blocks_play_what_was_planned(signal: Excitation) -> None:
    experiment = measured(signal=signal, samples=120)
    assert np.array_equal(experiment.volts, signal.volts(120))


@pytest.mark.parametrize("model", ["weight", "point"])
@pytest.mark.parametrize("payload", [0.0, 0.2])
def test_emulation_and_twin_agree(model: PayloadModel, payload: float) -> None:
    experiment = measured(payload=payload, model=model)
    problem = Problem((experiment,), (), ARM, offsets=False)
    assert np.abs(problem.simulate(problem.start())[0] - experiment.measured).max() < 1e-9


def test_the_load_matters_and_an_empty_gripper_stays_empty() -> None:
    assert np.abs(measured(excess_payload=0.01).measured - clean().measured).max() > 0.01
    empty = measured(payload=0.0)
    assert np.array_equal(measured(payload=0.0, excess_payload=0.01).measured, empty.measured)


def test_runs_repeat() -> None:
    plan, rig = Plan(samples=50), Rig(noise=0.01)
    first, second = (rig.measure(plan, blocks(), np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.measured, second.measured)


def test_an_experiment_on_a_machine_is_one_on_the_arm_that_it_is() -> None:
    plan = Plan(samples=120)
    weak = Rig(machine=machine_of("weak-motor")).measure(plan, blocks(), np.random.default_rng(5))
    same = Rig(ARM.with_values({"K2": 0.9 * ARM.get("K2")})).measure(plan, blocks(), np.random.default_rng(5))
    assert np.abs(weak.measured - same.measured).max() < 1e-9
    coarse = Rig(machine=machine_of("encoders-12-bit")).measure(plan, blocks(), np.random.default_rng(5))
    steps = coarse.measured / (2 * np.pi / 2**12)
    assert np.abs(steps - np.round(steps)).max() < 1e-9


def test_signal_is_checked() -> None:
    with pytest.raises(ParameterError, match="amplitude of joint 2: expected at most 8 V, got 9"):
        Excitation((1.0, 9.0, 1.0))
    with pytest.raises(ParameterError, match="unit: expected at least 1 tick, got 0"):
        Excitation(unit=0)
    with pytest.raises(ParameterError, match="delay: expected at least 0 ticks, got -1"):
        Excitation(delay=(0, -1, 0))
