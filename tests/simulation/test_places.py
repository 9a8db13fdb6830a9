"""Places and candidates in words."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import ParameterError, UnreachableError
from dtwin.parameters import HANGING, HOME, PICKUP, PLACES, ArmParameters
from dtwin.simulation.candidates import vary
from dtwin.simulation.places import nearest, parse_goal, parse_start
from dtwin.simulation.whatif import MotionCase
from dtwin.twin.kinematics import forward, inverse

ARM = ArmParameters()


def test_names_stay_names_where_the_planner_knows_them() -> None:
    assert parse_goal("red", ARM, HOME) == "red"
    assert parse_goal("hanging", ARM, HOME) == HANGING
    assert parse_start("pickup", ARM) == PICKUP.theta
    assert parse_start("0.1,-2,3", ARM) == (0.1, -2.0, 3.0)


@given(theta_1=st.floats(-3, 3), theta_2=st.floats(-3, 3), near=st.tuples(*[st.floats(-6, 6)] * 3))
def test_coordinates_are_reached_in_the_least_way(
    theta_1: float, theta_2: float, near: tuple[float, float, float]
) -> None:
    x, y, _ = forward((theta_1, theta_2, -theta_1 - theta_2), ARM)
    found = nearest(x, y, ARM, near)
    there_x, there_y, phi = forward(found, ARM)
    assert (there_x, there_y, phi) == pytest.approx((x, y, 0.0), abs=1e-7)
    way = max(abs(a - b) for a, b in zip(found, near, strict=True))
    for elbow, turn_1, turn_2 in itertools.product(("up", "down"), (-1, 0, 1), (-1, 0, 1)):
        first, second, _ = inverse(x, y, ARM, elbow="up" if elbow == "up" else "down")
        other = (first + turn_1 * math.tau, second + turn_2 * math.tau)
        third = -other[0] - other[1]
        assert way <= max(abs(a - b) for a, b in zip((*other, third), near, strict=True)) + 1e-6


def test_the_places_are_near_their_coordinates() -> None:
    for place in (PICKUP, *PLACES.values()):
        found = parse_goal(f"{place.x},{place.y}", ARM, place.theta)
        assert found == pytest.approx(place.theta, abs=2e-3)


@pytest.mark.parametrize("text", ["1", "0.1,", "a,b", "1,2,3,4", "nan,0", "", "rot"])
def test_nonsense_is_refused(text: str) -> None:
    with pytest.raises(ParameterError):
        parse_start(text, ARM)


def test_out_of_reach_is_refused() -> None:
    with pytest.raises(UnreachableError):
        parse_goal("1,1", ARM, HOME)


def test_candidates_change_what_they_name() -> None:
    case = vary(
        MotionCase("red"), "T=1.5 kp=300,600,400 kd2=5 ki=10 law=row_sum D2=0.1 payload=0.25 box=0.3 noise=0.01"
    )
    settings = case.settings
    assert (settings.target_time, settings.law, settings.payload) == (1.5, "row_sum", 0.3)
    assert settings.gains.kp == (300.0, 600.0, 400.0)
    assert settings.gains.kd == (2.0, 5.0, 2.0)
    assert settings.gains.ki == (10.0, 10.0, 10.0)
    assert case.arm.damping == (0.05, 0.1, 0.05)
    assert settings.model == ArmParameters()
    assert (case.payload, case.noise) == (0.25, 0.01)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("T", "expected NAME=VALUE, got 'T'"),
        ("kp=1,2", "kp: expected one number or three"),
        ("kp1=1,2,3", "kp1: expected one number"),
        ("K4=1", "unknown name 'K4'"),
        ("law=best", "law: expected computed_torque, row_sum or cascade, got 'best'"),
        ("D1=x", "D1: expected a number, got 'x'"),
        ("D1=-1", "D1"),
        ("T=nan", "target time"),
        ("kp=-1", "kp1: expected a finite number at least 0"),
    ],
)
def test_wrong_candidates_are_refused(text: str, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        vary(MotionCase("red"), text)
