"""The parts of the reproduction: what is measured, kept as numbers, and what is told and drawn of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from dtwin.campaign.spread import EVERY_CORE, Progress, Workforce
from evidence.report import Picture

POINTS: Final = 400
"""Most points of a drawn curve that are kept."""


@dataclass(frozen=True, slots=True)
class Scope:
    """How much is measured.

    Attributes:
        quick: whether few runs must do.
        seed: number of the first random generators.
        workforce: who does the runs.
    """

    quick: bool = False
    seed: int = 0
    workforce: Workforce = EVERY_CORE

    def runs(self, full: int, quick: int) -> int:
        """A number of runs."""
        return quick if self.quick else full


@dataclass(frozen=True, slots=True)
class Line:
    """A number of the thesis beside ours.

    Attributes:
        figure: where the thesis has it.
        what: what is compared.
        thesis: what the thesis reports.
        ours: what was measured here.
    """

    figure: str
    what: str
    thesis: str
    ours: str


@dataclass(frozen=True, slots=True, eq=False)
class Chapter:
    """What is told of a part.

    Attributes:
        test: how the test is made.
        lines: the thesis's numbers beside ours.
        differs: what differs, and why.
        adds: what is added to the thesis's test.
        drawings: its figures.
    """

    test: str
    lines: Sequence[Line]
    differs: str
    adds: str
    drawings: Sequence[Picture]


@dataclass(frozen=True, slots=True)
class Part:
    """One of the thesis's tests.

    Attributes:
        name: name of the files that keep its numbers.
        title: its heading.
        measure: makes the test; what it gives is JSON, equal for equal scopes but for `machine`.
        tell: what is told of the numbers.
        machine: names of the numbers that depend on the machine, which are kept apart.
    """

    name: str
    title: str
    measure: Callable[[Scope, Progress], dict[str, Any]]
    tell: Callable[[Mapping[str, Any]], Chapter]
    machine: tuple[str, ...] = ()


def curve(time: np.ndarray, *columns: np.ndarray) -> list[list[float]]:
    """Columns over time with at most POINTS rows, rounded as a picture needs it."""
    step = max(1, -(-len(time) // POINTS))
    return [np.round(column[::step], 5).tolist() for column in (time, *columns)]


def percent(value: float) -> str:
    """A share in percent."""
    return f"{100 * value:.2g} %" if abs(value) < 0.0995 else f"{100 * value:.0f} %"
