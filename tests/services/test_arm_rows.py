"""Ticks of an arm as rows: what acts while the gripper is closed is known of weighed boxes alone."""

import numpy as np

from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick
from dtwin.emulation.chain.arms import arm_of
from dtwin.services.chain.ticks import Rows

ARM = arm_of("planar-2r")


def tick(number: int, gripped: bool) -> JointTick:
    time = number * ARM.period
    return JointTick(
        JointSensors(number, time, (0.1, 0.2)), JointCommands(number, time, (1.0, 2.0), (0.1, 0.2), gripped)
    )


def test_what_acts_is_not_known_from_the_grip_to_a_sample_after_the_release() -> None:
    weighed, other = Rows(ARM, 0), Rows(ARM, 0, weighed=False)
    for rows in (weighed, other):
        for number in range(10):
            rows.add(tick(number, 3 <= number < 6))
    (*_, known, acting), (*_, unknown, anyway) = weighed.drain(), other.drain()
    assert np.isfinite(known).all()
    assert known.tolist() == acting.tolist() == anyway.tolist()
    assert np.flatnonzero(np.isnan(unknown).any(axis=1)).tolist() == [3, 4, 5, 6]
    assert np.array_equal(unknown[:3], known[:3])
    assert np.array_equal(unknown[7:], known[7:])
