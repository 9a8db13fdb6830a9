"""Rows of evidence as samples come: what commands are beyond their expectation, and what every cause would add."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array
from dtwin.monitoring.chain.expected import EVERY, WINDOW, Expected, Filtered, filtered

NOTHING: Final = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What the samples say of every cause, from the beginning on: sums with a row of zeros before, (N + 1, c).

    Attributes:
        names: the causes.
        along: product of innovation and what a unit of the cause adds.
        power: square of what it adds.
        energy: square of the innovation, (N + 1, 1).
        columns: what a unit of each cause adds to a sample, (N, n, c).
    """

    names: tuple[str, ...]
    along: Array
    power: Array
    energy: Array
    columns: Array

    def over(self, window: int) -> tuple[Array, Array]:
        """Likelihood ratio and size of every cause over the window that ends at every sample, (N, c) each."""
        early = np.maximum(np.arange(1, len(self.along)) - window, 0)
        along, power = (each[1:] - each[early] for each in (self.along, self.power))
        power = np.maximum(power, NOTHING)
        return along**2 / power, along / power

    def between(self, first: int, last: int | NDArray[np.intp]) -> tuple[Array, Array]:
        """The same over the samples from one on and before another one, (c,) each, or before several, (N, c)."""
        along = self.along[last] - self.along[first]
        power = np.maximum(self.power[last] - self.power[first], NOTHING)
        return along**2 / power, along / power

    def alike(self, cause: int, first: int, last: int) -> Array:
        """Cosine between what a cause and every other one add to the samples, (c,)."""
        columns = self.columns[first:last].reshape(-1, len(self.names))
        length = np.maximum(np.linalg.norm(columns, axis=0), NOTHING)
        found: Array = np.abs(columns.T @ columns[:, cause]) / length / length[cause]
        return found


class Gathered:
    """Filters samples as they come, and keeps what they say.

    Args:
        arm: the arm as its data sheet says.
        expected: what is expected of it.
        names: the causes.

    Attributes:
        times: of the filtered samples, (N,), s.
    """

    def __init__(self, arm: Arm, expected: Expected, names: Sequence[str]) -> None:
        self._arm = arm
        self._expected = expected
        self._names = tuple(names)
        self.forget()

    def forget(self) -> None:
        """Begins a new stretch."""
        n = len(self._arm)
        self._rest = np.zeros(0), np.zeros((0, n)), np.zeros((0, n))
        self.times, self._innovation = np.zeros(0), np.zeros((0, n))
        self._columns = np.zeros((0, n, len(self._names)))

    def learned(self, log: Filtered, t: Array, q: Array, effort: Array) -> None:
        """Begins with a log that is filtered already, beside its samples: see `follow`."""
        self._add(log)
        used = EVERY * len(log.t)
        self._rest = t[used:], q[used:], effort[used:]

    def follow(self, t: Array, q: Array, effort: Array) -> int:
        """Takes further samples; how many filtered ones they make.

        Args:
            t: times, (N,), s.
            q: what the encoders read, (N, n).
            effort: what acts at the samples, (N, n).
        """
        rows = [np.concatenate(pair) for pair in zip(self._rest, (t, q, effort), strict=True)]
        made = max(0, (len(rows[0]) - WINDOW) // EVERY + 1)
        if made:
            used = EVERY * (made - 1) + WINDOW
            self._add(filtered(self._arm, *(row[:used] for row in rows)))
        self._rest = rows[0][EVERY * made :], rows[1][EVERY * made :], rows[2][EVERY * made :]
        return made

    def shorten(self, kept: int) -> None:
        """Keeps so many filtered samples."""
        self.times, self._innovation = self.times[-kept:], self._innovation[-kept:]
        self._columns = self._columns[-kept:]

    def power(self, window: int) -> Array:
        """Square of what a unit of every cause adds to the last filtered samples, (c,)."""
        last = self._columns[-window:]
        found: Array = np.einsum("njc,njc->c", last, last)
        return found

    def evidence(self, unknown: str = "") -> Evidence:
        """What the samples say of every cause; of one whose size nobody knows, nothing, and of others without it.

        Args:
            unknown: the cause of which the samples have an unknown part; none if it is "".
        """
        innovation, columns = self._innovation, self._columns
        if unknown:
            part = columns[:, :, self._names.index(unknown)]
            along = np.einsum("nj,njc->c", part, columns) / max(float(np.sum(part**2)), NOTHING)
            innovation = innovation - part * float(np.sum(part * innovation)) / max(float(np.sum(part**2)), NOTHING)
            columns = columns - part[:, :, None] * along
        rows = (
            np.einsum("nj,njc->nc", innovation, columns),
            np.einsum("njc,njc->nc", columns, columns),
            np.sum(innovation**2, axis=1, keepdims=True),
        )
        along, power, energy = (np.vstack([np.zeros((1, each.shape[1])), np.cumsum(each, axis=0)]) for each in rows)
        return Evidence(self._names, along, power, energy, columns)

    def _add(self, log: Filtered) -> None:
        innovation, causes = self._expected.evidence(log)
        columns = np.stack([causes[name] for name in self._names], axis=2)
        self.times = np.concatenate([self.times, log.t])
        self._innovation = np.concatenate([self._innovation, innovation])
        self._columns = np.concatenate([self._columns, columns])
