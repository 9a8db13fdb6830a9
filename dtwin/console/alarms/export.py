"""The history of the alarms as a table: searched, and written as CSV (RFC 4180)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Final

from dtwin.console.alarms.journal import Change

COLUMNS: Final = (
    "number",
    "time",
    "plant time (s)",
    "action",
    "alarm",
    "priority",
    "state",
    "text",
    "who",
    "why",
    "left out",
)
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")
"""First characters that make a spreadsheet take a text for a formula."""


def found(changes: Iterable[Change], words: str) -> Iterator[Change]:
    """The changes in which every word occurs, in whatever column and whatever case."""
    wanted = words.casefold().split()
    for change in changes:
        row = " ".join(cells(change)).casefold()
        if all(word in row for word in wanted):
            yield change


def cells(change: Change) -> tuple[str, ...]:
    """A change as the texts of COLUMNS."""
    alarm = change.alarm
    time = datetime.fromtimestamp(change.at, UTC).isoformat(timespec="milliseconds")
    return (
        *(str(change.number), time, f"{alarm.plant:.2f}", change.action, alarm.name, alarm.priority),
        *(alarm.state, alarm.text, change.who, change.why, str(change.left_out or "")),
    )


def to_csv(changes: Iterable[Change]) -> str:
    """The changes as CSV; a text that a spreadsheet would calculate is marked as text by an apostrophe."""
    out = io.StringIO()
    writer = csv.writer(out)
    writer.writerow(COLUMNS)
    for change in changes:
        writer.writerow([f"'{cell}" if cell.startswith(_FORMULA) else cell for cell in cells(change)])
    return out.getvalue()
