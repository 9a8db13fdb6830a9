"""From one sample to a later one in steps that an arm can make."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from dtwin.signals import Sensors

STRIDE: Final = 0.1
"""rad of a joint between two samples: a fifth of what SAFE_STOP and RESTART_DETECTOR stand, and 10 rad/s of 25"""
MOST: Final = 200
"""steps: an arm that is farther away is given up"""


def strides(before: Sensors, now: Sensors) -> list[Sensors]:
    """What the same arm may have measured between two samples: all of the later one but the angles, evenly spread.

    None is needed, and none returned, when no angle differs by more than STRIDE, or when no MOST would do.
    """
    farthest = max(abs(b - a) for a, b in zip(before.theta, now.theta, strict=True))
    count = math.ceil(farthest / STRIDE)
    if count > MOST:
        return []
    steps = []
    for k in range(1, count):
        first, second, third = (a + k / count * (b - a) for a, b in zip(before.theta, now.theta, strict=True))
        steps.append(msgspec.structs.replace(now, theta=(first, second, third)))
    return steps
