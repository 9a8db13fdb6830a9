"""`dtwin reproduce`."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import JsonOption, WorkforceOption, at_least, progress_bar
from dtwin.controller.runtime import RuntimeOption
from dtwin.experiments.report import ensure_folder
from dtwin.experiments.reproduce.book import PARTS, make, write
from dtwin.experiments.reproduce.chapter import Part, Scope
from dtwin.terminal import print_json


@dataclass(frozen=True)
class Reproduce(JsonOption, RuntimeOption, WorkforceOption):
    """Measure the thesis's whole evaluation again: its tests, figures and numbers beside ours, in one page.

    What a folder holds already is not measured again, so that a reproduction goes on where it was interrupted.
    """

    out: Annotated[Path, tyro.conf.Positional] = Path("reproduction")
    """Folder for reproduction.html, reproduction.pdf and the numbers."""
    quick: bool = False
    """Few runs of each test: minutes in place of three quarters of an hour."""
    seed: int = 0
    """Number of the first random generators; equal numbers give equal figures."""

    def execute(self) -> int:
        at_least("--seed", self.seed, 0)
        scope = Scope(self.quick, self.seed, self.workforce())
        ensure_folder(self.out)
        began = time.perf_counter()
        with _told() as begin:
            numbers = make(self.out, scope, begin=begin)
        page = write(self.out, scope, numbers)
        seconds = time.perf_counter() - began
        if self.json:
            print_json({"page": str(page), "seconds": seconds})
        else:
            print(f"{seconds:.0f} s; page {page}, print {page.with_suffix('.pdf')}")
        return 0


class _Teller:
    """Says which part is made, with a bar where there is a terminal."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._console = Console(stderr=True)
        self._number = 0

    def __call__(self, part: Part, done: bool) -> Progress:
        self._number += 1
        kept = ": kept from before" if done else ""
        self._console.print(f"{self._number} of {len(PARTS)}  {part.title}{kept}", highlight=False, soft_wrap=True)
        return self._progress


@contextmanager
def _told() -> Iterator[_Teller]:
    with progress_bar("reproduce") as progress:
        yield _Teller(progress)
