"""The grip: friction between the pads holds a box through every motion, and lets it go where it is too small."""

import numpy as np
import pytest

from dtwin.controller.sequence import AMONG_BODIES
from dtwin.emulation.machine.sections import Contact
from dtwin.parameters import GripperParameters
from tests.support.grasp import Hand, way_point, ways

GRIPPER = GripperParameters()
PRESSURE = GRIPPER.volts * GRIPPER.voltage_constant / 0.1258
"""Force of the pads on the box, N: torque of the motor over the distance between hinge and pad."""


def lifted(friction: float, mass: float) -> Hand:
    hand = Hand(Contact(enabled=True, pad_friction=friction), mass)
    hand.grip()
    hand.move(way_point("above pickup"), 0.5)
    return hand


def test_the_gripper_stops_at_a_box_and_presses_with_the_torque_of_its_motor() -> None:
    hand = Hand(Contact(enabled=True), 0.2)
    hand.grip()
    hand.hold(0.2)  # The weight goes from the ground to the pads, which press unequally meanwhile.
    assert hand.bodies.held == 0
    assert hand.plant.gripper == pytest.approx(AMONG_BODIES.box_angle, abs=0.001)
    assert hand.plant.gripper > GRIPPER.closed + 0.1
    _, grip = hand.bodies.forces()
    assert (grip.fixed, grip.moving) == pytest.approx((PRESSURE, PRESSURE), rel=0.03)


def test_an_empty_gripper_closes_to_its_stop() -> None:
    hand = Hand(Contact(enabled=True), 0.2, box=(0.35, -0.002, -0.2))
    hand.grip()
    assert hand.bodies.held is None
    assert hand.plant.gripper == pytest.approx(GRIPPER.closed, abs=0.002)


@pytest.mark.parametrize("mass", [0.15, 0.2, 0.25])
@pytest.mark.parametrize("colour", ["blue", "red", "green"])
def test_a_box_is_held_through_every_motion_of_a_second(colour: str, mass: float) -> None:
    hand = lifted(0.6, mass)
    before, offsets = hand.offset(), []
    hand.each = lambda: offsets.append(hand.offset())
    for point in ways()[colour][:-1]:
        hand.move(point, 1.0)
        hand.hold(0.2)
    assert hand.bodies.held == 0
    assert np.abs(np.array(offsets) - before).max() < 0.002


@pytest.mark.parametrize("mass", [0.15, 0.2, 0.25])
def test_a_box_is_let_go_where_the_pads_have_a_third_of_their_friction(mass: float) -> None:
    hand = lifted(0.6, mass)
    hand.bodies.set_pad_friction(0.2)
    hand.move(ways()["green"][0], 1.0)
    hand.hold(0.5)
    assert hand.bodies.held is None
    assert hand.offset()[1] < -0.1


@pytest.mark.parametrize(("share", "holds"), [(1.15, True), (0.9, False)])
def test_coulomb_friction_decides_whether_a_box_at_rest_is_held(share: float, holds: bool) -> None:
    mass = 0.2
    hand = lifted(0.6, mass)
    hand.hold(0.3)
    hand.bodies.set_pad_friction(share * mass * 9.81 / (2 * PRESSURE))
    before = hand.offset()
    hand.hold(1.0)
    assert (hand.bodies.held == 0) is holds
    assert bool(abs(hand.offset()[1] - before[1]) < 0.001) is holds


def test_a_box_at_rest_sinks_by_less_than_ten_micrometres_a_second() -> None:
    hand = lifted(0.6, 0.2)
    hand.hold(1.0)
    before = hand.offset()
    hand.hold(2.0)
    assert np.abs(hand.offset() - before).max() < 2e-5


def test_a_box_that_is_let_go_in_mid_air_falls_and_lies_where_it_fell() -> None:
    hand = lifted(0.6, 0.2)
    for point in ways()["red"][:2]:  # Behind the places there is nothing below.
        hand.move(point, 1.0)
    before = hand.bodies.position(0)
    hand.gripper, hand.carries = 3.0, False
    hand.hold(1.5)
    x, _, z = hand.bodies.position(0)
    assert hand.bodies.held is None
    assert z == pytest.approx(-0.55 + 0.018, abs=0.001)
    assert abs(x - before[0]) < 0.1
    assert hand.bodies.speed(0) < 0.005
