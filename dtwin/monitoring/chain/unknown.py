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
    """What causes have in common with the unknown loads of stretches, one load each, in units of the noise.

    Attributes:
        before: sum over the rows of a row's stretch before it, (N, c).
        after: the same with the row itself.
        whole: sum over all of its stretch.
        done: squares of such sums of all stretches before its own.
    """

    before: Array
    after: Array
    whole: Array
    done: Array

    @classmethod
    def of(cls, part: Array, columns: Array, starts: Indices) -> Shared:
        """From what a unit of each load, (N, n), and of each cause, (N, n, c), adds, and the first rows of stretches."""
        power = np.add.reduceat(np.sum(part**2, axis=1), starts)
        scale = np.where(power > 0.0, 1.0 / np.sqrt(np.maximum(power, NOTHING)), 0.0)
        ends = np.append(starts[1:], len(part))
        own = np.repeat(np.arange(len(starts)), ends - starts)
        cross = np.einsum("nj,njc->nc", part, columns) * scale[own, None]
        total = np.vstack([np.zeros((1, cross.shape[1])), np.cumsum(cross, axis=0)])
        sums = total[ends] - total[starts]
        squares = np.cumsum(sums**2, axis=0) - sums**2
        return cls(total[:-1] - total[starts][own], total[1:] - total[starts][own], sums[own], squares[own])

    def between(self, first: int | Indices, last: int | Indices) -> Array:
        """Power of causes that act from some rows on and before others that the loads explain, (c,) or (N, c)."""
        end = np.asarray(last) - 1
        same = self.done[end] == self.done[first]
        inside = (self.after[end] - self.before[first]) ** 2
        middle = self.done[end] - self.done[first] - self.whole[first] ** 2
        across = (self.whole[first] - self.before[first]) ** 2 + middle + self.after[end] ** 2
        found: Array = np.where(same, inside, across)
        return found


def without(part: Array, starts: Indices, columns: Array) -> Array:
    """Columns, (N, n, c), without what the load of each stretch explains of them, a unit of which adds (N, n)."""
    power = np.maximum(np.add.reduceat(np.sum(part**2, axis=1), starts), NOTHING)
    common = np.add.reduceat(np.einsum("nj,njc->nc", part, columns), starts, axis=0) / power[:, None]
    lengths = np.diff(np.append(starts, len(part)))
    found: Array = columns - part[:, :, None] * np.repeat(common, lengths, axis=0)[:, None, :]
    return found
