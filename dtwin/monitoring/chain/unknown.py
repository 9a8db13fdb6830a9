"""Loads that nobody has weighed: one from when the gripper has closed until it opens.

What such a load would explain of the commands counts for nothing, neither in them nor in what anything else would add
(a nuisance parameter, projected out of both).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Array

Indices = NDArray[np.intp]
NOTHING: Final = 1e-12


def starts_of(held: Indices) -> Indices:
    """First samples of stretches with one number of what is held each, by the numbers of all, (N,)."""
    starts: Indices = np.flatnonzero(np.diff(held, prepend=-1))
    return starts


@dataclass(frozen=True, slots=True, eq=False)
class Shared:
    """What the unknown loads of stretches, one each, explain of causes and of the innovation, as samples come.

    Attributes:
        stretch: number of a row's stretch, (N,).
        cross: product of what a unit of the load and of each cause adds, summed over the stretch up to a row and with
            it, (N, c); the innovation is the last one.
        power: square of what a unit of the load adds, summed alike, (N, 1).
        last: last row of a row's stretch, (N,).
        along: what earlier stretches explain of the product of innovation and cause, (N, c).
        square: and of the square of the cause, (N, c).
    """

    stretch: Indices
    cross: Array
    power: Array
    last: Indices
    along: Array
    square: Array

    @classmethod
    def of(cls, part: Array, columns: Array, starts: Indices) -> Shared:
        """From what a unit of each load, (N, n), and of each cause, (N, n, c), adds, and first rows of stretches."""
        ends = np.append(starts[1:], len(part))
        stretch = np.repeat(np.arange(len(starts)), ends - starts)
        cross, power = (
            _within(np.einsum("nj,njc->nc", part, each), starts, stretch) for each in (columns, part[:, :, None])
        )
        last = (ends - 1)[stretch]
        whole = cross[ends - 1] / np.maximum(power[ends - 1], NOTHING)
        sums = (each * whole for each in (cross[ends - 1, -1:], cross[ends - 1]))
        along, square = ((np.cumsum(each, axis=0) - each)[stretch] for each in sums)
        return cls(stretch, cross, power, last, along, square)

    def between(self, first: int | Indices, last: int | Indices) -> tuple[Array, Array]:
        """What loads explain over the rows from some on and before others, (c,) or (N, c): see `along`, `square`.

        A load is known by all rows of its stretch before the last one, as when that came.
        """
        begin, end = np.broadcast_arrays(np.asarray(first), np.asarray(last) - 1)
        inside = (self.stretch[begin] == self.stretch[end])[..., None]
        before = self.cross[begin] - self._own(begin)
        cross = self.cross[end] - np.where(inside, before, 0.0)
        scale = 1.0 / np.maximum(self.power[end], NOTHING)
        along, square = cross * self.cross[end, -1:] * scale, cross**2 * scale
        over = self.last[begin]
        cross, scale = self.cross[over] - before, 1.0 / np.maximum(self.power[over], NOTHING)
        whole = self.cross[over]
        earlier = (
            (cross - whole) * whole[..., -1:] * scale + self.along[end] - self.along[begin],
            (cross**2 - whole**2) * scale + self.square[end] - self.square[begin],
        )
        return along + np.where(inside, 0.0, earlier[0]), square + np.where(inside, 0.0, earlier[1])

    def _own(self, rows: Indices) -> Array:
        """What each row adds to the sums of its stretch."""
        before = np.maximum(rows - 1, 0)
        follows = (rows > 0) & (self.stretch[before] == self.stretch[rows])
        return self.cross[rows] - np.where(follows[..., None], self.cross[before], 0.0)


def _within(values: Array, starts: Indices, stretch: Indices) -> Array:
    """Sums over each stretch up to a row and with it."""
    total = np.cumsum(values, axis=0)
    return total - (total[starts] - values[starts])[stretch]


def without(part: Array, starts: Indices, columns: Array) -> Array:
    """Columns, (N, n, c), without what the load of each stretch explains of them, a unit of which adds (N, n)."""
    power = np.maximum(np.add.reduceat(np.sum(part**2, axis=1), starts), NOTHING)
    common = np.add.reduceat(np.einsum("nj,njc->nc", part, columns), starts, axis=0) / power[:, None]
    lengths = np.diff(np.append(starts, len(part)))
    found: Array = columns - part[:, :, None] * np.repeat(common, lengths, axis=0)[:, None, :]
    return found
