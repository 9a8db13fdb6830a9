"""Samples between two samples."""

import numpy as np
import pytest

from dtwin.live.strides import MOST, STRIDE, strides
from dtwin.signals import Sensors


def sample(*theta: float, sequence: int = 0) -> Sensors:
    first, second, third = theta
    return Sensors(sequence, 0.01 * sequence, (first, second, third), 0.4, True, "red")


@pytest.mark.parametrize("end", [(3.0, -2.5, 0.1), (0.41, 0.0, 0.0), (-9.0, 9.0, 9.0)])
def test_no_joint_jumps_and_the_rest_is_that_of_the_later_sample(end: tuple[float, float, float]) -> None:
    before, now = sample(0.0, 0.0, 0.0), sample(*end, sequence=205)
    steps = strides(before, now)
    way = np.array([each.theta for each in (before, *steps, now)])
    assert np.abs(np.diff(way, axis=0)).max() <= STRIDE + 1e-12
    np.testing.assert_allclose(np.diff(way, axis=0), np.tile(np.diff(way, axis=0)[0], (len(way) - 1, 1)))
    assert {(s.sequence, s.gripper, s.box_present, s.box_colour) for s in steps} == {(205, 0.4, True, "red")}


def test_near_samples_need_no_step_and_far_ones_get_none() -> None:
    assert strides(sample(0.0, 0.0, 0.0), sample(STRIDE, 0.0, -STRIDE, sequence=9)) == []
    assert strides(sample(0.0, 0.0, 0.0), sample((MOST + 1) * STRIDE, 0.0, 0.0, sequence=9)) == []
