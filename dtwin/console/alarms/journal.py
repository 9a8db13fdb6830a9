"""The journal of the alarms: every change with the alarm as it was afterwards, so that nothing is lost in a restart.

A line of JSON holds one change. The file grows up to a size; then it becomes the older of two files, and a new one
begins with the alarms that are not normal.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from dtwin.console.alarms.states import Alarm, AlarmState
from dtwin.errors import RecordingError
from dtwin.line_file import LineFile
from dtwin.signals import Count, Line, Word

Action = Literal["raised", "changed", "cleared", "acknowledged", "shelved", "unshelved", "suppressed", "unsuppressed"]
LONGEST: Final = 20_000
"""Number of changes in a file, if they are of the usual length."""
OLDEST: Final = 90 * 86400.0
"""Age from which on changes are given up, s; in a file they may be twice as old."""
USUAL: Final = 512
"""Length of a change in a file, bytes."""


class Change(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """Something that happened to an alarm.

    Attributes:
        number: Count of the changes, from 1.
        at: Wall time, s since 1970.
        action: What happened.
        alarm: The alarm afterwards.
        who: Who did it, "" for nobody.
        why: Reason in words, "" for none.
        left_out: Number of changes of this alarm before it that were too many to be kept one by one.
    """

    number: Annotated[int, msgspec.Meta(ge=1)]
    at: float
    action: Action
    alarm: Alarm
    who: Word = ""
    why: Line = ""
    left_out: Count = 0


class Journal:
    """Keeps changes in memory and in two files of bounded length.

    Args:
        path: Path of the newer file, which need not exist; without it, changes are kept in memory alone.
        longest: Number of changes in a file, if they are of the usual length.

    Attributes:
        changes: Changes that are kept, oldest first, at most twice `longest`.
        trouble: Why the newest changes are not in the file yet, "" if they are.

    Raises:
        RecordingError: A file cannot be read, or holds something else.
    """

    def __init__(self, path: Path | None, longest: int = LONGEST) -> None:
        self._longest = longest
        self._unwritten: list[Change] = []
        self._file: LineFile[Change] | None = None
        self.trouble = ""
        self.changes: list[Change] = []
        if path is not None:
            # What people do is in the audit as well, which is forced to disk; the rest comes again if it still holds.
            size = USUAL * longest
            self._file = LineFile(
                path, Change, "a change of an alarm", largest=size, older=1, sync=False, carry=self._needed
            )
            by_number = {change.number: change for change in self._file.entries()}
            self.changes = [by_number[number] for number in sorted(by_number)]
        self._since = self.changes[0].at if self.changes else math.inf

    @property
    def last(self) -> int:
        """Number of the last change, 0 before the first."""
        return self.changes[-1].number if self.changes else 0

    def add(self, change: Change) -> None:
        """Keeps a change; what cannot be written now is written with a later one, and `trouble` says why."""
        self.changes.append(change)
        if len(self.changes) > 2 * self._longest:
            self._give_up(self.changes[: self._longest], self.changes[self._longest :])
        self._since = min(self._since, change.at)
        aged = change.at - self._since > OLDEST
        if aged:
            self._since = change.at
            old = [each for each in self.changes if change.at - each.at > OLDEST]
            self._give_up(old, [each for each in self.changes if change.at - each.at <= OLDEST])
        if self._file is None:
            return
        self._unwritten.append(change)
        del self._unwritten[: -self._longest]
        try:
            if aged:
                self._file.renew()
            self._file.append(*self._unwritten)
        except RecordingError as error:
            self.trouble = str(error)
            return
        self._unwritten.clear()
        self.trouble = ""

    def _give_up(self, old: list[Change], others: list[Change]) -> None:
        """Forgets old changes, except those after which alarms are as they are."""
        needed = {change.number for change in _last_of(self.changes)}
        self.changes = [*(change for change in old if change.number in needed), *others]

    def _needed(self) -> list[Change]:
        """The changes that a new file begins with, before those that are to be written."""
        return _last_of(self.changes[: len(self.changes) - len(self._unwritten)])


def _last_of(changes: list[Change]) -> list[Change]:
    """The last change of every alarm that is not normal."""
    last = {change.alarm.name: change for change in changes}
    return [change for change in last.values() if change.alarm.state is not AlarmState.NORMAL]
