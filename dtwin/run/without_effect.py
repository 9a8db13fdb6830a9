"""What was asked of a run and never came to anything, which people should not take for a result."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from dtwin.controller.settings import Compensation
from dtwin.emulation.faults import Fault
from dtwin.parameters import PERIOD
from dtwin.run.out_of_place import out_of_place
from dtwin.run.settings import CellSettings

if TYPE_CHECKING:
    from dtwin.logs.log import Log

_OF_BOXES: Final = ("payload", "pads", "slip")
"""Targets of faults that act on a held box alone."""


def without_effect(settings: CellSettings, log: Log) -> list[str]:
    """What had no effect in a run, one sentence each.

    Args:
        settings: settings of the run.
        log: its log.
    """
    end = len(log) * PERIOD
    missed = out_of_place(settings.task, settings.machine.arm(settings.arm))
    return [*missed, *of_no_use(settings, end), *_unheld(settings, log)]


def of_no_use(settings: CellSettings, end: float = math.inf) -> list[str]:
    """What will have no effect whatever happens in a run, one sentence each.

    Args:
        settings: settings of the run.
        end: plant time at which it ends, s.
    """
    late = [f"fault {fault}: the run ends before it, at {end:g} s" for fault in settings.faults if fault.start >= end]
    return [*late, *_options(settings)]


def _unheld(settings: CellSettings, log: Log) -> Iterator[str]:
    held = log.held()
    for fault in settings.faults:
        if fault.target in _OF_BOXES and fault.start < len(log) * PERIOD and not held[_rows(fault, len(log))].any():
            yield f"fault {fault}: no box was held then"


def _rows(fault: Fault, rows: int) -> slice:
    """The ticks in which a fault holds; what happens at one moment holds in that tick alone."""
    first = round(fault.start / PERIOD)
    if fault.target == "slip":
        return slice(max(first - 1, 0), first + 1)
    return slice(first, rows if fault.end >= rows * PERIOD else round(fault.end / PERIOD) + 1)


def _options(settings: CellSettings) -> Iterator[str]:
    control, usual = settings.control, Compensation()
    if control.law != "cascade":
        for name in ("delay", "dead_zone", "bandwidth"):
            if (value := getattr(control.compensation, name)) != getattr(usual, name):
                yield f"{name} {value:g}: only the cascade takes it into account, the law was {control.law}"
        if any(control.model.coulomb):
            yield f"friction of the controller's model: only the cascade adds it, the law was {control.law}"
    if settings.noise_kind != "uniform" and not settings.noise:
        yield f"noise kind {settings.noise_kind}: the noise was 0"
