"""Every effect of a drive against its equation."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.machine.drive import Amplifier
from dtwin.emulation.machine.plant import MachinePlant
from dtwin.emulation.machine.sections import Drive, Machine
from dtwin.errors import DivergenceError, ParameterError
from dtwin.parameters import VOLTAGE_LIMIT, ArmParameters
from tests.emulation.machine.bench import ARM, INERTIA, STEP, K, joint, machine, with_damping

volts = st.floats(-VOLTAGE_LIMIT, VOLTAGE_LIMIT)


def test_lag_is_an_exponential() -> None:
    tau = 0.010
    plant = joint(machine(Drive(lag=(tau,) * 3)))
    plant.apply((1.0, -2.0, 4.0, 0.0))
    for step in range(1, 41):
        plant.advance(STEP)
        expected = 1.0 - math.exp(-step * STEP / tau)
        # RK4 errs by the terms of the exponential's series that it leaves out
        allowed = step * (STEP / tau) ** 5 / 120
        assert plant.data.act[:3] == pytest.approx([expected, -2 * expected, 4 * expected], abs=4 * allowed)


def test_a_lag_that_the_step_cannot_follow_is_refused() -> None:
    tested = machine(Drive(lag=(0.0, 0.001, 0.0)))
    with pytest.raises(ParameterError, match=r"lag 0\.001 s of joint 2 needs a step"):
        MachinePlant(tested, ARM)
    MachinePlant(tested, ARM, step=0.001)


def test_back_emf_brakes_to_the_speed_of_the_motor_equation() -> None:
    """I w' = K (V - k_e w) - D w: w = K V / (D + K k_e) (1 - exp(-(D + K k_e) t / I))"""
    emf, damping, volt = 0.4, 0.02, 3.0
    plant = joint(machine(Drive(back_emf=(0.0, 0.0, emf))), with_damping(damping))
    plant.apply((0.0, 0.0, volt, 0.0))
    slope = damping + K * emf
    # what RK4 leaves out of the exponential's series
    allowed = K * volt / slope * (slope * STEP / INERTIA) ** 4 / 120
    for step in range(1, 101):
        plant.advance(STEP)
        expected = K * volt / slope * (1.0 - math.exp(-slope * step * STEP / INERTIA))
        assert plant.omega[2] == pytest.approx(expected, abs=allowed)


def test_a_weak_motor_turns_with_its_share() -> None:
    arm = Machine("weak", drive=Drive(torque=(1.0, 0.9, 0.8))).arm(ArmParameters())
    assert arm.voltage_constant == tuple(
        factor * k for factor, k in zip((1.0, 0.9, 0.8), ArmParameters().voltage_constant, strict=True)
    )


@given(volts, st.integers(1, 16))
def test_voltage_resolution(volt: float, bits: int) -> None:
    quantum = 2 * VOLTAGE_LIMIT / 2**bits
    found = Amplifier(Drive(bits=bits)).voltages((volt, 0.0, 0.0, 1.2345))
    assert abs(found[0] - volt) <= quantum / 2
    assert found[0] / quantum == round(found[0] / quantum)
    assert found[3] == 1.2345


@given(volts, st.floats(0.0, 2.0))
def test_dead_zone(volt: float, dead: float) -> None:
    found = Amplifier(Drive(dead_zone=(0.0, dead, 0.0))).voltages((volt, volt, volt, 0.0))
    assert found[0] == found[2] == volt
    if abs(volt) <= dead:
        assert found[1] == 0.0
    else:
        assert found[1] == pytest.approx(math.copysign(abs(volt) - dead, volt))


@given(volts, volts, volts, st.floats(1e-3, 0.5))
def test_supply_sag_solves_the_circuit(one: float, two: float, three: float, share: float) -> None:
    """With duties d = u / U, windings R and a supply resistance share R: bus = U - share R sum d (d bus / R)"""
    found = Amplifier(Drive(sag=share)).voltages((one, two, three, 0.0))
    duties = [volt / VOLTAGE_LIMIT for volt in (one, two, three)]
    bus = VOLTAGE_LIMIT / (1.0 + share * sum(duty**2 for duty in duties))
    current = sum(duty * duty * bus for duty in duties)
    assert bus == pytest.approx(VOLTAGE_LIMIT - share * current)
    assert found[:3] == pytest.approx([duty * bus for duty in duties])


@pytest.mark.parametrize("steps", [1, 3, 4, 9])
def test_a_delayed_command_acts_that_much_later_to_the_bit(steps: int) -> None:
    delayed = joint(machine(Drive(delay=steps * STEP, back_emf=(0.1,) * 3)))
    prompt = joint(machine(Drive(back_emf=(0.1,) * 3)))
    # what the prompt arm is told at the steps at which the delayed one obeys
    told = {steps + 4 * tick: (0.1 * tick, 0.0, 1.0 - 0.3 * tick, 0.0) for tick in range(10)}
    for tick in range(10):
        delayed.apply((9.0, 0.0, 0.0, 0.0))  # replaced before it counts
        delayed.apply(told[steps + 4 * tick])
        delayed.advance(4 * STEP)
        for step in range(4 * tick, 4 * tick + 4):
            if step in told:
                prompt.apply(told[step])
            prompt.advance(STEP)
        assert delayed.theta == prompt.theta
        assert delayed.omega == prompt.omega


def test_no_command_is_taken_that_is_none() -> None:
    with pytest.raises(DivergenceError):
        joint(machine(Drive(delay=0.01))).apply((math.nan, 0.0, 0.0, 0.0))
