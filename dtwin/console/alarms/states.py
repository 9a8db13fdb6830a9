"""The states of an alarm and what changes them (ANSI/ISA-18.2-2016 and IEC 62682:2014, clause 5.2).

An alarm's condition comes and goes by itself; an operator acknowledges it, or shelves it until a given time; design
suppresses it while it means nothing. What is shelved or suppressed is not shown, but its condition is followed: an
alarm that is still active when it comes back is unacknowledged again. No alarm here latches, and none is taken out of
service: these states of the standards do not occur.
"""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated, Final, Literal, get_args

import msgspec

from dtwin.errors import ParameterError
from dtwin.signals import Line, Seconds

Priority = Literal["low", "medium", "high"]
PRIORITIES: Final[tuple[Priority, ...]] = get_args(Priority)
"""From the least to the most urgent."""
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=100)]


class AlarmState(StrEnum):
    """The states, in the words of the standards."""

    NORMAL = "normal"
    UNACKNOWLEDGED = "unacknowledged"
    ACKNOWLEDGED = "acknowledged"
    RETURNED = "returned to normal unacknowledged"
    SHELVED = "shelved"
    SUPPRESSED = "suppressed by design"


class Alarm(msgspec.Struct, frozen=True):
    """An alarm as it is now.

    Attributes:
        name: Name that no other alarm has.
        text: What is wrong, in words.
        priority: Urgency.
        response: What the operator has to do.
        active: Whether its condition holds.
        unacknowledged: Whether an operator has yet to acknowledge it.
        raised: Wall time at which the condition last began, s since 1970.
        plant: Plant time of that, s.
        cleared: Wall time at which the condition last ended; None while it has not.
        shelved_until: Wall time at which it comes back off the shelf; None when it is not shelved.
        suppressed: Reason for which design suppresses it, "" if it does not.
        first_out: Whether it began while no other alarm was standing.
        count: Number of times that the condition began.
    """

    name: Name
    text: Line
    priority: Priority = "medium"
    response: Line = ""
    active: bool = False
    unacknowledged: bool = False
    raised: float = 0.0
    plant: Seconds = 0.0
    cleared: float | None = None
    shelved_until: float | None = None
    suppressed: Line = ""
    first_out: bool = False
    count: int = 0

    @property
    def state(self) -> AlarmState:
        """The state; suppression by design goes before a shelf."""
        if self.suppressed:
            return AlarmState.SUPPRESSED
        if self.shelved_until is not None:
            return AlarmState.SHELVED
        if self.active:
            return AlarmState.UNACKNOWLEDGED if self.unacknowledged else AlarmState.ACKNOWLEDGED
        return AlarmState.RETURNED if self.unacknowledged else AlarmState.NORMAL

    @property
    def hidden(self) -> bool:
        """Whether it is kept from the operator: shelved, or suppressed by design."""
        return bool(self.suppressed) or self.shelved_until is not None

    @property
    def standing(self) -> bool:
        """Whether it is on the operator's list."""
        return not self.hidden and (self.active or self.unacknowledged)


def raised(alarm: Alarm, at: float, plant: float) -> Alarm:
    """The alarm when its condition begins, or grows worse."""
    return msgspec.structs.replace(
        alarm,
        active=True,
        unacknowledged=not alarm.hidden,
        raised=at,
        plant=plant,
        cleared=None,
        count=alarm.count + 1,
    )


def cleared(alarm: Alarm, at: float) -> Alarm:
    """The alarm when its condition ends."""
    return msgspec.structs.replace(alarm, active=False, cleared=at)


def acknowledged(alarm: Alarm) -> Alarm:
    """The alarm when an operator has acknowledged it.

    Raises:
        ParameterError: There is nothing to acknowledge.
    """
    if not alarm.unacknowledged:
        raise ParameterError(f"{alarm.name}: nothing to acknowledge, the alarm is {alarm.state}")
    return msgspec.structs.replace(alarm, unacknowledged=False)


def shelved(alarm: Alarm, until: float) -> Alarm:
    """The alarm on the shelf until a wall time, s since 1970; being put there acknowledges it."""
    return msgspec.structs.replace(alarm, shelved_until=until, unacknowledged=False)


def unshelved(alarm: Alarm) -> Alarm:
    """The alarm off the shelf.

    Raises:
        ParameterError: It is not shelved.
    """
    if alarm.shelved_until is None:
        raise ParameterError(f"{alarm.name}: expected a shelved alarm, it is {alarm.state}")
    return _back(msgspec.structs.replace(alarm, shelved_until=None))


def suppressed(alarm: Alarm, reason: str) -> Alarm:
    """The alarm suppressed by design."""
    return msgspec.structs.replace(alarm, suppressed=reason, unacknowledged=False)


def unsuppressed(alarm: Alarm) -> Alarm:
    """The alarm that design suppresses no more."""
    return _back(msgspec.structs.replace(alarm, suppressed=""))


def _back(alarm: Alarm) -> Alarm:
    """An alarm that may be shown again: if its condition holds, it is new to the operator."""
    return msgspec.structs.replace(alarm, unacknowledged=alarm.active and not alarm.hidden)
