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
BURST: Final = 10
"""Number of changes of an alarm that are kept one by one when they come close together; chattering ones have more."""
EVERY: Final = 60.0
"""Time after which one more change of an alarm is kept, s."""
BURST_OF_ALL: Final = 200
"""Number of changes of all alarms together that are kept one by one when they come close together."""
EVERY_OF_ALL: Final = 6.0
"""Time after which one more change of any alarm is kept, s."""
ANNUNCIATING: Final[frozenset[Action]] = frozenset({"raised", "unshelved", "unsuppressed"})
"""Changes after which an alarm that is unacknowledged is new to the operator."""
LONGEST_SHELF: Final = 8 * 3600.0
"""Longest time on the shelf, s: a shift."""


class Allowance:
    """Something that may be done a number of times at once, and then once in a while (a token bucket).

    Args:
        burst: Number of times at once.
        every: Time after which it may be done once more, s.
    """

    def __init__(self, burst: int, every: float) -> None:
        self._left, self._burst, self._every = float(burst), burst, every
        self._at = -math.inf

    def has(self, at: float) -> bool:
        """Whether it may be done now."""
        self._left = min(self._burst, self._left + max(0.0, at - self._at) / self._every)
        self._at = at
        return self._left >= 1.0

    def count(self) -> None:
        """Takes note that it is done."""
        self._left -= 1.0


class AlarmList:
    """All alarms by name, and their history.

    A condition that lasts is one change of the history, whatever its words say meanwhile. Changes that come too
    often, of a chattering alarm or in a flood, are counted, and the next one that is kept tells how many there were;
    what operators do is always kept.

    Times `at` are wall time in s since 1970; they may not go back.

    Args:
        journal: Journal, from which earlier alarms are taken.

    Attributes:
        floods: Number of floods since the first change that is kept.
        left_out: Number of changes that are not in the history one by one, since the list was made.
    """

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._alarms: dict[str, Alarm] = {}
        self._suppressing: dict[str, str] = {}
        self._told: deque[float] = deque()
        self._flood = False
        self.floods = self.left_out = 0
        self._allowed = Allowance(BURST_OF_ALL, EVERY_OF_ALL)
        self._allowances: dict[str, Allowance] = {}
        self._waiting: dict[str, int] = {}
        for change in journal.changes:
            self._alarms[change.alarm.name] = change.alarm
            if _annunciates(change):
                self._annunciate(change.at)

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
        elif now.priority != before.priority:
            self._put("changed", now, at)
        else:
            self._alarms[name] = now

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
        """Takes off the shelf what has been there for long enough, and keeps changes that have waited."""
        for name, alarm in list(self._alarms.items()):
            if alarm.shelved_until is not None and at >= alarm.shelved_until:
                self._put("unshelved", states.unshelved(self._alarms[name]), at, why="its time was over")
        for name in list(self._waiting):
            if self._may_keep(name, at):
                self._keep("changed", self._alarms[name], at)

    def rate(self, at: float) -> int:
        """Number of alarms that were annunciated in the last ten minutes."""
        while self._told and self._told[0] <= at - WINDOW:
            self._told.popleft()
        return len(self._told)

    def flood(self, at: float) -> bool:
        """Whether there are more alarms than an operator can deal with (ISA-18.2): from 11 to below 5."""
        before = self._flood
        self._flood = self.rate(at) > (FLOOD_OVER - 1 if before else FLOOD)
        self.floods += self._flood and not before
        return self._flood

    def _put(self, action: Action, alarm: Alarm, at: float, who: str = "", why: str = "") -> None:
        if alarm.state is AlarmState.NORMAL:
            alarm = msgspec.structs.replace(alarm, first_out=False)
        self._alarms[alarm.name] = alarm
        if action in ANNUNCIATING and alarm.unacknowledged:
            self._annunciate(at)
        if who or self._may_keep(alarm.name, at):
            self._keep(action, alarm, at, who, why)
        else:
            self._waiting[alarm.name] = self._waiting.get(alarm.name, 0) + 1
            self.left_out += 1

    def _may_keep(self, name: str, at: float) -> bool:
        """Whether there is room for one more change of an alarm in the history."""
        own = self._allowances.setdefault(name, Allowance(BURST, EVERY))
        return own.has(at) and self._allowed.has(at)

    def _keep(self, action: Action, alarm: Alarm, at: float, who: str = "", why: str = "") -> None:
        left_out = self._waiting.pop(alarm.name, 0)
        for allowance in (self._allowed, self._allowances.setdefault(alarm.name, Allowance(BURST, EVERY))):
            allowance.count()
        self._journal.add(Change(self._journal.last + 1, at, action, alarm, who[:32], why[:1000], left_out))

    def _annunciate(self, at: float) -> None:
        """Counts an alarm that is shown to the operator as new."""
        self._told.append(at)
        self.flood(at)

    def _forget(self) -> bool:
        """Makes room for an alarm; returns whether one was normal and could go."""
        for name, alarm in self._alarms.items():
            if alarm.state is AlarmState.NORMAL:
                del self._alarms[name]
                self._allowances.pop(name, None)
                self._waiting.pop(name, None)
                return True
        return False


def _annunciates(change: Change) -> bool:
    """Whether a change shows an alarm to the operator as new."""
    return change.action in ANNUNCIATING and change.alarm.unacknowledged
