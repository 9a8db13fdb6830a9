"""Ticks of an arm as rows: nobody knows what an arm carries while the gripper is closed."""

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick
from dtwin.emulation.chain.arms import arm_of
from dtwin.identification.live.running import measurement_of
from dtwin.run.arm_cell import ArmCell
from dtwin.services.chain.identification import Motion
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


def test_a_running_arm_is_identified_without_what_it_does_with_a_box() -> None:
    motion = Motion(ArmCell(arm="planar-2r").settings(1.0, 0))
    for number in range(60):
        motion.add(tick(number, 30 <= number < 35))
        motion.gather()
    t, q, target, effort = motion.since(0.0)
    measured = measurement_of(ARM, Adjustment((0.1, 0.0), (1.0, 0.5), (1.0, 1.0), 0.0), t, q, target, effort)
    assert measured.gripped is not None
    assert measured.effort is not None
    assert np.flatnonzero(measured.gripped).tolist() == list(range(30, 36))
    assert measured.effort[20].tolist() == [1.0, 1.0]
    assert measured.q[20].tolist() == [0.0, 0.2]
    assert (np.isfinite(measured.effort).all(axis=1) == ~measured.gripped).all(), "nobody has weighed the box"
