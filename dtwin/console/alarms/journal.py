"""The journal of the alarms: every change with the alarm as it was afterwards, so that nothing is lost in a restart.

A line of JSON holds one change. The file grows up to a number of changes; then it becomes the older of two files, and
a new one begins with the alarms that are not normal. A line that a killed process left unfinished is cut off.
"""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Annotated, Final, Literal

import msgspec

from dtwin.console.alarms.states import Alarm, AlarmState
from dtwin.errors import RecordingError
from dtwin.files import reason_of, replacing
from dtwin.signals import Line, Word

Action = Literal["raised", "changed", "cleared", "acknowledged", "shelved", "unshelved", "suppressed", "unsuppressed"]
LONGEST: Final = 20_000
"""Number of changes in a file."""


class Change(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """Something that happened to an alarm.

    Attributes:
        number: Count of the changes, from 1.
        at: Wall time, s since 1970.
        action: What happened.
        alarm: The alarm afterwards.
        who: Who did it, "" for nobody.
        why: Reason in words, "" for none.
    """

    number: Annotated[int, msgspec.Meta(ge=1)]
    at: float
    action: Action
    alarm: Alarm
    who: Word = ""
    why: Line = ""


class Journal:
    """Keeps changes in memory and in two files of bounded length.

    Args:
        path: Path of the newer file, which need not exist; without it, changes are kept in memory alone.
        longest: Number of changes in a file.

    Attributes:
        changes: Changes that are kept, oldest first, at most twice `longest`.
        trouble: Why the newest changes are not in the file yet, "" if they are.

    Raises:
        RecordingError: A file cannot be read, or holds something else.
    """

    def __init__(self, path: Path | None, longest: int = LONGEST) -> None:
        self._path = path
        self._longest = longest
        self._unwritten: list[bytes] = []
        self._encode = msgspec.json.Encoder().encode
        self.trouble = ""
        self.changes: list[Change] = []
        self._in_file = 0
        if path is not None:
            by_number = {change.number: change for change in _read(_older(path))}
            newer = _read(path)
            by_number.update((change.number, change) for change in newer)
            self._in_file = len(newer)
            self.changes = [by_number[number] for number in sorted(by_number)]

    @property
    def last(self) -> int:
        """Number of the last change, 0 before the first."""
        return self.changes[-1].number if self.changes else 0

    def add(self, change: Change) -> None:
        """Keeps a change; what cannot be written now is written with a later one, and `trouble` says why."""
        self.changes.append(change)
        if len(self.changes) > 2 * self._longest:
            del self.changes[: self._longest]
        if self._path is None:
            return
        self._unwritten.append(self._encode(change) + b"\n")
        del self._unwritten[: -self._longest]
        try:
            if self._in_file >= self._longest:
                self._begin_anew(self._path)
            with self._path.open("ab") as file:
                file.write(b"".join(self._unwritten))
        except OSError as error:
            self._cut(self._path)
            self.trouble = f"{self._path}: cannot be written: {reason_of(error)}"
            return
        except RecordingError as error:
            self.trouble = str(error)
            return
        self._in_file += len(self._unwritten)
        self._unwritten.clear()
        self.trouble = ""

    def _begin_anew(self, path: Path) -> None:
        """Makes the file the older one; the new one begins with what is needed of it."""
        kept = self.changes[: -len(self._unwritten)]
        alarms = {change.alarm.name: change for change in kept}
        needed = [change for change in alarms.values() if change.alarm.state is not AlarmState.NORMAL]
        with replacing(_older(path)) as temporary:
            temporary.write_bytes(path.read_bytes())
        with replacing(path) as temporary:
            temporary.write_bytes(b"".join(self._encode(change) + b"\n" for change in needed))
        self._in_file = len(needed)

    @staticmethod
    def _cut(path: Path) -> None:
        """Takes away what a failed writing left after the last whole line."""
        try:
            content = path.read_bytes()
            with path.open("r+b") as file:
                file.truncate(content.rfind(b"\n") + 1)
        except OSError:
            return


def _older(path: Path) -> Path:
    return path.with_name(f"{path.name}.1")


def _read(path: Path) -> list[Change]:
    """The changes of a file; an unfinished last line is cut off.

    Raises:
        RecordingError: The file cannot be read, or a line of it is no change.
    """
    if not path.exists():
        return []
    decode = msgspec.json.Decoder(Change).decode
    changes: list[Change] = []
    try:
        with path.open("r+b") as file:
            end = 0
            for number in itertools.count(1):
                line = file.readline()
                if not line.endswith(b"\n"):
                    break
                try:
                    changes.append(decode(line))
                except msgspec.DecodeError as error:
                    raise RecordingError(f"{path}:{number}: expected a change of an alarm: {error}") from None
                end += len(line)
            file.truncate(end)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
    return changes
