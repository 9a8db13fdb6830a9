"""Contact forces and the place of a held box, against the weight of the box and the torque of the gripper."""

import numpy as np
import pytest

from dtwin.emulation.emulation import Emulation
from dtwin.emulation.machine.sections import Contact, Machine
from dtwin.parameters import GRAVITY, PERIOD, GripperParameters
from tests.support.grasp import Hand, way_point

GRIPPER = GripperParameters()
MASS = 0.2
PRESSURE = GRIPPER.volts * GRIPPER.voltage_constant / 0.1258
"""Force of the pads on the box, N: torque of the motor over the distance between hinge and pad."""


@pytest.fixture(scope="module")
def holding() -> Hand:
    """A hand that has lifted a box and stands still."""
    hand = Hand(Contact(enabled=True), MASS)
    hand.grip()
    hand.move(way_point("above pickup"), 0.5)
    hand.hold(1.0)
    return hand


def test_the_belt_carries_the_weight_of_a_box_that_waits() -> None:
    hand = Hand(Contact(enabled=True), MASS, box=(0.3, -0.002, -0.2))
    hand.hold(0.5)
    forces, grip = hand.bodies.forces()
    assert forces[:, 3:].sum(axis=0) == pytest.approx((0.0, 0.0, MASS * GRAVITY), abs=0.01)
    assert np.abs(forces[:, :3] - (0.3, -0.002, -0.218)).max() < 0.02
    assert grip == (0.0, 0.0, 0.0, 0.0)


def test_pads_press_with_the_torque_of_the_motor_and_carry_the_weight(holding: Hand) -> None:
    forces, grip = holding.bodies.forces()
    assert (grip.fixed, grip.moving) == pytest.approx((PRESSURE, PRESSURE), rel=0.03)
    assert grip.tangential == pytest.approx(MASS * GRAVITY, rel=0.02)
    assert grip.bearable == pytest.approx(0.6 * (grip.fixed + grip.moving), rel=1e-6)
    assert forces[:, 3:].sum(axis=0) == pytest.approx((0.0, 0.0, MASS * GRAVITY), abs=0.05)


def test_the_force_of_each_pad_pushes_the_box_away_from_it(holding: Hand) -> None:
    forces, _ = holding.bodies.forces()
    inward = holding.bodies.position(0)[1] - forces[:, 1]
    assert np.abs(inward).min() > 0.01
    assert (inward * forces[:, 4] > 0).all()


def test_the_offset_of_a_box_turns_with_the_gripper(holding: Hand) -> None:
    """At 90 degrees the direction along link 3 is up."""
    x, _, z = holding.bodies.offset(0)
    assert (x, z) == pytest.approx((0.0, 0.0), abs=0.001)
    hand = Hand(Contact(enabled=True), MASS, at=(0.0, 0.0, np.pi / 2))
    tip_x, tip_z = hand.plant.tip()
    hand.bodies.put(0, (tip_x + 0.02, 0.1, tip_z + 0.03), MASS)
    assert hand.bodies.offset(0) == pytest.approx((0.03, 0.1, -0.02), abs=1e-9)


def test_a_cell_shows_the_boxes_that_are_in_it() -> None:
    cell = Emulation(machine=Machine(contact=Contact(enabled=True)), seed=1)
    touch = cell.hidden().touch
    assert touch is not None
    assert touch.colours == ()
    assert touch.poses.shape == (0, 7)
    for _ in range(1200):
        cell.advance(PERIOD)
    hidden = cell.hidden()
    assert hidden.drives is None
    assert hidden.touch is not None
    [colour], [pose] = hidden.touch.colours, hidden.touch.poses
    assert colour == "green"
    assert pose[:3] == pytest.approx((0.2, -0.002, -0.2), abs=0.002)
    assert np.linalg.norm(pose[3:]) == pytest.approx(1.0)
    assert hidden.touch.held is None


def test_looking_changes_nothing(holding: Hand) -> None:
    hand = Hand(Contact(enabled=True), MASS)

    def look() -> None:
        hand.bodies.forces()
        hand.bodies.offset(0)

    hand.each = look
    hand.grip()
    hand.move(way_point("above pickup"), 0.5)
    hand.hold(1.0)
    assert hand.plant.state() == holding.plant.state()


def test_an_ideal_machine_hides_nothing() -> None:
    ideal = Emulation().hidden()
    assert ideal.drives is ideal.touch is None
