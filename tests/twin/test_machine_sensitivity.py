"""The derivative of the motion of an arm with effects against motions that start a little apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, ArmParameters, JointVector
from dtwin.twin.effects import Effects
from dtwin.twin.machine import EXTRA_NAMES, MACHINE_NAMES, SUBSTEP, Array, integrate_machine, vector_of
from dtwin.twin.machine_sensitivity import linearise_machine
from tests.support.examples import examples

STEPS = np.array([1e-5] * 6 + [1e-4] * 4)
TORQUE = MACHINE_NAMES.index("torque1")
EXTRA = MACHINE_NAMES.index(EXTRA_NAMES[0])
ROUNDING = 1e-6
"""What rounding and the end of the search for velocities that friction leaves make of a difference quotient."""


@dataclass(frozen=True, slots=True)
class Begun:
    """A machine at the start of the last of some samples."""

    vector: Array
    volts: Array
    payload: float
    acting: Array
    state: Array


def carried(begun: Begun, number: int = 0, step: float = 0.0) -> tuple[Array, Array]:
    """The state after the sample and the voltages that act then, where a number of the start is a step further."""
    p, acting, masses, states = begun.vector.copy(), begun.acting.copy(), np.full(5, begun.payload), np.empty((2, 6))
    states[0] = begun.state
    if number < 6:
        states[0, number] += step
    elif number < 9:
        p[TORQUE + number - 6] += step
    else:
        masses[:] += step
    integrate_machine(p, begun.volts, masses, PERIOD, SUBSTEP, 4, acting, states)
    return states[1], acting


def linearised(begun: Begun, columns: int = 10) -> tuple[Array, Array, Array]:
    state, acting, slopes = begun.state.copy(), begun.acting.copy(), np.empty((6, columns))
    linearise_machine(begun.vector, begun.volts, begun.payload, acting, state, slopes)
    return state, acting, slopes


def check(begun: Begun) -> Array:
    """The derivatives, which are those of motions by themselves, but for what a smaller step changes."""
    state, acting, slopes = linearised(begun)
    end, last = carried(begun)
    np.testing.assert_array_equal(acting, last)
    np.testing.assert_allclose(state, end, rtol=1e-12, atol=1e-12)
    for number, step in enumerate(STEPS):
        coarse, fine = (
            (carried(begun, number, each)[0] - carried(begun, number, -each)[0]) / (2.0 * each)
            for each in (step, 0.5 * step)
        )
        allowed = 3.0 * np.abs(coarse - fine).max() + 1e-6 * np.abs(fine).max() + ROUNDING
        np.testing.assert_allclose(slopes[:, number], fine, rtol=0.0, atol=allowed)
    return slopes


def triples(least: float, most: float) -> st.SearchStrategy[JointVector]:
    numbers = st.floats(least, most)
    return st.just((0.0, 0.0, 0.0)) | st.tuples(numbers, numbers, numbers)


SPEEDS = st.sampled_from((0.0, 1e-6, 1e-4, 1e-2, 0.1, 1.0, 5.0))
EFFECTS = st.builds(
    Effects,
    rotor_inertia=triples(0.0, 2e-3),
    lag=triples(0.0, 0.008),
    dead_zone=triples(0.0, 0.3),
    stiction=triples(0.0, 0.005),
    stribeck_velocity=st.just((0.1, 0.1, 0.1)) | st.tuples(*[st.floats(0.1, 0.3)] * 3),
    cable=triples(0.0, 0.01),
    torque=triples(-0.02, 0.02),
    com_offset=triples(-0.003, 0.003),
    ripple_sin=triples(-0.005, 0.005),
    ripple_cos=triples(-0.005, 0.005),
    tilt=st.just(0.0) | st.floats(-0.02, 0.02),
    delay=st.sampled_from((0.0, PERIOD, 2.0 * PERIOD)) | st.floats(0.0, 3.0 * PERIOD),
    sag=st.just(0.0) | st.floats(0.0, 0.1),
)


@st.composite
def starts(draw: st.DrawFn) -> Begun:
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    vector = vector_of(ArmParameters(coulomb=draw(triples(0.0, 0.05))), draw(EFFECTS))
    if draw(st.booleans()):
        vector[EXTRA:] = random.normal(0.0, 1e-3, len(EXTRA_NAMES))
    speeds = random.normal(size=3) * draw(st.tuples(SPEEDS, SPEEDS, SPEEDS))
    volts = random.normal(size=(5, 3)) * draw(st.sampled_from((0.0, 0.1, 1.0, VOLTAGE_LIMIT, 20.0)))
    acting = np.full(3, np.nan) if draw(st.booleans()) else random.normal(0.0, 2.0, 3)
    angles = np.array(draw(st.tuples(*[st.floats(-3.0, 3.0)] * 3)))
    return Begun(vector, volts, draw(st.floats(0.0, 0.3)), acting, np.concatenate((angles, speeds)))


@examples(200, deadline=None)
@given(starts())
def test_derivatives_are_the_quotients_of_motions_one_after_another(begun: Begun) -> None:
    check(begun)


def resting(friction: float, delay: float = 0.0) -> Begun:
    """An arm that hangs a little bent, with half as much friction again when it rests."""
    arm = ArmParameters(coulomb=(friction, friction, friction))
    vector = vector_of(arm, Effects(stiction=(0.5 * friction,) * 3, delay=delay))
    state = np.array([-np.pi / 2 + 0.005, 0.003, -0.004, 0.0, 0.0, 0.0])
    return Begun(vector, np.zeros((5, 3)), 0.0, np.zeros(3), state)


def test_friction_holds_what_is_pushed_a_little() -> None:
    held, free = check(resting(0.05)), check(resting(0.0))
    np.testing.assert_allclose(held[:3, :3], np.eye(3), rtol=0.0, atol=0.01)
    assert np.abs(held[3:, 6:9]).max() < 0.02 * np.abs(free[3:, 6:9]).max()


@pytest.mark.parametrize("share", [0.25, 0.5, 0.999])
def test_a_command_may_come_within_a_sample(share: float) -> None:
    begun = resting(0.01, share * PERIOD)
    begun.volts[-1] = 2.0 * VOLTAGE_LIMIT
    check(begun)


def test_without_the_payload_the_other_derivatives_are_the_same() -> None:
    begun = resting(0.01)
    state, acting, slopes = linearised(begun)
    for found, expected in zip(linearised(begun, 9), (state, acting, slopes[:, :9]), strict=True):
        np.testing.assert_array_equal(found, expected)
