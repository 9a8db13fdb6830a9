"""Goals that PATH_PLANNER refuses, and what PICK_AND_PLACE makes of it."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.sequence import AMONG_BODIES, CALLS
from dtwin.parameters import HANGING, PERIOD, PICKUP, PLACES, ArmParameters, JointVector
from dtwin.signals import Sensors
from tests.support.driven import Driven, to, triple

L1, L2, L3 = ArmParameters().length
UNDER_THE_BELT: JointVector = (-1.33, 0.541, 0.34)


def height(theta: JointVector) -> float:
    first, second, third = np.cumsum(theta)
    return float(L1 * math.sin(first) + L2 * math.sin(second) + L3 * math.sin(third))


@pytest.mark.parametrize(
    ("limits", "reason"),
    [({"RANGE2": 2.0}, 1), ({"RANGE2": math.nan}, 1), ({"FLOOR": 0.16}, 2), ({"FLOOR": math.nan}, 2)],
)
def test_the_arm_keeps_its_target_when_a_goal_is_refused(limits: dict[str, float], reason: int) -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("green"), **triple("THETA", HANGING))
    planner.fire("REQ")
    assert planner.fire("TARGET", **to("red"), **limits) == ["RESET", "REFUSED"]
    assert planner["REASON"] == reason
    np.testing.assert_array_equal(planner.triple("THETA_T"), PLACES["green"].theta)
    for _ in range(250):
        assert planner.fire("REQ") == ["CNF"]
    np.testing.assert_array_equal(planner.triple("THETA_D"), PLACES["green"].theta)
    assert planner.fire("TARGET", **to("red"), RANGE2=7.0, FLOOR=-1.0) == ["RESET"]
    assert planner["REASON"] == 0


def test_an_arm_without_a_target_stays_where_it_is() -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("red"), RANGE1=1.0, **triple("THETA", HANGING))
    for _ in range(300):
        planner.fire("REQ")
        np.testing.assert_array_equal(planner.triple("THETA_D"), HANGING)


@given(goal=st.tuples(*[st.floats(-20, 20) | st.just(math.nan) | st.just(math.inf)] * 3), floor=st.floats(-0.5, 0.5))
def test_a_goal_is_taken_if_it_is_within_all_limits(goal: JointVector, floor: float) -> None:
    planner = Driven("PATH_PLANNER")
    for name, angle in triple("THETA_T", goal).items():
        planner.resource.write(f"DUT.{name}", angle)
    planner.fire("TARGET", **to(""), FLOOR=floor, **triple("THETA", HANGING))
    in_range = all(abs(angle) <= 12.5664 for angle in goal)
    expected = 1 if not in_range else 0 if height(goal) >= floor else 2
    if expected != 2 or abs(height(goal) - floor) > 1e-12:
        assert planner["REASON"] == expected
    planner.fire("REQ")
    planner.fire("REQ")
    assert np.isfinite(planner.triple("THETA_D")).all()


@pytest.mark.parametrize(
    ("start", "goal", "reason"),
    [
        (HANGING, "before pickup", 0),
        (HANGING, "behind", 3),
        (UNDER_THE_BELT, "before pickup", 3),
        (PICKUP.theta, "before pickup", 0),
        (PLACES["red"].theta, "green", 3),
    ],
)
def test_a_careful_path_is_refused_when_something_is_in_the_way(start: JointVector, goal: str, reason: int) -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to(goal), CAREFUL=1, VIA=True, **triple("THETA", start))
    assert planner["REASON"] == reason


@pytest.mark.parametrize(("careful", "goal", "reason"), [(1, "above green", 3), (2, "above green", 0), (2, "red", 3)])
def test_an_arm_may_leave_what_it_lies_on(careful: int, goal: str, reason: int) -> None:
    first, second, third = PLACES["green"].theta
    lying = (first - 0.085, second, third)
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to(goal), CAREFUL=careful, VIA=True, **triple("THETA", lying))
    assert planner["REASON"] == reason


class Followed:
    """The application among bodies, with an arm that follows its path exactly."""

    def __init__(self, theta: JointVector) -> None:
        self.blocks = EmbeddedController(sequence=AMONG_BODIES)
        self.theta = theta
        self.ticks = 0

    def run(self, ticks: int) -> None:
        for _ in range(ticks):
            self.blocks.step(Sensors(self.ticks, self.ticks * PERIOD, self.theta, 0.9, False, ""))
            self.theta = self.blocks.target()
            self.ticks += 1

    def read(self, name: str) -> Any:
        return self.blocks.resource.read(name)


def test_an_arm_that_knows_no_way_stands_and_calls_for_help_until_it_is_elsewhere() -> None:
    arm = Followed(UNDER_THE_BELT)
    arm.run(1000)
    assert arm.theta == UNDER_THE_BELT
    (call,) = arm.blocks.drain_events()
    assert call.text == CALLS[2]
    stop = arm.blocks.resource.server("TWIN.MONITORING.VERDICT")
    stop.exchange([3, 1.0, False])
    arm.run(10)
    arm.theta = (-1.7, 0.2, 0.0)  # moved by hand; a jump of two joints by 0.5 rad would be another arm
    arm.run(10)
    stop.exchange([0, 0.0, True])
    arm.run(1500)
    assert arm.theta == PICKUP.theta
    assert [event.text for event in arm.blocks.drain_events()] == [CALLS[0]]


@pytest.mark.parametrize("block", ["PLANNER.HOLD", "PLANNER.STOP"])
def test_after_others_have_moved_the_arm_its_way_begins_anew(block: str) -> None:
    arm = Followed(HANGING)
    arm.run(700)
    assert arm.theta != HANGING
    if block == "PLANNER.HOLD":
        arm.blocks.resource.server("TWIN.IDENTIFICATION.REQUEST").exchange([True])
        arm.run(5)
        arm.blocks.resource.server("TWIN.IDENTIFICATION.REQUEST").exchange([False])
    else:
        stop = arm.blocks.resource.server("TWIN.MONITORING.VERDICT")
        stop.exchange([3, 1.0, False])
        arm.run(5)
        stop.exchange([0, 0.0, True])
    arm.run(3)
    assert arm.read("SEQUENCE.DESTINATION") == "here"
    arm.run(1500)
    assert arm.theta == PICKUP.theta


def test_a_goal_out_of_range_is_a_call_for_help() -> None:
    cell = EmbeddedController()
    cell.resource.write("PLANNER.RANGE3", 1.0)
    theta: JointVector = HANGING
    for tick in range(300):
        cell.step(Sensors(tick, tick * PERIOD, theta, 0.9, False, ""))
        assert cell.target() == theta
    assert [event.text for event in cell.drain_events()] == [CALLS[3]]
