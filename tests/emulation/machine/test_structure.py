"""Tolerances of links and base against the equations of the arm."""

import math

import mujoco
import numpy as np
import pytest

from dtwin.emulation.machine.plant import MachinePlant
from dtwin.emulation.machine.sections import Machine, Structure
from dtwin.emulation.plant import Plant
from dtwin.parameters import GRAVITY, ArmParameters

MADE = Structure(
    mass=(1.05, 0.95, 1.02), inertia=(1.2, 0.9, 1.1), length=(1.001, 0.999, 1.002), com=(0.97, 1.03, 1.01)
)


def test_an_arm_moves_as_one_with_the_parameters_that_it_was_made_with() -> None:
    nominal = ArmParameters()
    factors = {"m": MADE.mass, "I": MADE.inertia, "l": MADE.length, "c": MADE.com}
    true = nominal.with_values(
        {f"{s}{i + 1}": nominal.get(f"{s}{i + 1}") * triple[i] for s, triple in factors.items() for i in range(3)}
    )
    tested = Machine("made", structure=MADE)
    assert tested.arm(nominal).vector() == pytest.approx(true.vector(), rel=1e-15)
    arms = MachinePlant(tested, tested.arm(nominal)), Plant(true)
    for arm in arms:
        arm.reset((0.3, -0.4, 0.5))
        arm.set_payload(0.2)
        arm.advance(2.0)
    assert arms[0].theta == pytest.approx(arms[1].theta, abs=1e-10)


@pytest.mark.parametrize("theta", [(0.0, 0.0, 0.0), (0.4, -1.1, 2.0), (math.pi / 2, 0.0, 0.0)])
def test_gravity_pulls_at_the_centre_off_the_line(theta: tuple[float, float, float]) -> None:
    """The torque about joint 3 is g m3 (c3 cos phi - o3 sin phi), phi = q1 + q2 + q3."""
    tested = Machine("bent", structure=Structure(com_offset=(0.0, 0.0, 0.01)))
    arm = tested.arm(ArmParameters())
    plant = MachinePlant(tested, arm)
    plant.reset(theta)
    mujoco.mj_forward(plant.model, plant.data)
    expected = GRAVITY * arm.mass[2] * (arm.com[2] * math.cos(sum(theta)) - 0.01 * math.sin(sum(theta)))
    assert plant.data.qfrc_bias[2] == pytest.approx(expected, abs=1e-12)


def test_the_centre_off_the_line_is_inertia_too() -> None:
    tested = Machine("bent", structure=Structure(com_offset=(0.0, 0.0, 0.01)))
    arm = tested.arm(ArmParameters())
    plant = MachinePlant(tested, arm)
    full = np.zeros((4, 4))
    mujoco.mj_forward(plant.model, plant.data)
    mujoco.mj_fullM(plant.model, plant.data, full)
    assert full[2, 2] == pytest.approx(arm.inertia[2] + arm.mass[2] * (arm.com[2] ** 2 + 0.01**2), rel=1e-9)


def test_an_arm_on_a_tilted_base_moves_as_an_upright_one_that_started_turned() -> None:
    tilt = 0.07
    tested = Machine("tilted", structure=Structure(tilt=tilt))
    tilted, upright = MachinePlant(tested, ArmParameters()), Plant(ArmParameters())
    tilted.reset((0.3, -0.4, 0.5))
    upright.reset((0.3 + tilt, -0.4, 0.5))
    for arm in (tilted, upright):
        arm.advance(2.0)
    assert tilted.theta == pytest.approx((upright.theta[0] - tilt, *upright.theta[1:]), abs=1e-9)
