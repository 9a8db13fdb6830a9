"""Points of the ways on which the cell brings boxes to their places, as PATH_PLANNER knows them."""

from itertools import pairwise

import numpy as np
import pytest

from dtwin.parameters import HANGING, PICKUP, PLACES, VOLTAGE_LIMIT, ArmParameters, Colour, JointVector, Place, scaled
from dtwin.twin.dynamics import gravity
from dtwin.twin.kinematics import forward
from tests.support.driven import Driven, to, triple

NOMINAL = ArmParameters()
WEAK = scaled(scaled(scaled(NOMINAL, "K", 0.85), "m", 1.05), "c", 1.03)
"""The arm that asks for the highest voltages of all that docs/machine.md draws."""
DEAD_ZONE, SAG = 0.25, 0.05
HEAVIEST = 0.21


def point(name: str, *, via: bool = True) -> JointVector:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to(name), VIA=via, **triple("THETA", HANGING))
    first, second, third = planner.triple("THETA_T")
    return (float(first), float(second), float(third))


@pytest.mark.parametrize("colour", PLACES)
def test_every_arm_of_the_ranges_holds_a_box_everywhere_on_its_way(colour: Colour) -> None:
    names = ("pickup", "above pickup", "between", "behind", f"near {colour}", f"above {colour}", colour)
    vector = np.array(WEAK.vector())
    for start, end in pairwise(np.array([point(name) for name in names])):
        for part in np.linspace(0.0, 1.0, 30):
            theta = start + part * (end - start)
            needed = np.abs(gravity(theta, vector, HEAVIEST, False)) / np.array(WEAK.voltage_constant)
            bus = 1.0 + SAG * np.square(needed / VOLTAGE_LIMIT).sum()
            assert (needed * bus + DEAD_ZONE < 0.85 * VOLTAGE_LIMIT).all(), theta


@pytest.mark.parametrize(("name", "place"), [("pickup", PICKUP), *PLACES.items()])
def test_a_place_is_the_same_however_the_arm_gets_there(name: str, place: Place) -> None:
    for via in (False, True):
        theta = point(name, via=via)
        x, y, phi = forward(theta, NOMINAL)
        assert (x, y) == pytest.approx((place.x, place.y), abs=5e-4)
        assert np.cos(phi) == pytest.approx(1.0, abs=1e-7)
    assert tuple(point(name, via=False)) == place.theta
