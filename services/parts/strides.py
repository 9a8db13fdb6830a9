"""From one sample to a later one in steps that an arm can make."""

from __future__ import annotations

import math
from typing import Final

import msgspec

from dtwin.parameters import PERIOD
from dtwin.services.parts.gate import STALE
from dtwin.signals import Sensors

STRIDE: Final = 0.04
"""rad of a joint between two samples, 4 rad/s: less than the observer's gate takes for a jump (STATE_OBSERVER_3)"""
GAP: Final = round(STALE / PERIOD)
"""Number of ticks without an answer, or without voltage, up to which the blocks are led over each; after more of them
the path is planned anew."""
MOST: Final = 500
"""steps: an arm that is farther away is given up"""


def strides(before: Sensors, now: Sensors) -> list[Sensors]:
    """What the same arm may have measured between two samples: all of the later one but the angles, evenly spread.

    There is one for each tick that was missed, so that the blocks see the arm as fast as it is and their time is that
    of the plant, and more where an angle would differ by more than STRIDE; none when more than MOST would be needed.
    """
    farthest = max(abs(b - a) for a, b in zip(before.theta, now.theta, strict=True))
    count = max(math.ceil(farthest / STRIDE), min(now.sequence - before.sequence, GAP))
    if count > MOST:
        return []
    steps = []
    for k in range(1, count):
        theta = tuple(a + k / count * (b - a) for a, b in zip(before.theta, now.theta, strict=True))
        steps.append(msgspec.structs.replace(now, theta=theta))
    return steps
