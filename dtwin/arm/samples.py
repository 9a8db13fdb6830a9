"""Samples of an arm one after the other, as monitors take them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from dtwin.arm.chain import Array


class Samples(NamedTuple):
    """Samples a period of the arm apart.

    Attributes:
        t: their times, (N,), s.
        q: what the encoders read, (N, n), rad or m.
        target: desired positions, (N, n).
        effort: what acts at the samples, (N, n), in the units of the drives, or the torque of drives that take a
            position; NaN where nobody knows what the arm carries.
        acting: the same, also there.
    """

    t: Array
    q: Array
    target: Array
    effort: Array
    acting: Array

    def rows(self, chosen: slice) -> Samples:
        """Some of them."""
        return Samples(*(each[chosen] for each in self))

    def parts(self, count: int) -> Iterator[Samples]:
        """All of them in their order, so many at once."""
        return (self.rows(slice(first, first + count)) for first in range(0, len(self.t), count))
