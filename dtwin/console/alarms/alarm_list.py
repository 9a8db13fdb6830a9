"""The alarms of a cell: raised and cleared by what the cell says, acknowledged and shelved by operators."""

from __future__ import annotations

import math
from collections import deque
from typing import Final

import msgspec

from dtwin.console.alarms import states
from dtwin.console.alarms.journal import Action, Change, Journal
from dtwin.console.alarms.states import PRIORITIES, Alarm, AlarmState, Priority
from dtwin.errors import ParameterError

MOST: Final = 500
"""Number of alarms that are followed; names come from the cell, and could be many."""
FLOOD: Final = 10
"""Number of annunciations in `WINDOW` above which a flood begins (ISA-18.2, table of performance metrics)."""
FLOOD_OVER: Final = 5
"""Number below which it ends."""
WINDOW: Final = 600.0
"""Time over which annunciations are counted, s."""
LONGEST_SHELF: Final = 8 * 3600.0
"""Longest time on the shelf, s: a shift."""


class AlarmList:
    """All alarms by name, and their history.

    Times `at` are wall time in s since 1970; they may not go back.

    Args:
        journal: Journal, from which earlier alarms are taken.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._alarms: dict[str, Alarm] = {}
        self._suppressing: dict[str, str] = {}
        self._told: deque[float] = deque()
        self._flood = False
        for change in journal.changes:
            self._alarms[change.alarm.name] = change.alarm
            if _annunciates(change):
                self._told.append(change.at)

    @property
    def trouble(self) -> str:
        """Why the newest changes are not in the journal's file, "" if they are."""
        return self._journal.trouble

    @property
    def history(self) -> list[Change]:
        """All changes that are kept, oldest first."""
        return self._journal.changes

    def alarm(self, name: str) -> Alarm:
        """The alarm of a name.

        Raises:
            ParameterError: There is none.
        """
        try:
            return self._alarms[name]
        except KeyError:
            raise ParameterError(f"{name!r} is no alarm of this cell") from None

    def alarms(self) -> list[Alarm]:
        """All alarms that are not normal: the unacknowledged first, then the most urgent, then the newest."""
        found = [alarm for alarm in self._alarms.values() if alarm.state is not AlarmState.NORMAL]
        return sorted(
            found, key=lambda a: (a.hidden, not a.unacknowledged, -PRIORITIES.index(a.priority), -a.raised, a.name)
        )

    def raise_(
        self, name: str, text: str, at: float, plant: float, *, priority: Priority = "medium", response: str = ""
    ) -> None:
        """Follows a condition that holds; one that grows more urgent is new to the operator."""
        before = self._alarms.get(name)
        if before is None:
            if len(self._alarms) >= MOST and not self._forget():
                return
            self._alarms[name] = Alarm(name, text[:1000], priority, response[:1000])
            self._follow_design(self._alarms[name], at)
            before = self._alarms[name]
        now = msgspec.structs.replace(before, text=text[:1000], priority=priority, response=response[:1000])
        worse = PRIORITIES.index(priority) > PRIORITIES.index(before.priority)
        if not before.active or worse:
            first = not now.hidden and not any(other.standing for other in self._alarms.values() if other != before)
            raised = states.raised(now, at, plant)
            self._put("raised", msgspec.structs.replace(raised, first_out=first or before.first_out), at)
        elif now != before:
            self._put("changed", now, at)

    def clear(self, name: str, at: float) -> None:
        """Follows a condition that no longer holds; one that did not hold changes nothing."""
        before = self._alarms.get(name)
        if before is not None and before.active:
            self._put("cleared", states.cleared(before, at), at)

    def acknowledge(self, name: str, at: float, who: str) -> None:
        """Takes note that an operator has seen an alarm.

        Raises:
            ParameterError: There is no such alarm, or nothing to acknowledge.
        """
        self._put("acknowledged", states.acknowledged(self.alarm(name)), at, who)

    def shelve(self, name: str, until: float, at: float, who: str, why: str) -> None:
        """Puts an alarm on the shelf until a time.

        Raises:
            ParameterError: There is no such alarm, no reason is given, or the end is not within a shift.
        """
        if not (math.isfinite(until) and 0 < until - at <= LONGEST_SHELF):
            raise ParameterError(f"{name}: expected an end of at most {LONGEST_SHELF / 3600:g} h from now")
        if not why.strip():
            raise ParameterError(f"{name}: expected a reason for which it is shelved")
        self._put("shelved", states.shelved(self.alarm(name), until), at, who, why)

    def unshelve(self, name: str, at: float, who: str) -> None:
        """Takes an alarm off the shelf.

        Raises:
            ParameterError: There is no such alarm on it.
        """
        self._put("unshelved", states.unshelved(self.alarm(name)), at, who)

    def suppress(self, prefix: str, reason: str, at: float) -> None:
        """Suppresses by design all alarms whose names begin so, also those to come; reason "" ends it."""
        if reason == self._suppressing.get(prefix, ""):
            return
        self._suppressing[prefix] = reason
        for alarm in list(self._alarms.values()):
            if alarm.name.startswith(prefix):
                self._follow_design(alarm, at)

    def _follow_design(self, alarm: Alarm, at: float) -> None:
        """Suppresses an alarm, or no more, as design wants it now."""
        reasons = (reason for prefix, reason in self._suppressing.items() if alarm.name.startswith(prefix))
        reason = next(filter(None, reasons), "")
        if reason and not alarm.suppressed:
            self._put("suppressed", states.suppressed(alarm, reason), at, why=reason)
        elif alarm.suppressed and not reason:
            self._put("unsuppressed", states.unsuppressed(alarm), at)

    def pass_time(self, at: float) -> None:
        """Takes off the shelf what has been there for long enough."""
        for name, alarm in list(self._alarms.items()):
            if alarm.shelved_until is not None and at >= alarm.shelved_until:
                self._put("unshelved", states.unshelved(self._alarms[name]), at, why="its time was over")

    def rate(self, at: float) -> int:
        """Number of alarms that were annunciated in the last ten minutes."""
        while self._told and self._told[0] <= at - WINDOW:
            self._told.popleft()
        return len(self._told)

    def flood(self, at: float) -> bool:
        """Whether there are more alarms than an operator can deal with (ISA-18.2): from 11 to below 5."""
        self._flood = self.rate(at) > (FLOOD_OVER - 1 if self._flood else FLOOD)
        return self._flood

    def _put(self, action: Action, alarm: Alarm, at: float, who: str = "", why: str = "") -> None:
        if alarm.state is AlarmState.NORMAL:
            alarm = msgspec.structs.replace(alarm, first_out=False)
        self._alarms[alarm.name] = alarm
        change = Change(self._journal.last + 1, at, action, alarm, who[:32], why[:1000])
        if _annunciates(change):
            self._told.append(at)
        self._journal.add(change)

    def _forget(self) -> bool:
        """Makes room for an alarm; returns whether one was normal and could go."""
        for name, alarm in self._alarms.items():
            if alarm.state is AlarmState.NORMAL:
                del self._alarms[name]
                return True
        return False


def _annunciates(change: Change) -> bool:
    """Whether a change shows an alarm to the operator as new."""
    return change.action in ("raised", "unshelved", "unsuppressed") and change.alarm.unacknowledged
