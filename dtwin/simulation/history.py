"""The history of a controller's settings: one JSON line for everything that was done to them, only ever appended.

The last line says what is in force, so there is no second file that could disagree. A line is written in one call and
forced to disk before the next step; a line that a crash cut off is no line, and is cut away before the next one.
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
"""default file, in the working directory"""

Action = Literal["start", "upload", "refuse", "confirm", "roll back"]
"""start: found in force; confirm: the trial period went as predicted."""


class Entry(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """Something that was done.

    Attributes:
        version: of the settings in force afterwards; counts up with every change.
        time: plant time, s.
        action: what.
        who: wanted it.
        why: in their words.
        kind: what was to change: gains, target or model.
        settings: in force afterwards.
        text: what came of it: the reason of a refusal, how the trial went.
        predicted: largest distance of each joint from its path that the twin expects, rad.
        measured: the same, as the trial showed it, rad.
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
    """The entries in a file; several processes may append to it.

    Args:
        path: of the file, made with the first entry.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def entries(self) -> list[Entry]:
        """All entries, oldest first; none when there is no file.

        Raises:
            RecordingError: the file cannot be read, or a line of it is no entry.
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
        """The newest entry; None when there is none.

        Raises:
            RecordingError: as `entries`.
        """
        found = self.entries()
        return found[-1] if found else None

    def append(self, entry: Entry) -> None:
        """Adds an entry; it is on disk when this returns.

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
        """The file, ours alone and ending with a whole line."""
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
"""bytes; an entry has about a thousand"""
