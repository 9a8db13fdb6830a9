"""How long the arm of a station takes, as its own work shows: no rehearsal knows the friction that makes it wait.

What is used is what a tick tells: whether a box waits for the arm, for which place, and whether the gripper is
closed. A box may wait while the arm is still on its way back: then both together are known, and neither alone.
"""

from __future__ import annotations

import itertools
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Mapping, Sequence
from statistics import mean, median
from typing import Final, NamedTuple, TypeVar

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
_NEWS: Final = 2
"""Number of ticks that are alike after which further ones tell nothing new but that time has passed."""
_PROMPT: Final = 0.05
"""Time by which an arm that was back may grip a box later than usual, s."""


class _Turn(NamedTuple):
    """What was seen between two boxes.

    Attributes:
        place: name of the place from which the arm came back.
        idle: time from when the box before it was there until the next one was offered, s.
        grip: time from then until it was held, s.
    """

    place: str
    idle: float
    grip: float


class MeasuredWork:
    """Times that an arm has taken for its last boxes.

    Args:
        places: names of its places, the first one for boxes of the number 1.
        period: time of a tick, s.
    """

    def __init__(self, places: tuple[str, ...], period: float) -> None:
        self._places, self._period = places, period
        self._turns: deque[_Turn] = deque(maxlen=_LAST * len(places))
        self._carries: dict[str, deque[tuple[int, float]]] = defaultdict(lambda: deque(maxlen=_LAST))
        self._first: dict[tuple[str, int], float] = {}
        self._kind = 0
        self.interrupt()

    def interrupt(self) -> None:
        """Takes note that what is going on now tells nothing: the arm is stopped, or ticks are missing."""
        self._ticks = 0
        self._offered: int | None = None
        self._gripped: int | None = None
        self._released: int | None = None
        self._place = self._from = ""

    def follow(self, ticks: Iterable[tuple[int, bool]], kind: int = 0) -> None:
        """Follows the next ticks, so few that an arm which holds a box at their end has not brought the next one.

        Args:
            ticks: of each the number of the place of the box that waits for the arm, from 1, 0 for none, and whether
                the gripper is closed.
            kind: number of the class of mass of the box that the arm has, or is offered, at their end.
        """
        for (box, grips), alike in itertools.groupby(ticks):
            count = len(list(alike))
            for _ in range(min(count, _NEWS)):
                self._ticks += 1
                self._tick(box, grips)
            self._ticks += max(0, count - _NEWS)
        self._kind = kind

    def _tick(self, box: int, grips: bool) -> None:
        if self._gripped is not None:
            if not grips:
                self._carried(self._since(self._gripped))
                self._gripped, self._released, self._from = None, self._ticks, self._place
        elif grips:
            if self._offered is not None:
                self._turned(self._offered)
                self._gripped = self._ticks
            self._offered = self._released = None
        elif box and self._offered is None:
            self._offered, self._place = self._ticks, self._places[box - 1]
        elif not box:
            self._offered = None

    def _turned(self, offered: int) -> None:
        if self._released is not None:
            idle = (offered - self._released) * self._period
            self._turns.append(_Turn(self._from, idle, self._since(offered)))

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
        grip = self._grip(rehearsed)
        seen = {place: self._back(place, grip, rehearsed) for place in rehearsed.back}
        backs = {place: time for place, time in seen.items() if time is not None}
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

    def _grip(self, rehearsed: WorkTimes) -> float:
        """How long an arm that waits takes to grip a box, s."""
        waited = [turn.grip for turn in self._turns if turn.idle >= _IDLE * rehearsed.back.get(turn.place, math.inf)]
        return _usual(waited) if len(waited) >= _ENOUGH else rehearsed.grip

    def _back(self, place: str, grip: float, rehearsed: WorkTimes) -> float | None:
        """How long it takes from a place until it waits, s; None where that was not seen.

        Where it was back before the next box was offered, it is known to have taken no longer.
        """
        turns = [turn for turn in self._turns if turn.place == place]
        late = [turn.idle + turn.grip - grip for turn in turns if turn.grip > grip + _PROMPT]
        prompt = [turn.idle for turn in turns if turn.grip <= grip + _PROMPT]
        found = _usual(late) if len(late) >= _ENOUGH else None
        if len(prompt) >= _ENOUGH and (most := _newest(prompt)) < (found or rehearsed.back[place]):
            return most
        return found

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
