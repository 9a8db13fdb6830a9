"""The audit file: one JSON line for every command, which is only ever appended to."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import Any, Final

import msgspec

from dtwin.errors import RecordingError

AUDIT: Final = Path("console-audit.jsonl")
"""Default file, in the working directory."""


class AuditEntry(msgspec.Struct, frozen=True, tag_field="schema", tag=1):
    """A command and what became of it.

    Attributes:
        at: wall time, s since 1970.
        time: plant time, s.
        user: who gave the command.
        role: what this person may do.
        session: name of the session.
        address: address that the command came from.
        command: name of the command.
        content: content of the command.
        done: whether the command was carried out.
        answer: answer or refusal, in words.
    """

    at: float
    time: float
    user: str
    role: str
    session: str
    address: str
    command: str
    content: Any
    done: bool
    answer: str


class Audit:
    """Appends entries to the audit file.

    Args:
        path: path of the file, which is made with the first entry.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()

    def append(self, entry: AuditEntry) -> None:
        """Appends an entry, which is on disk when the call returns.

        Raises:
            RecordingError: the file cannot be written.
        """
        try:
            with self._lock:
                file = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)
                try:
                    os.write(file, msgspec.json.encode(entry) + b"\n")
                    os.fsync(file)
                finally:
                    os.close(file)
        except OSError as error:
            raise RecordingError(f"{self.path}: cannot be written: {error.strerror}") from None
