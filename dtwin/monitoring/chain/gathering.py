"""Rows of evidence as samples come: what commands are beyond their expectation, and what every cause would add.

What the gripper holds is one load from when it has closed until it opens: see `unknown`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.monitoring.chain.expected import EVERY, WINDOW, Expected, Filtered, filtered
from dtwin.monitoring.chain.unknown import NOTHING, Indices, Shared, starts_of, without

_LEFT: Final = 1e-6
"""Part of the power of a cause that has to be left beside an unknown load: less is rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """What the samples say of every cause, from the beginning on: sums with a row of zeros before, (N + 1, c + 1).

    The last one of what counts as a cause is the innovation itself.

    Attributes:
        names: the causes.
        along: product of innovation and what a unit of the cause adds.
        power: square of what it adds.
        columns: what a unit of each cause adds to a sample, (N, n, c + 1).
        part: what a unit of an unknown load adds, (N, n).
        starts: first rows of stretches with one load each.
        shared: what these loads explain; None where nothing is held.
    """

    names: tuple[str, ...]
    along: Array
    power: Array
    columns: Array
    part: Array
    starts: Indices
    shared: Shared | None

    def over(self, window: int) -> tuple[Array, Array]:
        """Likelihood ratio and size of every cause over the window that ends at every sample, (N, c) each."""
        last = np.arange(1, len(self.along))
        return self.between(np.maximum(last - window, 0), last)

    def between(self, first: int | Indices, last: int | Indices) -> tuple[Array, Array]:
        """The same over the samples from one on and before another one, (c,) each, or before several, (N, c)."""
        along, power = (each[..., :-1] for each in self._sums(first, last))
        return along**2 / power, along / power

    def left(self, cause: int, size: float, acts: tuple[int, int], samples: tuple[int, int]) -> float:
        """Square of what a cause that acts over some samples and the unknown loads leave of the innovation.

        Args:
            cause: its number.
            size: its size.
            acts: its first sample, and the one after its last.
            samples: those that count alike.
        """
        first, last = samples
        rest = self.columns[:last, :, -1].copy()
        rest[slice(*acts)] -= size * self.columns[slice(*acts), :, cause]
        if self.shared is not None:
            rest = without(self.part[:last], self.starts[self.starts < last], rest[:, :, None])[:, :, 0]
        return float(np.sum(rest[first:] ** 2))

    def edged(self, cause: int, acts: tuple[int, int], samples: tuple[int, int]) -> tuple[float, float]:
        """A cause that begins and ends within filtered samples, each of which then has a part of it alone.

        Args:
            cause: its number.
            acts: its first sample, and the one after its last.
            samples: those that count alike.

        Returns:
            how much more of the square of the innovation it explains, beside unknown loads, with the samples at its
            ends free, and its size between.
        """
        (first, last), (begin, end) = samples, acts
        ends = [row for row in (begin - 1, begin, end - 1, end) if first <= row < last]
        acting = np.zeros((last, 3 + len(ends)))
        acting[:, 0] = 1.0  # the innovation
        acting[begin:end, 1] = 1.0
        acting[begin + 1 : end - 1, 2] = 1.0
        acting[ends, np.arange(3, 3 + len(ends))] = 1.0
        columns = self.columns[:last, :, [-1] + [cause] * (2 + len(ends))] * acting[:, None, :]
        if self.shared is not None:
            columns = without(self.part[:last], self.starts[self.starts < last], columns)
        innovation, whole, *free = columns[first:].reshape(-1, columns.shape[2]).T
        explained = float(innovation @ whole) ** 2 / max(float(whole @ whole), NOTHING)
        parts = np.array(free).T
        sizes = np.linalg.lstsq(parts, innovation)[0]
        return float(innovation @ parts @ sizes) - explained, float(sizes[0])

    def seen(self, first: int, last: int) -> Array:
        """Square of what a unit of each cause adds to samples beside unknown loads, (c,)."""
        power = self._sums(first, last)[1][:-1]
        return np.where(np.isfinite(power), power, 0.0)

    def _sums(self, first: int | Indices, last: int | Indices) -> tuple[Array, Array]:
        """Product of innovation and cause, and square of the cause, inf where unknown loads explain all of it."""
        along, power = (each[last] - each[first] for each in (self.along, self.power))
        if self.shared is None:
            return along, np.maximum(power, NOTHING)
        explained = self.shared.between(first, last)
        left = power - explained[1]
        return along - explained[0], np.where(left > np.maximum(_LEFT * power, NOTHING), left, np.inf)

    def alike(self, cause: int, first: int, last: int) -> Array:
        """Cosine between what a cause and every other one add to the samples beside unknown loads, (c,)."""
        columns = self.columns[:last, :, :-1]
        if self.shared is not None:
            columns = without(self.part[:last], self.starts[self.starts < last], columns)
        columns = columns[first:].reshape(-1, len(self.names))
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
        self._rest = np.zeros(0), np.zeros((0, n)), np.zeros((0, n)), np.zeros(0, dtype=np.intp)
        self.times, self._innovation = np.zeros(0), np.zeros((0, n))
        self._columns, self._held = np.zeros((0, n, len(self._names))), np.zeros(0, dtype=np.intp)

    def learned(self, log: Filtered, t: Array, q: Array, effort: Array, held: Indices) -> None:
        """Begins with a log that is filtered already, beside its samples: see `follow`."""
        self._add(log)
        used = EVERY * len(log.t)
        self._rest = t[used:], q[used:], effort[used:], held[used:]

    def follow(self, t: Array, q: Array, effort: Array, held: Indices) -> int:
        """Takes further samples; how many filtered ones they make.

        Args:
            t: times, (N,), s.
            q: what the encoders read, (N, n).
            effort: what acts at the samples, (N, n); NaN where it does not count.
            held: number of what the gripper holds, (N,); 0 for nothing.
        """
        rest = zip(self._rest, (t, q, effort, held), strict=True)
        t, q, effort, held = (np.concatenate(pair) for pair in rest)
        made = max(0, (len(t) - WINDOW) // EVERY + 1)
        if made:
            used = EVERY * (made - 1) + WINDOW
            self._add(filtered(self._arm, t[:used], q[:used], effort[:used], held[:used]))
        rows = slice(EVERY * made, None)
        self._rest = t[rows], q[rows], effort[rows], held[rows]
        return made

    def shorten(self, kept: int) -> None:
        """Keeps so many filtered samples."""
        self.times, self._innovation = self.times[-kept:], self._innovation[-kept:]
        self._columns, self._held = self._columns[-kept:], self._held[-kept:]

    def power(self, windows: Sequence[int]) -> list[Array]:
        """Square of what a unit of every cause adds to the last filtered samples, (c,), over several windows."""
        count = len(self.times)
        if not count:
            return [np.zeros(len(self._names)) for _ in windows]
        evidence = self.evidence()
        return [evidence.seen(max(0, count - window), count) for window in windows]

    def evidence(self) -> Evidence:
        """What the samples say of every cause beside any load in the gripper."""
        columns = np.concatenate([self._columns, self._innovation[:, :, None]], axis=2)
        carried = columns[:, :, self._names.index("load")]
        part, starts = np.where(self._held[:, None] > 0, carried, 0.0), starts_of(self._held)
        rows = np.einsum("nj,njc->nc", self._innovation, columns), np.einsum("njc,njc->nc", columns, columns)
        along, power = (np.vstack([np.zeros((1, each.shape[1])), np.cumsum(each, axis=0)]) for each in rows)
        shared = Shared.of(part, columns, starts) if self._held.any() else None
        return Evidence(self._names, along, power, columns, part, starts, shared)

    def _add(self, log: Filtered) -> None:
        innovation, causes = self._expected.evidence(log)
        columns = np.stack([causes[name] for name in self._names], axis=2)
        self.times = np.concatenate([self.times, log.t])
        self._innovation = np.concatenate([self._innovation, innovation])
        self._columns = np.concatenate([self._columns, columns])
        self._held = np.concatenate([self._held, log.held])
