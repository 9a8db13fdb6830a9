"""Puts together what belongs to the same tick and comes from different senders, in whatever order."""

from __future__ import annotations

from typing import Final, Generic, Protocol, TypeVar

WAITING: Final = 1000
"""ticks that one half may wait for the other"""


class Numbered(Protocol):
    """Has the number of its tick."""

    @property
    def sequence(self) -> int: ...


A = TypeVar("A", bound=Numbered)
B = TypeVar("B", bound=Numbered)


class Pairs(Generic[A, B]):
    """Two streams of messages; of each, the newest `WAITING` wait for their other half, then they are forgotten."""

    def __init__(self) -> None:
        self._firsts: dict[int, A] = {}
        self._seconds: dict[int, B] = {}

    def first(self, item: A) -> tuple[A, B] | None:
        """The pair that a message of the first stream completes."""
        other = self._seconds.pop(item.sequence, None)
        if other is not None:
            return item, other
        _keep(self._firsts, item)
        return None

    def second(self, item: B) -> tuple[A, B] | None:
        """The pair that a message of the second stream completes."""
        other = self._firsts.pop(item.sequence, None)
        if other is not None:
            return other, item
        _keep(self._seconds, item)
        return None

    def clear(self) -> None:
        """Forgets what waits."""
        self._firsts.clear()
        self._seconds.clear()


N = TypeVar("N", bound=Numbered)


def _keep(waiting: dict[int, N], item: N) -> None:
    waiting[item.sequence] = item
    while len(waiting) > WAITING:
        del waiting[next(iter(waiting))]
