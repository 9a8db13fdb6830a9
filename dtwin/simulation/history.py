"""The history of a controller's settings: a file to which every change appends one JSON line.

The last line holds the settings in force, so there is no second file that could disagree. A line is written in one
call and forced to disk before the next step. A line that a crash cut off does not count and is removed before the
next one is written.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal

import msgspec

from dtwin.controller.settings import ControlSettings
from dtwin.errors import RecordingError
from dtwin.parameters import Triple
from dtwin.signals import Count, Line, Seconds, Word

HISTORY: Final = Path("uploads.jsonl")
"""Default file, in the working directory."""

Action = Literal["start", "upload", "refuse", "confirm", "roll back"]
"""Kinds of entries; "start" means found in force, "confirm" that the trial went as predicted."""


class Entry(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """An entry of the history: one action on the settings.

    Attributes:
        version: version of the settings in force afterwards, which counts up with every change.
        time: plant time, s.
        action: what was done.
        who: who wanted it.
        why: reason in the words of that person.
        kind: what was to change: gains, target, model, payload or offset.
        settings: settings in force afterwards.
        text: result in words, such as the reason of a refusal or the outcome of the trial.
        predicted: largest distance of each joint from its path that the twin predicted, rad.
        measured: largest distance of each joint from its path in the trial, rad.
    """

    version: Count
    time: Seconds
    action: Action
    who: Word
    why: Line
    kind: Word
    settings: ControlSettings
    text: Line = ""
    predicted: Triple | None = None
    measured: Triple | None = None


_decode: Final = msgspec.json.Decoder(Entry).decode


class History:
    """The entries of a history file; several processes may append to it.

    Args:
        path: path of the file, which is made with the first entry.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def entries(self) -> list[Entry]:
        """All entries, oldest first; none when there is no file.

        Raises:
            RecordingError: the file cannot be read, or one of its lines is no entry.
        """
        try:
            content = self.path.read_bytes()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be read: {error.strerror}") from None
        lines = content.split(b"\n")[:-1]  # what follows the last line's end was cut off
        found = []
        for number, line in enumerate(lines, 1):
            try:
                found.append(_decode(line))
            except msgspec.MsgspecError as error:
                raise RecordingError(f"{self.path}:{number}: expected an entry of the history: {error}") from None
        return found

    def last(self) -> Entry | None:
        """The newest entry, or None when there is no entry.

        Raises:
            RecordingError: the file cannot be read, or one of its lines is no entry.
        """
        found = self.entries()
        return found[-1] if found else None

    def append(self, entry: Entry) -> None:
        """Appends an entry, which is on disk when the call returns.

        Raises:
            RecordingError: the file cannot be written.
        """
        try:
            with self._locked() as file:
                os.write(file, msgspec.json.encode(entry) + b"\n")
                os.fsync(file)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be written: {error.strerror}") from None

    @contextmanager
    def _locked(self) -> Iterator[int]:
        """Opens the file locked for this process, without a last line that a crash cut off."""
        file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            fcntl.flock(file, fcntl.LOCK_EX)
            size = os.fstat(file).st_size
            tail = os.pread(file, min(size, _LONGEST), max(0, size - _LONGEST))
            if tail and not tail.endswith(b"\n"):
                os.ftruncate(file, size - len(tail) + tail.rfind(b"\n") + 1)
            yield file
        finally:
            os.close(file)


_LONGEST: Final = 1 << 16
"""Length of the longest line, bytes; an entry has about a thousand."""
