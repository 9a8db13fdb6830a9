"""Ticks of an arm as rows: nobody knows what an arm carries while the gripper is closed."""

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
    rows, empty = Rows(ARM, 0), Rows(ARM, 0)
    for number in range(10):
        rows.add(tick(number, 3 <= number < 6))
        empty.add(tick(number, False))
    (*_, known, acting), (*_, unladen, anyway) = rows.drain(), empty.drain()
    assert np.isfinite(unladen).all()
    assert unladen.tolist() == acting.tolist() == anyway.tolist()
    assert np.flatnonzero(np.isnan(known).any(axis=1)).tolist() == [3, 4, 5, 6]
    assert np.array_equal(known[:3], acting[:3])
    assert np.array_equal(known[7:], acting[7:])
