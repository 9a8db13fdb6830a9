"""Rates of what is sampled, by central differences that lose next to nothing of quick motion (Fornberg 1988)."""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Array

_WEIGHTS: Final = {2: ((8.0, -1.0), 12.0), 3: ((45.0, -9.0, 1.0), 60.0)}
"""Weights of the differences from sample -k to sample k, k = 1, 2, ..., and their common divisor, by the reach."""


def rates(columns: Array, dt: float, reach: int = 3) -> Array:
    """Derivative of columns along the first axis, (N, ...).

    The difference of two neighbours loses (w dt)^2 / 6 of an oscillation w: at 5 Hz and 100 samples a second 1.6 % of
    a velocity and 3.2 % of an acceleration, which is told as friction or inertia. Here it is (w dt)^4 / 30, and
    (w dt)^6 / 140 with a reach of 3. The first and last samples have neighbours alone.

    Args:
        columns: samples.
        dt: time from one to the next, s.
        reach: how many samples before and after one it needs, 2 or 3.
    """
    found: Array = np.gradient(columns, dt, axis=0)
    count = len(columns)
    if count > 2 * reach:
        weights, whole = _WEIGHTS[reach]
        inner = np.zeros_like(found[reach:-reach])
        for k, weight in enumerate(weights, 1):
            inner += weight * (columns[reach + k : count - reach + k] - columns[reach - k : count - reach - k])
        found[reach:-reach] = inner / (whole * dt)
    return found
