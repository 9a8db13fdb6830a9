"""The twin with effects against closed forms, and against the twin without them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dtwin.errors import ParameterError
from dtwin.parameters import GRAVITY, PERIOD, ArmParameters
from dtwin.twin.dynamics import Array, gravity, mass_matrix
from dtwin.twin.effects import EFFECT_NAMES, NO_EFFECTS, Effects
from dtwin.twin.machine import (
    EXTRA_NAMES,
    MACHINE_NAMES,
    SUBSTEP,
    WIDTH,
    eccentricity_slopes,
    integrate_machine,
    machine_of_vector,
    machine_rollout,
    vector_of,
)
from dtwin.twin.rollout import rollout

ARM = ArmParameters()
START = np.array([0.1, -0.5, 0.3, 0.2, -0.1, 0.4])
VOLTS = np.repeat(np.random.default_rng(0).normal(0.0, 2.0, (10, 3)), 5, axis=0)
EMPTY = np.zeros(len(VOLTS))


def moved(effects: Effects, volts: Array = VOLTS, start: Array = START, arm: ArmParameters = ARM) -> Array:
    return machine_rollout(vector_of(arm, effects), start, volts, np.zeros(len(volts)))[0]


def acceleration(vector: Array, start: Array = START, volts: Array = VOLTS[:1]) -> Array:
    """Joint accelerations at the start, (3,), rad/s^2."""
    states, moment = np.empty((2, 6)), 1e-7
    states[0] = start
    integrate_machine(vector, volts, np.zeros(1), moment, moment, 0, np.full(3, np.nan), states)
    slope: Array = (states[1, 3:] - start[3:]) / moment
    return slope


@given(st.lists(st.floats(-8.0, 8.0), min_size=9, max_size=9), st.floats(0.0, 0.3))
@settings(max_examples=20, deadline=None)
def test_without_effects_it_is_the_twin(volts: list[float], payload: float) -> None:
    commands, masses = np.array(volts).reshape(3, 3), np.full(3, payload)
    states, readings = machine_rollout(vector_of(ARM, NO_EFFECTS), START, commands, masses)
    np.testing.assert_allclose(states, rollout(ARM, START, commands, masses), rtol=0.0, atol=1e-11)
    assert np.array_equal(readings, states[:, :3])


def test_a_whole_tick_of_delay_is_the_command_before() -> None:
    late = np.concatenate((VOLTS[:1], VOLTS[:-1]))
    np.testing.assert_allclose(moved(Effects(delay=PERIOD)), moved(NO_EFFECTS, late), rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(
        moved(Effects(delay=1.5 * PERIOD)), moved(Effects(delay=0.5 * PERIOD), late), rtol=0.0, atol=1e-11
    )


def test_a_dead_zone_is_a_smaller_voltage() -> None:
    smaller = np.sign(VOLTS) * np.maximum(np.abs(VOLTS) - 0.3, 0.0)
    np.testing.assert_allclose(
        moved(Effects(dead_zone=(0.3, 0.3, 0.3))), moved(NO_EFFECTS, smaller), rtol=0.0, atol=1e-11
    )


def test_sag_is_that_of_a_supply_behind_a_resistance() -> None:
    volts = np.clip(VOLTS, -8.0, 8.0)
    weaker = volts / (1.0 + 0.05 * np.sum((volts / 8.0) ** 2, axis=1, keepdims=True))
    np.testing.assert_allclose(moved(Effects(sag=0.05)), moved(NO_EFFECTS, weaker), rtol=0.0, atol=1e-11)


def test_a_lag_forgets_exponentially() -> None:
    """Rotors so heavy that nothing else counts turn by K / J (t - T + T exp(-t / T)), an integrator behind a lag."""
    volts = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, -1.0]])
    start, inertia, lag = np.zeros(6), 1e3, (0.002, 0.004, 0.008)
    heavy = Effects(rotor_inertia=(inertia,) * 3, lag=lag)
    pushed, left = (moved(heavy, each, start)[2, 3:] for each in (volts, np.zeros((2, 3))))
    T = np.array(lag)
    expected = np.array(ARM.voltage_constant) * volts[1] / inertia * (PERIOD - T + T * np.exp(-PERIOD / T))
    np.testing.assert_allclose(pushed - left, expected, rtol=2e-3)


def test_friction_holds_up_to_its_size_at_rest_and_acts_in_full_in_motion() -> None:
    constant = np.array(ARM.voltage_constant)
    hold = gravity(START[:3], np.array(ARM.vector())) / constant
    still = np.array([*START[:3], 0.0, 0.0, 0.0])
    pushed = np.tile(hold + np.array([0.02, 0.0, 0.0]) / constant, (50, 1))
    rough = Effects(stiction=(0.02, 0.02, 0.02))
    for arm, effects in (
        (ArmParameters(coulomb=(0.03,) * 3), NO_EFFECTS),
        (ArmParameters(coulomb=(0.01,) * 3), rough),
    ):
        assert np.abs(moved(effects, pushed, still, arm)[:, 3:]).max() < 2 * WIDTH
    assert np.abs(moved(NO_EFFECTS, pushed, still)[-1, 3:]).max() > 10 * WIDTH
    turning = np.array([*START[:3], 1.0, -1.0, 1.0])
    rubbed = acceleration(vector_of(ArmParameters(coulomb=(0.03,) * 3), NO_EFFECTS), turning)
    against = Effects(torque=(-0.03, 0.03, -0.03))
    np.testing.assert_allclose(rubbed, acceleration(vector_of(ARM, against), turning), rtol=1e-5)


def test_a_tilted_base_turns_gravity_and_an_offset_mass_its_moment() -> None:
    """An arm that is turned against the tilt of its base moves as it would without both."""
    turned = START - np.array([0.05, 0, 0, 0, 0, 0])
    tilted = moved(Effects(tilt=0.05), start=turned)
    np.testing.assert_allclose(tilted[:, 1:], moved(NO_EFFECTS)[:, 1:], rtol=0.0, atol=1e-9)
    torque = ARM.mass[2] * GRAVITY * 0.002 * math.sin(START[:3].sum())
    beside = acceleration(vector_of(ARM, Effects(com_offset=(0.0, 0.0, 0.002))))
    np.testing.assert_allclose(beside, acceleration(vector_of(ARM, Effects(torque=(torque,) * 3))), rtol=1e-5)


def test_cables_rotors_and_encoders() -> None:
    pulled = Effects(cable=(0.02, 0.0, 0.0), torque=(0.02 * START[0], 0.0, 0.0))
    np.testing.assert_allclose(
        acceleration(vector_of(ARM, pulled)), acceleration(vector_of(ARM, NO_EFFECTS)), rtol=1e-5
    )
    M = mass_matrix(START[:3], np.array(ARM.vector()))
    J = np.diag([1e-3, 2e-3, 3e-3])
    turned = acceleration(vector_of(ARM, Effects(rotor_inertia=(1e-3, 2e-3, 3e-3))))
    np.testing.assert_allclose((M + J) @ turned, M @ acceleration(vector_of(ARM, NO_EFFECTS)), atol=1e-5)
    eccentric = Effects(eccentric_sin=(1e-3, 0.0, 0.0), eccentric_cos=(0.0, 2e-3, 0.0))
    states, readings = machine_rollout(vector_of(ARM, eccentric), START, VOLTS, EMPTY)
    q = states[:, :3]
    np.testing.assert_allclose(readings[:, 0], q[:, 0] + 1e-3 * np.sin(q[:, 0]))
    np.testing.assert_allclose(readings[:, 1], q[:, 1] + 2e-3 * np.cos(q[:, 1]))
    assert np.array_equal(readings[:, 2], q[:, 2])


def test_torques_of_unknown_cause_have_their_shapes() -> None:
    for name, shape in (
        ("sine1", math.sin(START[0])),
        ("cosine2", math.cos(START[1])),
        ("direction3", math.tanh(START[5] / 0.05)),
        ("speed1", START[3] * abs(START[3])),
        ("voltage2", VOLTS[0, 1] * abs(VOLTS[0, 1])),
    ):
        p, torque = vector_of(ARM, NO_EFFECTS), np.zeros(3)
        p[MACHINE_NAMES.index(name)] = 0.1
        torque[int(name[-1]) - 1] = 0.1 * shape
        same = Effects(torque=(torque[0], torque[1], torque[2]))
        np.testing.assert_allclose(acceleration(p), acceleration(vector_of(ARM, same)), rtol=1e-5, err_msg=name)


def test_a_finer_step_changes_little() -> None:
    effects = Effects((1e-3,) * 3, (0.004,) * 3, (0.1,) * 3, (0.008,) * 3, delay=0.013)
    everything = vector_of(ArmParameters(coulomb=(0.02, 0.02, 0.02)), effects)
    coarse, fine = np.empty((51, 6)), np.empty((51, 6))
    coarse[0] = fine[0] = START
    integrate_machine(everything, VOLTS, EMPTY, PERIOD, SUBSTEP, 0, np.full(3, np.nan), coarse)
    integrate_machine(everything, VOLTS, EMPTY, PERIOD, SUBSTEP / 8, 0, np.full(3, np.nan), fine)
    assert np.abs(coarse - fine)[:, :3].max() < 2e-3


def test_names_and_vectors() -> None:
    effects = Effects(lag=(0.001, 0.002, 0.003), tilt=-0.01, torque=(-0.1, 0.0, 0.1))
    assert machine_of_vector(vector_of(ARM, effects)) == (ARM, effects)
    assert len(MACHINE_NAMES) == len(vector_of(ARM, effects)) == 21 + len(EFFECT_NAMES) + len(EXTRA_NAMES)
    assert Effects().with_values({"lag2": 0.004}).lag == (0.0, 0.004, 0.0)
    with pytest.raises(ParameterError, match="unknown effect 'lag4': expected rotor_inertia1"):
        Effects().with_values({"lag4": 0.0})
    with pytest.raises(ParameterError, match="delay: expected a finite number of at least 0, got -1"):
        Effects(delay=-1.0)


def test_ripple_is_a_torque_that_goes_with_the_angle() -> None:
    wavy = Effects(ripple_sin=(0.01, 0.0, 0.02), ripple_cos=(0.0, 0.03, 0.01), ripple_periods=(7.0, 20.0, 31.5))
    angles = np.array([7.0, 20.0, 31.5]) * START[:3]
    first, second, third = (
        np.array([0.01, 0, 0.02]) * np.sin(angles) + np.array([0, 0.03, 0.01]) * np.cos(angles)
    ).tolist()
    steady = Effects(torque=(first, second, third))
    np.testing.assert_allclose(acceleration(vector_of(ARM, wavy)), acceleration(vector_of(ARM, steady)), rtol=1e-4)


def test_an_eccentric_encoder_reads_on_without_another_motion() -> None:
    effects = Effects(eccentric_sin=(0.001, 0.0, 0.002), eccentric_cos=(0.0, -0.003, 0.001))
    vector = vector_of(ARM, effects)
    states, base = machine_rollout(vector, START, VOLTS, EMPTY)
    slopes = eccentricity_slopes(states[:, :3])
    assert list(slopes) == [f"eccentric_{wave}{joint}" for wave in ("sin", "cos") for joint in (1, 2, 3)]
    for name, slope in slopes.items():
        changed = vector.copy()
        changed[MACHINE_NAMES.index(name)] += 0.01
        readings = machine_rollout(changed, START, VOLTS, EMPTY)[1]
        np.testing.assert_allclose(readings, base + 0.01 * slope, rtol=0.0, atol=1e-14)
