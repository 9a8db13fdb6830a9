"""Text of others on a terminal: shown as it is, never obeyed.

Names, reasons and errors come from the bus, from files and from devices. A terminal would obey control characters
and the marks that turn the direction of writing, and rich would obey markup in square brackets.
"""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING, Any

import msgspec

from iec61499.output import printable as printable

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text


def as_text(text: str, style: str = "") -> Text:
    """The same for rich, which takes nothing in it for markup; the style holds for all of it."""
    from rich.text import Text  # takes longer to import than `dtwin --help` may take

    return Text(printable(text), style)


def folding(table: Table) -> Table:
    """The same table, whose words go on in the next line where they are too long for their column: nothing is cut."""
    for column in table.columns:
        column.overflow, column.no_wrap = "fold", False
    return table


NARROW = 80
"""Number of columns of a terminal below which a table is drawn without the lines between its columns."""


def print_table(table: Table) -> None:
    """Prints a table on standard output; nothing of it is cut."""
    from rich.box import SIMPLE_HEAD
    from rich.console import Console

    console = Console()
    if console.width < NARROW:
        table.box, table.pad_edge, table.padding = SIMPLE_HEAD, False, (0, 1, 0, 0)
    console.print(folding(table))


def alarm(text: str) -> None:
    """Prints in red on standard error what needs somebody's attention at once."""
    from rich.console import Console

    Console(stderr=True).print(as_text(f"dtwin: {text}", "bold red"), soft_wrap=True)


def print_json(value: Any) -> None:
    """Prints one JSON value in one line on standard output, at once."""
    print(printable(msgspec.json.encode(value).decode()), flush=True)


class LineFormatter(logging.Formatter):
    """Formats a log record as one printable line; a traceback follows in lines of its own."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return printable(super().formatMessage(record))


class RateLimit(logging.Filter):
    """Lets few records of one kind (level and message before its arguments are put in) through in a time.

    Whoever sends bad input a thousand times would otherwise fill the log. The last record that comes through says
    that others are withheld, and the first one of the next time how many were.

    Args:
        most: records of one kind that come through in a time.
        period: that time, s.
    """

    def __init__(self, most: int = 3, period: float = 60.0) -> None:
        super().__init__()
        self._most = most
        self._period = period
        self._kinds: dict[tuple[int, str], tuple[float, int]] = {}

    def filter(self, record: logging.LogRecord) -> bool:
        kind = record.levelno, str(record.msg)
        since, count = self._kinds.get(kind, (-math.inf, 0))
        withheld = 0
        if record.created >= since + self._period:
            since, count, withheld = record.created, 0, max(0, count - self._most)
        self._kinds[kind] = since, count + 1
        if count >= self._most:
            return False
        notes = [f"{withheld} more since"] * bool(withheld)
        notes += [f"more of these are only counted for {self._period:g} s"] * (count + 1 == self._most)
        if notes:
            record.msg, record.args = f"{record.getMessage()} ({'; '.join(notes)})", ()
        return True
