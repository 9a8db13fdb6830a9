"""A motion in one compiled call is the motion that is stepped from Python, to the bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtwin.controller.runtime import chosen
from dtwin.controller.settings import ControlSettings
from dtwin.errors import DivergenceError
from dtwin.parameters import PICKUP, ArmParameters
from dtwin.simulation.whatif import MotionCase, Simulator
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


def test_both_runtimes_diverge_at_the_same_time(simulators: tuple[Simulator, Simulator]) -> None:
    wild = replace(CASE, arm=ArmParameters().with_values({"D1": 1e6}), settings=ControlSettings())
    messages = []
    for simulator in simulators:
        with pytest.raises(DivergenceError) as caught:
            simulator.run(wild)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
