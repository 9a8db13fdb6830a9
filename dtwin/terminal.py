"""Text of others on a terminal: shown as it is, never obeyed.

Names, reasons and errors come from the bus, from files and from devices. A terminal would obey control characters
and the marks that turn the direction of writing, and rich would obey markup in square brackets.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import msgspec

from iec61499.output import LineFormatter as LineFormatter
from iec61499.output import RateLimit as RateLimit
from iec61499.output import printable as printable

if TYPE_CHECKING:
    from rich.console import Console
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


_WIDEST = 100_000
"""More columns than any table has."""

NARROW = 80
"""Number of columns of a terminal below which a table is drawn without the lines between its columns."""


def print_table(table: Table) -> None:
    """Prints a table on standard output; nothing of it is cut.

    The lines between its columns are left out on a narrow terminal, and where no word goes on in the next line then.
    """
    from rich.box import SIMPLE_HEAD
    from rich.console import Console

    console = Console()
    lined = table.box, table.pad_edge, table.padding
    ample = _width(console, table) <= console.width
    table.box, table.pad_edge, table.padding = SIMPLE_HEAD, False, (0, 0)
    if console.width >= NARROW and (ample or _width(console, table) > console.width):
        table.box, table.pad_edge, table.padding = lined
    console.print(folding(table))


def _width(console: Console, table: Table) -> int:
    """Number of columns of the terminal that the table takes if no word goes on in the next line."""
    from rich.measure import Measurement

    return Measurement.get(console, console.options.update(max_width=_WIDEST), table).maximum


def alarm(text: str) -> None:
    """Prints in red on standard error what needs somebody's attention at once."""
    from rich.console import Console

    Console(stderr=True).print(as_text(f"dtwin: {text}", "bold red"), soft_wrap=True)


def print_json(value: Any) -> None:
    """Prints one JSON value in one line on standard output, at once."""
    print(printable(msgspec.json.encode(value).decode()), flush=True)
