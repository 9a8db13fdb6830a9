"""How long the arm of a station takes, as its own work shows: no rehearsal knows the friction that makes it wait.

What is used is what a tick tells: whether a box waits for an arm that is ready, for which place, and whether the
gripper is closed.
"""

from __future__ import annotations

from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from statistics import mean, median
from typing import Final, TypeVar

from dtwin.line.station import WorkTimes

Key = TypeVar("Key", str, tuple[str, int])
"""A place, or a place and the number of a class of boxes."""
_ENOUGH: Final = 2
"""Number of boxes after which what was measured counts more than a rehearsal."""
_LAST: Final = 20
"""Number of the last boxes that count."""
_NEWEST: Final = 5
"""Number of those that count alone once they took otherwise than the ones before."""
_OTHERWISE: Final = 0.05
"""Share by which they do."""
_IDLE: Final = 2.0
"""Share of the rehearsed way back from which on an arm is taken to have waited for a box."""


class MeasuredWork:
    """Times that an arm has taken for its last boxes.

    Args:
        places: names of its places, the first one for boxes of the number 1.
        period: time of a tick, s.
    """

    def __init__(self, places: tuple[str, ...], period: float) -> None:
        self._places, self._period = places, period
        self._grips: deque[float] = deque(maxlen=_LAST)
        self._carries: dict[str, deque[tuple[int, float]]] = defaultdict(lambda: deque(maxlen=_LAST))
        self._backs: dict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_LAST))
        self._first: dict[tuple[str, int], float] = {}
        self._kind = 0
        self.interrupt()

    def interrupt(self) -> None:
        """Takes note that what is going on now tells nothing: the arm is stopped, or ticks are missing."""
        self._ticks = 0
        self._offered: int | None = None
        self._gripped: int | None = None
        self._released: int | None = None
        self._place = ""

    def follow(self, ticks: Iterable[tuple[int, bool]], kind: int = 0) -> None:
        """Follows the next ticks, so few that an arm which holds a box at their end has not brought the next one.

        Args:
            ticks: of each the number of the place of the box that waits for the arm, from 1, 0 for none, and whether
                the gripper is closed.
            kind: number of the class of mass of the box that the arm has, or is offered, at their end.
        """
        for box, grips in ticks:
            self._ticks += 1
            if self._gripped is not None:
                if not grips:
                    self._carried(self._since(self._gripped))
                    self._gripped, self._released = None, self._ticks
            elif grips:
                if self._offered is not None:
                    self._grips.append(self._since(self._offered))
                    self._gripped = self._ticks
                self._offered = None
            elif box and self._offered is None:
                if self._released is not None:
                    self._backs[self._place].append(self._since(self._released))
                self._offered, self._released, self._place = self._ticks, None, self._places[box - 1]
            elif not box:
                self._offered = None
        self._kind = kind

    def _carried(self, time: float) -> None:
        self._carries[self._place].append((self._kind, time))
        carries = self._carried_to(self._place, self._kind)
        if len(carries) == _NEWEST:
            self._first.setdefault((self._place, self._kind), median(carries))

    def _carried_to(self, place: str, kind: int) -> list[float]:
        """Times of the last boxes of a class to a place."""
        return [time for each, time in self._carries[place] if each == kind]

    @property
    def slowness(self) -> float | None:
        """How many times as long as the first boxes the newest ones took, for the place and the class of boxes where
        that has changed most; None before enough of one class were brought to one place."""
        told = {each: self._carried_to(*each) for each in self._first}
        factors = (_newest(times) / self._first[each] for each, times in told.items() if times)
        return max(factors, key=lambda factor: abs(factor - 1.0), default=None)

    def times(self, rehearsed: WorkTimes) -> WorkTimes:
        """How long the arm takes; to places to which it has brought too few boxes as much longer as to the others."""
        grip = _usual(self._grips) if len(self._grips) >= _ENOUGH else rehearsed.grip
        busy = {
            place: [each for each in self._backs[place] if each <= _IDLE * back]
            for place, back in rehearsed.back.items()
        }
        backs = {place: _usual(last) for place, last in busy.items() if len(last) >= _ENOUGH}
        carries = {
            place: mean(_usual(self._carried_to(place, kind)) for kind, _ in last)
            for place, last in self._carries.items()
            if len(last) >= _ENOUGH
        }
        classes = {
            (place, kind): _usual(told)
            for place in rehearsed.carry
            for kind in {each for each, _ in self._carries[place]}
            if len(told := self._carried_to(place, kind)) >= _ENOUGH
        }
        carry, back = _everywhere(carries, rehearsed.carry), _everywhere(backs, rehearsed.back)
        return WorkTimes(grip, carry, back, _everywhere(classes, rehearsed.classes) | classes)

    def _since(self, tick: int) -> float:
        return (self._ticks - tick) * self._period


def _everywhere(known: Mapping[Key, float], rehearsed: Mapping[Key, float]) -> dict[Key, float]:
    """Measured times by the place, or by the place and the class of boxes; where there is none, the rehearsed one as
    many times as long as elsewhere."""
    known = {each: time for each, time in known.items() if each in rehearsed}
    longer = median([known[each] / rehearsed[each] for each in known]) if known else 1.0
    return {each: known.get(each, longer * time) for each, time in rehearsed.items()}


def _usual(last: Sequence[float]) -> float:
    """The median of the last times, or of the newest alone if the arm has become slower or faster with them."""
    whole, newest = median(last), _newest(last)
    return newest if abs(newest - whole) > _OTHERWISE * whole else whole


def _newest(last: Sequence[float]) -> float:
    return median(list(last)[-_NEWEST:])
