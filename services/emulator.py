"""The emulated cell on the bus: publishes a sample every tick, obeys the commands that answer it.

services/parts/paced/loop.py has the loop, and says what the paces are.
"""

from __future__ import annotations

import logging
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from dtwin.bus.messages import (
    ACTED,
    SAMPLE_BACKLOG,
    SENSORS,
    TICKS,
    TRUTH,
    VOLTAGES,
    Acted,
    BacklogRequest,
)
from dtwin.bus.passed import Passed
from dtwin.bus.session import Publisher
from dtwin.parameters import PERIOD
from dtwin.run.loop import tick_count
from dtwin.run.options import PlantOptions
from dtwin.run.out_of_place import out_of_place
from dtwin.services.parts.gate import STALE
from dtwin.services.parts.journaled import JournaledCell
from dtwin.services.parts.missed.backlog import Kept, samples
from dtwin.services.parts.pace import Pace
from dtwin.services.parts.paced.loop import Paced
from dtwin.services.parts.revival import revive
from dtwin.services.service import Link, Service, main
from dtwin.signals import Sensors, Voltages

log = logging.getLogger(__name__)

NAME: Final = "emulator"

ASKED_TO_END: Final = 128 + signal.SIGTERM
"""Exit status of an emulator that was asked to end before its run was over: the cell shall go on."""


@dataclass(frozen=True, kw_only=True)
class Options(PlantOptions, Link):
    """Run the emulated cell on the bus."""

    pace: Pace = "realtime"
    """realtime: ticks on the wall clock; lockstep: every tick waits for its command; free: no tick waits."""
    duration: float | None = None
    """Plant time after which the run ends, s; without it, it never ends."""
    stale: float = STALE
    """Time without a command, in real time, after which the arm gets 0 V, s."""
    recorded: bool = False
    """Keep what was published lately for a recorder that comes back."""
    journal: Path | None = None
    """File of commands and faults; a killed emulator that finds its own goes on where it was."""

    def run(self) -> int:
        settings = self.settings()
        ticks = None if self.duration is None else tick_count(self.duration)
        if self.journal is None:
            cell, trouble = JournaledCell(settings, None), ""
        else:
            cell, trouble = revive(settings, self.journal)
        with Service(NAME, self) as service:
            emulator = Emulator(service, cell, self.pace, self.stale, trouble, self.recorded)
            whole = emulator.run(ticks, out_of_place(settings.task, settings.machine.arm(settings.arm)))
        return 0 if whole else ASKED_TO_END


class Emulator(Paced[Sensors, Voltages]):
    """The cell between its inbox and its publications.

    Args:
        service: frame of this service.
        cell: emulated cell that runs.
        pace: how long a tick waits for its command.
        stale: time without a command, in real time, after which the arm gets 0 V, s.
        trouble: What was wrong with the journal, "" for nothing.
        recorded: whether what was published lately is kept.
    """

    def __init__(
        self,
        service: Service,
        cell: JournaledCell,
        pace: Pace,
        stale: float,
        trouble: str = "",
        recorded: bool = False,
    ) -> None:
        bus = service.bus
        self._cell = cell
        # A recorder must see every tick of a lockstep run, even if that slows the run down.
        lossless = pace != "realtime"
        sensors, acted, truth = (bus.publisher(topic, lossless=lossless) for topic in (SENSORS, ACTED, TRUTH))
        self._publish_sensors: Callable[[Sensors], None] = sensors
        self._publish_acted: Callable[[Acted], None] = acted
        self._publish_truth: Publisher | Kept = truth
        if recorded:
            kept = Kept(sensors), Kept(truth), Kept(acted)
            self._publish_sensors, self._publish_truth, self._publish_acted = kept
            bus.answer(SAMPLE_BACKLOG, BacklogRequest, lambda asked: samples(asked, *kept))
        self._publish_ticks = bus.publisher(TICKS, lossless=lossless)
        self._passed = Passed(self._publish_ticks)
        super().__init__(service, cell, (VOLTAGES, Voltages), PERIOD, pace, stale, trouble)
        if cell.replayed:
            log.info("goes on at %.2f s after %d entries of the journal", cell.read().time, cell.replayed)

    def publish_sample(self, sample: Sensors) -> None:
        """Publishes a sample, and the truth if anybody wants to know it."""
        self._publish_sensors(sample)
        if self._publish_truth.wanted:
            self._publish_truth(self._cell.emulation.truth())

    def publish_acting(self, sample: Sensors, command: Voltages, answers: bool) -> None:
        """Publishes what acts in this tick unless that is the command that answers its sample."""
        if self._publish_ticks.wanted:
            self._passed.add(sample, command)
        if not answers:
            self._publish_acted(Acted(sample.sequence, sample.time, command.volts, command.box_gripped))

    def end_of_run(self) -> None:
        """Tells the ticks that wait to be told."""
        self._passed.tell()

    def figures(self) -> dict[str, Any]:
        """What became of the boxes."""
        return {"boxes": self._cell.emulation.box_counts}


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
