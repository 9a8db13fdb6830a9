"""What an AI may do with a cell: three profiles, the queries of each, and the limits of the one that acts."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, Literal, TypeVar, get_args

import msgspec

from dtwin.bus.line.topics import LINE_LOOK, LINE_PREDICT, LINE_PROPOSE, LINE_STATE, LINE_STOP, SET_UP
from dtwin.bus.messages import (
    ACKNOWLEDGE,
    DECIDE,
    IDENTIFY,
    LATCH,
    LOOK,
    PREDICT,
    PROPOSE,
    ROLL_BACK,
    STOP,
    SUMMARY,
    UPLOAD,
)
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.errors import ParameterError
from dtwin.parameters import Gains

Profile = Literal["observe", "propose", "act"]
"""observe changes nothing; propose has a person approve; act changes settings itself, within limits."""
PROFILES: Final[tuple[Profile, ...]] = get_args(Profile)
"""In the order of their rights: each may do what the ones before it may."""
CALLS: Final = 50
"""Number of calls that are answered in a second."""
_LOOKING: Final = (SUMMARY, LOOK, PREDICT, LINE_STATE, LINE_PREDICT, LINE_LOOK)
RIGHTS: Final[dict[Profile, tuple[Topic, ...]]] = {
    "observe": _LOOKING,
    "propose": (*_LOOKING, PROPOSE, LINE_PROPOSE),
    "act": (
        *(*_LOOKING, PROPOSE, UPLOAD, ROLL_BACK, STOP, LATCH, ACKNOWLEDGE, IDENTIFY, DECIDE),
        *(LINE_PROPOSE, SET_UP, LINE_STOP),
    ),
}
"""The queries that each profile may ask; docs/zenoh.md has the same table, and the router of a secured cell."""
M = TypeVar("M", bound=msgspec.Struct)


def may(profile: Profile, needed: Profile) -> bool:
    """Whether a profile may do what another one may."""
    return PROFILES.index(profile) >= PROFILES.index(needed)


def role_of(profile: Profile) -> str:
    """The name of the profile's certificate and of its configuration file."""
    return f"ai-{profile}"


@dataclass(frozen=True)
class Doors:
    """The queries that a profile may ask, whatever a tool is asked for.

    Attributes:
        bus: session with the cell.
        profile: profile that asks.
    """

    bus: Bus
    profile: Profile

    def ask(self, topic: Topic, message: msgspec.Struct | None, reply: type[M]) -> M:
        """The answer of the cell.

        Raises:
            ParameterError: the profile may not ask this.
            CommunicationError: it is refused, or nobody answers.
        """
        if topic not in RIGHTS[self.profile]:
            raise ParameterError(f"{topic.name}: the profile {self.profile} may not ask this")
        return self.bus.ask(topic, message, reply)


@dataclass(frozen=True)
class Limits:
    """How much and how often an AI may change that acts.

    Attributes:
        hourly: number of changes in any hour.
        pause: time between two changes, s.
        factor: largest factor by which a gain, the target time or the mass of a box may change at a time, up or down,
            and by which the boxes/h of a line may fall.
    """

    hourly: int = 12
    pause: float = 5.0
    factor: float = 2.0

    def __post_init__(self) -> None:
        if self.hourly < 1 or not 0.0 <= self.pause < float("inf") or not 1.0 <= self.factor < float("inf"):
            raise ParameterError(
                f"limits: expected at least 1 change an hour, a pause of at least 0 s and a factor of at least 1, got"
                f" {self.hourly}, {self.pause:g} s and {self.factor:g}"
            )


class Allowance:
    """Counts changes against their limits; a stop is not counted.

    Args:
        limits: the limits.
        clock: gives a time that only grows, s.
    """

    def __init__(self, limits: Limits, clock: Callable[[], float]) -> None:
        self.limits = limits
        self._clock = clock
        self._made: deque[float] = deque(maxlen=limits.hourly)

    def count(self) -> None:
        """Counts a change, whether or not it is refused afterwards.

        Raises:
            ParameterError: it is one too many.
        """
        now, made = self._clock(), self._made
        if made and now < made[-1] + self.limits.pause:
            raise ParameterError(f"limit: expected {self.limits.pause:g} s between two changes; wait, then try again")
        if len(made) == self.limits.hourly and now < made[0] + 3600.0:
            raise ParameterError(f"limit: expected at most {self.limits.hourly} changes an hour; ask a person")
        made.append(now)

    def check_step(self, name: str, before: Any, after: Any) -> None:
        """Checks how far a value, or each of several, is changed at a time.

        Raises:
            ParameterError: it is more than the limit; the message says which value.
        """
        pairs = zip(before, after, strict=True) if isinstance(before, tuple) else ((before, after),)
        factor = self.limits.factor
        for old, new in pairs:
            if not (old / factor <= new <= old * factor or old == new):
                low, high = old / factor, old * factor
                raise ParameterError(f"{name}: limit: expected {low:.4g} to {high:.4g} at a time, got {new:.4g}")

    def check_loss(self, name: str, before: float, after: float) -> None:
        """Checks how far something falls at a time of which more is better.

        Raises:
            ParameterError: it is more than the limit.
        """
        least = before / self.limits.factor
        if after < least:
            raise ParameterError(f"{name}: limit: expected at least {least:.4g} at a time, got {after:.4g}")

    def check_gains(self, before: Gains, after: Gains) -> None:
        """Checks how far gains are changed at a time. Raises ParameterError."""
        for name in ("kp", "ki", "kd"):
            self.check_step(name, getattr(before, name), getattr(after, name))


class Rate:
    """Bounds how many calls come in a second, so that a client cannot slow the cell.

    Args:
        most: number of calls in any second.
        clock: gives a time that only grows, s.
    """

    def __init__(self, most: int, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._made: deque[float] = deque(maxlen=most)

    def count(self) -> None:
        """Counts a call.

        Raises:
            ParameterError: it is one too many.
        """
        now, made = self._clock(), self._made
        if len(made) == made.maxlen and now < made[0] + 1.0:
            raise ParameterError(f"too many calls: expected at most {made.maxlen} a second; wait, then try again")
        made.append(now)
