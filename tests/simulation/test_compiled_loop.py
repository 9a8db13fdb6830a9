"""A motion in one compiled call is the motion that is stepped from Python, to the bit."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from dtwin.controller.runtime import chosen
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DivergenceError
from dtwin.parameters import PICKUP, ArmParameters
from dtwin.simulation.whatif import MotionCase, Simulator
from dtwin.twin.lanes import WIDTH
from tests.support.iec61499.c_harness import needs_compiler

pytestmark = needs_compiler
CASE = MotionCase("red", ControlSettings(1.0), PICKUP.theta, payload=0.2, duration=1.2)
CASES = (
    CASE,
    replace(CASE, noise=0.001),
    replace(CASE, noise=0.002, noise_kind="gaussian", seed=3, omega=(0.1, 0.2, -0.3)),
    replace(CASE, goal=(2.0, -1.0, 0.5), payload=0.0, payload_model="weight", carries=True),
    replace(CASE, settings=ControlSettings(0.8, law="cascade"), arm=ArmParameters().with_values({"mu1": 0.01})),
)
WILD = replace(CASE, arm=ArmParameters().with_values({"D1": 1e6}), settings=ControlSettings())


@pytest.fixture(scope="module")
def simulators() -> tuple[Simulator, Simulator]:
    with chosen("native"):
        native = Simulator()
    with chosen("python"):
        return native, Simulator()


@pytest.mark.parametrize("case", CASES)
def test_both_runtimes_simulate_the_same_motion(simulators: tuple[Simulator, Simulator], case: MotionCase) -> None:
    native, python = (simulator.run(case) for simulator in simulators)
    for name in ("states", "measured", "path", "volts"):
        assert np.array_equal(getattr(native, name), getattr(python, name)), name
    assert native.figures == python.figures
    assert native.target == python.target


def test_motions_side_by_side_are_those_by_themselves(simulators: tuple[Simulator, Simulator]) -> None:
    native, _ = simulators
    cases = [*CASES, *(replace(CASE, payload=0.01 * k) for k in range(WIDTH)), replace(CASE, duration=1.0)]
    for simulator in simulators:
        for case, outcome in zip(cases, simulator.run_all(cases), strict=True):
            alone = native.run(case)
            assert outcome.case is case
            assert outcome.target == alone.target
            assert outcome.figures == alone.figures
            for name in ("states", "measured", "path", "volts"):
                assert getattr(outcome, name).tobytes() == getattr(alone, name).tobytes(), name


def test_motions_before_one_that_diverges_are_given(simulators: tuple[Simulator, Simulator]) -> None:
    native, _ = simulators
    alone = native.run(CASE)
    with pytest.raises(DivergenceError) as caught:
        native.run(WILD)
    outcomes = native.run_all([CASE, replace(WILD, duration=CASE.duration), CASE])
    assert next(outcomes).states.tobytes() == alone.states.tobytes()
    with pytest.raises(DivergenceError, match=re.escape(str(caught.value))):
        next(outcomes)


def test_both_runtimes_diverge_at_the_same_time(simulators: tuple[Simulator, Simulator]) -> None:
    messages = []
    for simulator in simulators:
        with pytest.raises(DivergenceError) as caught:
            simulator.run(WILD)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
