"""A run of the whole cell: emulation, boxes and function-block controller together, and the summary of the run."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from operator import attrgetter
from typing import Protocol

import msgspec
import numpy as np

from dtwin.controller.embedded import EmbeddedController
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, CellJoints
from dtwin.run.emulate import emulate
from dtwin.run.hidden import HiddenLog
from dtwin.run.loop import Controller, Pacer, run, tick_count
from dtwin.run.machine_code.cell import CompiledTicks
from dtwin.run.settings import CellSettings, metadata, sequence_of
from dtwin.run.without_effect import without_effect
from dtwin.signals import BoxCounts, Event, StepRecord
from iec61499.native.resource import NativeResource


class Millimetres(msgspec.Struct, frozen=True):
    max: float
    mean: float


class PerJoint(msgspec.Struct, frozen=True):
    max: CellJoints


class RunSummary(msgspec.Struct, frozen=True):
    """The summary of a run.

    duration is the plant time run, s; the placement error is None where no box was delivered; tracking errors are
    path minus true angle, rad; events counts them by kind; without_effect names what was asked for and came to
    nothing.
    """

    duration: float
    seed: int
    boxes: BoxCounts
    placement_error_mm: Millimetres | None
    tracking_error_rad: PerJoint
    saturated_ticks: int
    real_time_factor: float
    wall_seconds: float
    events: dict[str, int]
    without_effect: list[str] = []


class CellController(Controller, Protocol):
    """The controller of a whole cell, which also tells what happens in its sequence."""

    def drain_events(self) -> list[Event]:
        """The events since the last call."""


class Cell:
    """One run of the cell. `log` holds what was recorded so far, also after an error or an interruption."""

    def __init__(
        self, settings: CellSettings, controller: CellController | None = None, hidden: HiddenLog | None = None
    ) -> None:
        """Prepares the run.

        Args:
            settings: settings of the run.
            controller: another controller than the embedded function blocks.
            hidden: collects the hidden truth of every tick; None for not looking at it.

        Raises:
            DtwinError: a setting, the model file or the function blocks cannot be used.
        """
        self.ticks = tick_count(settings.duration)
        self.settings = settings
        self.controller = controller or EmbeddedController(settings.control, settings.blocks, sequence_of(settings))
        self.emulation = emulate(settings)
        self.log = RunLog(metadata(settings))
        self.hidden = hidden
        self._wall = 0.0

    def run(self, between: Callable[[int], bool] | None = None, realtime: bool = False) -> None:
        """Runs to the end, or until `between` returns False.

        Args:
            between: called with the number of ticks done after every second of plant time.
            realtime: whether to run no faster than real time.

        Raises:
            DtwinError: plant or controller failed.
        """

        def gather(done: int) -> bool:
            self._gather()
            return between is None or between(done)

        began = time.perf_counter()
        pacer = Pacer(PERIOD) if realtime else None
        try:
            run(
                self.emulation,
                self.controller,
                self.ticks,
                record=self._recorder(),
                between=gather,
                pacer=pacer,
                ahead=None if realtime else self._ahead(),
            )
        finally:
            self._wall = time.perf_counter() - began
            self._gather()

    def _ahead(self) -> Callable[[int], int] | None:
        """What does ticks in machine code, if the blocks are that and nobody looks at every tick."""
        controller = self.controller
        if type(controller) is not EmbeddedController or self.hidden is not None:
            return None
        blocks = controller.resource
        if not isinstance(blocks, NativeResource) or blocks.traced:
            return None
        return CompiledTicks(self.emulation, controller, blocks, self.log).run

    def _recorder(self) -> Callable[[StepRecord], None]:
        """What takes the record of each tick."""
        hidden = self.hidden
        if hidden is None:
            return self.log.append

        def with_hidden(record: StepRecord) -> None:
            self.log.append(record)
            hidden.append(self.emulation.hidden())

        return with_hidden

    def _gather(self) -> None:
        """Adds to the log what has happened since the last call."""
        events = [*self.emulation.drain_events(), *self.controller.drain_events()]
        self.log.add_events(sorted(events, key=attrgetter("time")))

    def summary(self, log: Log) -> RunSummary:
        """The summary of the run from its frozen log and what became of the boxes."""
        errors = np.array(self.emulation.placement_errors_mm)
        duration = len(log) * PERIOD
        tracking = np.abs(log.stack("target") - log.angles()).max(axis=0, initial=0.0).tolist()
        saturated = (np.abs(log.stack("volts")[:, :3]) >= VOLTAGE_LIMIT).any(axis=1)
        return RunSummary(
            duration=round(duration, 9),
            seed=self.settings.seed,
            boxes=self.emulation.box_counts,
            placement_error_mm=Millimetres(float(errors.max()), float(errors.mean())) if len(errors) else None,
            tracking_error_rad=PerJoint(tuple(tracking)),
            saturated_ticks=int(saturated.sum()),
            real_time_factor=duration / self._wall if self._wall else 0.0,
            wall_seconds=self._wall,
            events=dict(sorted(Counter(event.kind for event in log.events).items())),
            without_effect=without_effect(self.settings, log),
        )
