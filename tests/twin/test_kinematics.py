import math
from collections.abc import Sequence
from typing import cast

import numpy as np
import pytest
from hypothesis import given

from dtwin.errors import ParameterError, UnreachableError
from dtwin.parameters import HOME, PICKUP, PLACES, ArmParameters, JointVector, Place
from dtwin.twin.kinematics import Elbow, forward, inverse, joint_positions
from tests.support.arms import DEFAULT, arms, reals, triples

HALF_DIGIT = 5e-5
"""The error (rad) that rounding to the four printed digits can make."""


def assert_same_direction(actual: Sequence[float], expected: Sequence[float], tolerance: float) -> None:
    difference = [math.remainder(a - b, 2 * math.pi) for a, b in zip(actual, expected, strict=True)]
    assert np.abs(difference).max() <= tolerance


def test_stretched_arm_lies_along_x() -> None:
    assert forward(HOME, DEFAULT) == pytest.approx((sum(DEFAULT.length), 0, 0))
    assert joint_positions((math.pi / 2, 0, 0), DEFAULT)[2] == pytest.approx((0, sum(DEFAULT.length[:2])))


@pytest.mark.parametrize(
    ("place", "elbow"),
    [(PICKUP, "up"), (PLACES["blue"], "down"), (PLACES["red"], "up"), (PLACES["green"], "up")],
    ids=["pickup", "blue", "red", "green"],
)
def test_angles_of_the_places_are_one_branch_of_the_inverse(place: Place, elbow: Elbow) -> None:
    solution = inverse(place.x, place.y, DEFAULT, elbow=elbow)
    assert_same_direction(solution, place.theta, HALF_DIGIT)
    # Each angle moves the tip by at most its distance to the tip: l3, l2 + l3 and all three lengths.
    reach = np.cumsum(DEFAULT.length[::-1]).sum()
    assert forward(place.theta, DEFAULT) == pytest.approx((place.x, place.y, 0), abs=HALF_DIGIT * reach)


@pytest.mark.parametrize("elbow", ["up", "down"])
@pytest.mark.parametrize("place", [PICKUP, *PLACES.values()])
def test_both_elbows_reach_every_place_and_lie_on_their_side(place: Place, elbow: Elbow) -> None:
    theta = inverse(place.x, place.y, DEFAULT, elbow=elbow)
    assert forward(theta, DEFAULT) == pytest.approx((place.x, place.y, 0), abs=1e-12)
    _, (x2, y2), (x3, y3), _ = joint_positions(theta, DEFAULT)
    left_of_ray = x3 * y2 - y3 * x2
    assert (left_of_ray > 0) == (elbow == "up")


@given(theta=triples(reals(-3.1, 3.1)), parameters=arms)
def test_inverse_undoes_forward(theta: JointVector, parameters: ArmParameters) -> None:
    x, y, phi = forward(theta, parameters)
    back = inverse(x, y, parameters, phi, "up" if theta[1] < 0 else "down")
    # Where the elbow is stretched or folded, acos turns rounding of d^2 (1e-16 relative to the wrist's distance
    # from the tip, which may be ten times the links') into its square root.
    assert forward(back, parameters) == pytest.approx((x, y, phi), abs=1e-7)
    if abs(theta[1]) > 0.1 and math.hypot(x - parameters.length[2] * math.cos(phi), y) > 0.01:
        assert back[1] == pytest.approx(theta[1], abs=1e-9)


@pytest.mark.parametrize(("x", "y"), [(0.6, 0.0), (-0.3, 0.3), (DEFAULT.length[2], 0.01)])
def test_out_of_reach_names_distance_and_reach(x: float, y: float) -> None:
    with pytest.raises(UnreachableError) as caught:
        inverse(x, y, DEFAULT)
    distance = math.hypot(x - DEFAULT.length[2], y)
    message = str(caught.value)
    assert f"{distance:.4f} m from joint 1" in message
    assert "0.0254 to 0.2903 m" in message


def test_bad_elbow_and_nan_are_refused() -> None:
    with pytest.raises(ParameterError, match="unknown elbow 'left': expected up or down"):
        inverse(0.2, 0.0, DEFAULT, elbow=cast(Elbow, "left"))
    with pytest.raises(ParameterError, match="expected finite"):
        inverse(math.nan, 0.0, DEFAULT)
