"""PATH_PLANNER: the cubic path of every joint, and what starts one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.parameters import PICKUP, PLACES, Colour
from tests.support.driven import Driven, to, triple

angles = st.lists(st.floats(-7, 7), min_size=3, max_size=3)


@given(start=angles, duration=st.floats(0.05, 1.5), colour=st.sampled_from(sorted(PLACES)))
def test_path_is_the_cubic_with_rest_at_both_ends(start: list[float], duration: float, colour: Colour) -> None:
    planner = Driven("PATH_PLANNER")
    assert planner.fire("TIMING", T=duration) == []
    assert planner.fire("TARGET", **to(colour), **triple("THETA", start)) == ["RESET"]
    distance = np.array(PLACES[colour].theta) - start
    for tick in range(int(duration / 0.01) + 3):
        assert planner.fire("REQ") == ["CNF"]
        r = min(0.01 * tick / duration, 1.0)
        moving = 0.01 * tick < duration
        assert planner["MOVING"] == moving
        path = start + distance * (3 * r**2 - 2 * r**3)
        velocity = distance * 6 * (r - r**2) / duration
        acceleration = moving * distance * (6 - 12 * r) / duration**2
        np.testing.assert_allclose(planner.triple("THETA_D"), path, rtol=0, atol=1e-12)
        np.testing.assert_allclose(planner.triple("OMEGA_D"), velocity, rtol=0, atol=1e-11 / duration)
        np.testing.assert_allclose(planner.triple("ALPHA_D"), acceleration, rtol=0, atol=1e-11 / duration**2)
    np.testing.assert_array_equal(planner.triple("THETA_D"), PLACES[colour].theta)


@given(start=angles, duration=st.floats(0.1, 1.5), colour=st.sampled_from(sorted(PLACES)))
def test_smooth_path_has_no_steps_of_the_acceleration(start: list[float], duration: float, colour: Colour) -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TIMING", T=duration)
    planner.fire("TARGET", **to(colour), SMOOTH=True, **triple("THETA", start))
    distance = np.array(PLACES[colour].theta) - start
    fold = -abs(distance[0]) * np.array([0.0, 0.3, 0.15])
    for tick in range(int(duration / 0.01) + 3):
        planner.fire("REQ")
        r, middle = min(0.01 * tick / duration, 1.0), (0.01 * tick + 0.005) / duration
        path = start + distance * (10 * r**3 - 15 * r**4 + 6 * r**5) + fold * 64 * (r - r**2) ** 3
        velocity = (distance * 30 * (r - r**2) ** 2 + fold * 192 * (r - r**2) ** 2 * (1 - 2 * r)) / duration
        bend = middle - middle**2
        acceleration = distance * 60 * bend * (1 - 2 * middle)
        acceleration += fold * (384 * bend * (1 - 2 * middle) ** 2 - 384 * bend**2)
        moving = 0.01 * tick < duration
        np.testing.assert_allclose(planner.triple("THETA_D"), path, rtol=0, atol=1e-9)
        np.testing.assert_allclose(planner.triple("OMEGA_D"), velocity, rtol=0, atol=1e-9 / duration)
        expected = moving * acceleration / duration**2
        np.testing.assert_allclose(planner.triple("ALPHA_D"), expected, rtol=0, atol=1e-9 / duration**2)
    np.testing.assert_array_equal(planner.triple("THETA_D"), PLACES[colour].theta)


def test_a_smooth_path_goes_on_from_a_measured_velocity() -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("red"), SMOOTH=True, **triple("THETA", (0.0, 0.0, 0.0)))
    for k in range(4):
        planner.fire("REQ", HOLD=True, **triple("THETA", np.array([0.01, -0.02, 0.03]) * k))
    np.testing.assert_allclose(planner.triple("OMEGA_D"), [1.0, -2.0, 3.0], atol=1e-9)
    planner.fire("REQ", HOLD=False)
    np.testing.assert_allclose(planner.triple("OMEGA_D"), [1.0, -2.0, 3.0], atol=0.05)
    assert np.abs(planner.triple("ALPHA_D")).max() < 10.0


def test_targets_are_the_places() -> None:
    planner = Driven("PATH_PLANNER")
    for name, place in (("pickup", PICKUP), *PLACES.items()):
        planner.fire("TARGET", **to(name))
        planner.fire("REQ")
        np.testing.assert_array_equal(planner.triple("THETA_T"), place.theta)


def test_unknown_destination_keeps_the_target() -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("red"))
    planner.fire("TARGET", **to("Red"))
    planner.fire("REQ")
    np.testing.assert_array_equal(planner.triple("THETA_T"), PLACES["red"].theta)


@pytest.mark.parametrize("time", [0.0, -1.0, float("nan")])
def test_target_time_not_above_zero_is_ignored(time: float) -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TIMING", T=0.1)
    planner.fire("TARGET", **to("red"))
    planner.fire("TIMING", T=time)
    planner.fire("TARGET", **to("blue"))
    moving = []
    for _ in range(12):
        planner.fire("REQ")
        moving.append(planner["MOVING"])
    assert moving == [True] * 10 + [False] * 2


def test_target_time_counts_from_the_next_target() -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TIMING", T=0.05)
    planner.fire("TARGET", **to("red"))
    planner.fire("TIMING", T=5.0)
    for _ in range(6):
        planner.fire("REQ")
    assert not planner["MOVING"]


def test_held_path_starts_with_the_measured_angles_and_velocities() -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("red"))
    planner.fire("REQ")
    omega = np.array([3.0, -2.0, 1.0])
    for tick in range(4):
        theta = 0.5 + 0.01 * tick * omega
        assert planner.fire("REQ", HOLD=True, **triple("THETA", theta)) == ["RESET", "CNF"]
        np.testing.assert_array_equal(planner.triple("THETA_D"), theta)
        assert planner["MOVING"]
    np.testing.assert_allclose(planner.triple("OMEGA_D"), omega, atol=1e-12)
    # the cubic with these start values that rests at the target after T = 2 s
    target, T = np.array(PLACES["red"].theta), 2.0
    for tick in range(1, 201):
        assert planner.fire("REQ", HOLD=False) == ["CNF"]
        t = 0.01 * tick
        d = target - theta
        path = theta + omega * t + (3 * d / T - 2 * omega) / T * t**2 + (omega - 2 * d / T) / T**2 * t**3
        np.testing.assert_allclose(planner.triple("THETA_D"), path, atol=1e-12)
    assert not planner["MOVING"]
    np.testing.assert_array_equal(planner.triple("OMEGA_D"), 0.0)


@pytest.mark.parametrize("joint", [0, 1, 2])
def test_an_arm_that_does_not_follow_when_it_brakes_stands_where_it_is_then(joint: int) -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("red"))
    for _ in range(60):
        planner.fire("REQ")
    before, omega = np.array(planner.triple("THETA_D")), np.array(planner.triple("OMEGA_D"))
    measured = before + 0.15 * omega - 0.01
    measured[joint] -= 0.11
    for tick in range(1, 80):
        stop = {"STOP": 1 if tick < 40 else 2}
        first = "RESET" if tick == 31 else "STANDING"  # the controller must not keep what the distance asked for
        assert planner.fire("REQ", **stop, **triple("THETA", measured)) == [first, "CNF"]
        assert planner["HELD"] == (tick >= 31)
        if tick >= 31:
            np.testing.assert_allclose(planner.triple("THETA_D"), measured, atol=1e-4)
            np.testing.assert_allclose(planner.triple("OMEGA_D"), 0.0, atol=1e-2)
        if tick >= 32:
            assert planner["AWAY"] < 1e-4
    np.testing.assert_array_equal(planner.triple("OMEGA_D"), 0.0)
    moved = measured + 0.3  # it falls: that is no place to stand
    for _ in range(40):
        planner.fire("REQ", STOP=2, **triple("THETA", moved))
        assert planner["AWAY"] == pytest.approx(0.3, abs=1e-4)


@pytest.mark.parametrize(("late", "stands"), [(30, True), (37, True), (38, False)])
def test_an_arm_that_passes_its_place_as_the_braking_ends_stands_where_it_is_soon_after(
    late: int, stands: bool
) -> None:
    """One that was pushed comes back fast: it was taken for one that stands, overshot, and lost its torque."""
    planner = Driven("PATH_PLANNER")
    theta = np.array([0.5, -0.5, 0.3])
    planner.fire("TARGET", **to("here"), **triple("THETA", theta))
    planner.fire("REQ")
    told = []
    for tick in range(1, 45):
        measured = theta + np.array([0.0, 0.11 if tick > late else 0.0, 0.0])
        told += planner.fire("REQ", STOP=1 if tick < 40 else 2, **triple("THETA", measured))
    assert ("RESET" in told) == stands
