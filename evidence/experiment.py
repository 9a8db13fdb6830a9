"""What experiments share on the command line: options, and where their results go."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Generic, TypeVar

from rich.console import Console, ConsoleOptions, RenderResult
from rich.markdown import Markdown, TableElement
from rich.table import Table

from dtwin.campaign import spread
from dtwin.commands.frame import JsonOption, WorkforceOption, at_least, progress_bar
from dtwin.controller.runtime import RuntimeOption
from dtwin.emulation.machine.sections import IDEAL
from dtwin.run.options import MachineOption
from dtwin.terminal import as_text, folding, print_json
from evidence.report import Report, ensure_folder, versions

R = TypeVar("R")


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
