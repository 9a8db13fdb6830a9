"""What a machine hides in its drives, against closed forms on one joint in free space."""

import math

import pytest

from dtwin.emulation.machine.sections import Drive, Transmission
from dtwin.parameters import PERIOD
from tests.emulation.machine.bench import K, joint, machine, with_damping

DriveVector = tuple[float, float, float, float]


def command(volts: float) -> DriveVector:
    return 0.0, 0.0, volts, 0.0


def test_friction_at_rest_is_the_torque_of_the_motor() -> None:
    plant = joint(machine(transmission=Transmission(coulomb=(0.0, 0.0, 0.03))))
    plant.apply(command(0.1))
    plant.advance(0.5)
    assert plant.drives().friction[2] == pytest.approx(K * 0.1, rel=1e-3)


@pytest.mark.parametrize("way", [1, -1])
def test_friction_in_motion_is_viscous_and_dry(way: int) -> None:
    plant = joint(machine(transmission=Transmission(coulomb=(0.0, 0.0, 0.03))), with_damping(0.05), omega=2.0 * way)
    plant.advance(PERIOD)
    expected = 0.05 * plant.omega[2] + 0.03 * way
    assert plant.drives().friction[2] == pytest.approx(expected, rel=1e-3)


def test_friction_at_small_velocities_is_that_of_stribeck() -> None:
    gear = Transmission(coulomb=(0.0, 0.0, 0.03), static=(0.0, 0.0, 0.045), stribeck_velocity=(0.1, 0.1, 1.0))
    plant = joint(machine(transmission=gear), omega=0.5, step=1e-4)
    plant.advance(1e-3)
    curve = 0.03 + 0.015 * math.exp(-(plant.omega[2] ** 2))
    assert plant.drives().friction[2] == pytest.approx(curve, rel=1e-3)


def test_the_acting_voltage_lags_behind_the_command() -> None:
    plant = joint(machine(drive=Drive(lag=(0.0, 0.0, 0.010), dead_zone=(0.0, 0.0, 0.2))))
    plant.apply(command(4.0))
    plant.advance(PERIOD)
    assert plant.drives().volts[2] == pytest.approx(3.8 * (1 - math.exp(-1)), rel=1e-3)


def test_the_acting_voltage_is_the_command_before_the_delay() -> None:
    plant = joint(machine(drive=Drive(delay=0.015)))
    seen = []
    for volts in (1.0, 2.0, 3.0, 4.0):
        plant.apply(command(volts))
        plant.advance(PERIOD)
        seen.append(plant.drives().volts[2])
    assert seen == [0.0, 1.0, 2.0, 3.0]


def test_a_motor_stands_ahead_of_its_link_by_play_and_wind_up() -> None:
    """A cable holds the link against the motor: the torque of both, K v, winds up the gear."""
    gear = Transmission(
        stiffness=(0.0, 0.0, 50.0),
        backlash=(0.0, 0.0, 0.01),
        rotor_inertia=(0.0, 0.0, 1e-3),
        cable=(0.0, 0.0, 0.5),
        coulomb=(0.0, 0.0, 0.0),
    )
    plant = joint(machine(transmission=gear), with_damping(0.2))
    plant.apply(command(2.0))
    plant.advance(8.0)
    ahead = plant.drives().motors[2] - plant.theta[2]
    assert plant.theta[2] == pytest.approx(K * 2.0 / 0.5, rel=1e-3)
    assert ahead == pytest.approx(0.005 + K * 2.0 / 50.0, rel=1e-3)
    assert plant.drives().motors[:2] == plant.theta[:2]
