"""What the commands that measure something share: options, a progress bar, and where their results go."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, fields
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from dtwin.campaign import spread
from dtwin.campaign.spread import Workforce
from dtwin.errors import ParameterError, RecordingError


@dataclass(frozen=True)
class JsonOption:
    """The option of every command whose result programs may read."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""


@dataclass(frozen=True)
class WorkforceOption:
    """The options of every command that does many independent tasks; what comes of it does not depend on them."""

    workers: int | None = None
    """Number of processes that share the work, one for each core if not given."""
    scheduler: str | None = None
    """Address of a Dask scheduler whose workers share the work instead, such as tcp://127.0.0.1:8786."""

    def workforce(self) -> Workforce:
        """Who does the tasks. Raises ParameterError."""
        return Workforce(self.workers, self.scheduler)


@contextmanager
def progress_bar(title: str) -> Iterator[spread.Progress]:
    """A bar on standard error, where that is a terminal; gives what is to be told the progress."""
    console = Console(file=sys.stderr)
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


@contextmanager
def arguments_as_options(command: Any) -> Iterator[None]:
    """Lets what the API says of its arguments be said of the options of a command.

    A name at the beginning before a colon, at the end in parentheses, and between backticks gets the form --name.
    """
    names = {field.name for field in fields(command)}

    def option(found: re.Match[str]) -> str:
        name = next(each for each in found.groups() if each)
        return f"--{name.replace('_', '-')}" if name in names else found[0]

    try:
        yield
    except (ParameterError, RecordingError) as error:
        text = re.sub(r"`([a-z_]+)`|^([a-z_]+)(?=: )|(?<=\()([a-z_]+)(?=\)$)", option, str(error))
        raise type(error)(text) from None


def at_least(option: str, value: float, least: float) -> None:
    """Checks a number given as an option.

    Raises:
        ParameterError: it is less than `least`, or not finite.
    """
    if not least <= value < float("inf"):
        raise ParameterError(f"{option}: expected at least {least:g}, got {value}")
