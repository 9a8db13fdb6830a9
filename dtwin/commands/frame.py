"""What the commands that measure something share: options, a progress bar, and where their results go."""

from __future__ import annotations

import sys
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Markdown, TableElement
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from dtwin.campaign import spread
from dtwin.campaign.spread import Workforce
from dtwin.controller.runtime import RuntimeOption
from dtwin.emulation.machine.sections import IDEAL
from dtwin.errors import ParameterError
from dtwin.experiments.report import Report, ensure_folder, versions
from dtwin.run.options import MachineOption
from dtwin.terminal import as_text, folding, print_json

R = TypeVar("R")


@dataclass(frozen=True)
class JsonOption:
    """The option of every command whose result programs may read."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""


@dataclass(frozen=True)
class OnMachine(MachineOption):
    """What the experiments share that can be made on another machine than the ideal one."""

    def titled(self, report: Report) -> Report:
        """The report with the machine in its title, unless that is the ideal one."""
        if self.machine == IDEAL.name:
            return report
        return Report(f"{report.title}, machine {Path(self.machine).stem}", report.parts)


@dataclass(frozen=True)
class ExperimentCommand(JsonOption, RuntimeOption, ABC, Generic[R]):
    """An experiment on the command line, from its options to its report.

    Attributes:
        name: the word after `dtwin experiment`.
    """

    name: ClassVar[str]

    out: Path | None = None
    """Folder for the page report.html, experiment-NAME if not given; NAME is the experiment's."""
    seed: int = 0
    """Number of the first random generator of boxes, noise and faults; equal numbers give equal figures."""

    @abstractmethod
    def measure(self, progress: spread.Progress) -> R:
        """What comes of the experiment.

        Raises:
            DtwinError: an option is wrong, or the experiment cannot be made.
        """

    @abstractmethod
    def report(self, result: R) -> Report:
        """The page that tells the result to people."""

    @abstractmethod
    def figures(self, result: R) -> dict[str, Any]:
        """The object that tells the result to programs."""

    def passed(self, result: R) -> bool:
        """Whether all that was promised was kept; an experiment that promises nothing passes."""
        return True

    @property
    def folder(self) -> Path:
        """Where the report goes."""
        return self.out or Path(f"experiment-{self.name}")

    def execute(self) -> int:
        at_least("--seed", self.seed, 0)
        ensure_folder(self.folder)
        began = time.perf_counter()
        with progress_bar(f"experiment {self.name}") as progress:
            result = self.measure(progress)
        seconds = time.perf_counter() - began
        report = self.report(result)
        made = (
            f"Made by dtwin experiment {self.name} with seed {self.seed}; equal seeds give equal numbers, but for "
            f"times that this machine took. {versions()}."
        )
        page = report.write(self.folder, made)
        if self.json:
            print_json({**self.figures(result), "seconds": seconds, "report": str(page)})
        else:
            console = Console()
            console.print(Page(report.text))
            console.print(as_text(f"{seconds:.1f} s; report {page}"), soft_wrap=True)
        return 0 if self.passed(result) else 1


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


@dataclass(frozen=True)
class SeriesCommand(WorkforceOption, ExperimentCommand[R]):
    """An experiment of many independent runs."""

    def execute(self) -> int:
        self.workforce()  # a wrong one is told before the experiment begins
        return super().execute()


class FoldingTableElement(TableElement):
    """A table of a page, of which nothing is cut."""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for table in super().__rich_console__(console, options):
            assert isinstance(table, Table)
            yield folding(table)


class Page(Markdown):
    """A page of a report on the terminal."""

    elements: ClassVar = {**Markdown.elements, "table_open": FoldingTableElement}


@contextmanager
def progress_bar(title: str) -> Iterator[spread.Progress]:
    """A bar on standard error, where that is a terminal; gives what is to be told the progress."""
    console = Console(file=sys.stderr)
    columns = (TextColumn(title), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, of: bar.update(task, completed=done, total=of)


def at_least(option: str, value: float, least: float) -> None:
    """Checks a number given as an option.

    Raises:
        ParameterError: it is less than `least`, or not finite.
    """
    if not least <= value < float("inf"):
        raise ParameterError(f"{option}: expected at least {least:g}, got {value}")
