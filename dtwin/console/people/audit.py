"""The audit file: one JSON line for every command, chained to the one before, which is only ever appended to."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import msgspec

from dtwin.line_file import LineFile

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


class Audit(LineFile[AuditEntry]):
    """The entries of an audit file, which nobody but its owner may read.

    Args:
        path: path of the file, which is made with the first entry.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, AuditEntry, "an entry of the audit", mode=0o600, marked=True)
