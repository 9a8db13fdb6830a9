"""Hours of plant time through recorder and journal in one process: the memory that they take does not grow."""

from __future__ import annotations

import resource
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import pyarrow.parquet as pq

from dtwin.bus.messages import Path as PathAngles
from dtwin.campaign.spread import Progress
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.machine.sections import Machine
from dtwin.experiments.report import Report, page, table
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.run.emulate import emulate
from dtwin.run.loop import run, tick_count
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.services.parts.journal import Journal
from dtwin.services.parts.journaled import JournaledCell
from dtwin.services.recorder import Options, Recorder
from dtwin.signals import Event, Sensors, StepRecord, Truth, Voltages

HOURS: Final = 10.0
"""Plant time of a run, h, unless asked for another time."""
GROWTH: Final = 5.0
"""Promised: growth of the largest memory from the first look to the last, MB per hour of plant time, at most."""
_LOOKS: Final = (1.0, 2.0, 5.0)
"""Plant times of the looks before the last, h."""
_HOUR: Final = tick_count(3600.0)
_CYCLE: Final = tick_count(120.0)
"""Number of ticks after which the messages are repeated at later times."""
_KEPT: Final = 200
"""Number of ticks between two parts of the log."""
_MEGABYTE: Final = 1e6


@dataclass(frozen=True, slots=True)
class Look:
    """What the process has taken so far.

    Attributes:
        hours: plant time, h.
        memory: largest resident memory so far, MB.
        parts: number of files that the log consists of.
        log: size of these files, MB.
        journal: size of the journal, MB.
    """

    hours: float
    memory: float
    parts: int
    log: float
    journal: float


@dataclass(frozen=True, slots=True)
class MemoryRun:
    """What came of a run.

    Attributes:
        looks: what the process had taken at some times, the last at the end.
        final: largest resident memory after the whole log was written, MB.
        missing: number of rows that the whole log lacks.
    """

    looks: tuple[Look, ...]
    final: float
    missing: int

    @property
    def growth(self) -> float:
        """Growth of the largest memory from the first look to the last, MB per hour."""
        first, last = self.looks[0], self.looks[-1]
        return (last.memory - first.memory) / max(last.hours - first.hours, 1.0)

    @property
    def passed(self) -> bool:
        """Whether every promise was kept."""
        return self.growth <= GROWTH and not self.missing

    def figures(self) -> dict[str, Any]:
        """The run for programs."""
        looks = msgspec.to_builtins(self.looks)
        return {"looks": looks, "growth": self.growth, "final": self.final, "missing": self.missing}

    def report(self) -> Report:
        """The run for people."""
        rows = [
            [f"{look.hours:g}", f"{look.memory:.0f}", f"{look.parts}", f"{look.log:.1f}", f"{look.journal:.2f}"]
            for look in self.looks
        ]
        return page(
            "Memory of a long run",
            "The messages of a cell go through the recorder and the journal of the emulator in one process, faster "
            "than in real time. The memory is the largest that the process has had so far.",
            table(["plant time, h", "memory, MB", "parts of the log", "log, MB", "journal, MB"], rows),
            f"The memory grew by {self.growth:.2f} MB an hour, promised were {GROWTH:g} MB at most. It was "
            f"{self.final:.0f} MB after the whole log had been written, which lacks {self.missing} rows.",
        )


def memory_run(seconds: float, seed: int, machine: Machine, progress: Progress) -> MemoryRun:
    """Feeds a recorder and a journal, and looks at the memory after 1, 2 and 5 hours and at the end.

    Args:
        seconds: plant time, s.
        seed: number of the random generator of the boxes.
        machine: the machine that the arm is.
        progress: told about every tenth of an hour.

    Raises:
        DtwinError: a file cannot be written.
    """
    ticks = tick_count(seconds)
    times = {round(hours * _HOUR) for hours in _LOOKS if hours * _HOUR < ticks} | {ticks}
    looks: list[Look] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, journal = folder / "run.parquet", folder / "journal"
        events: list[Event] = []
        recorder = Recorder(Options(log=log), {"seed": seed}, ArmParameters(), events.append)
        settings = CellSettings(seed=seed, machine=machine)
        cell = JournaledCell(settings, Journal(journal, seed))
        for tick, (record, news) in enumerate(_messages(ticks, settings), 1):
            _feed(recorder, record, news)
            cell.obey(record.voltages)
            cell.advance()
            cell.emulation.drain_events()
            if tick % _KEPT == 0 or tick == ticks:
                recorder.keep()
            if tick in times:
                files = [file.stat().st_size for file in folder.glob("*.parts/*")]
                log_size, journal_size = sum(files) / _MEGABYTE, journal.stat().st_size / _MEGABYTE
                looks.append(Look(tick / _HOUR, _largest_memory(), len(files), log_size, journal_size))
            if tick % (_HOUR // 10) == 0:
                progress(tick, ticks)
        recorder.close()
        written = pq.read_metadata(log).num_rows
    return MemoryRun(tuple(looks), _largest_memory(), ticks - written)


def _feed(recorder: Recorder, record: StepRecord, events: list[Event]) -> None:
    """Gives the recorder the messages of one tick at its plant time."""
    sensors = record.sensors
    now = sensors.time
    recorder.rows.sensors(sensors, now)
    recorder.rows.truth(record.truth, now)
    for event in events:
        recorder.take_event(event, now)
    recorder.rows.answer(PathAngles(sensors.sequence, now, record.target), now)
    recorder.rows.answer(record.voltages, now)


def _messages(ticks: int, settings: CellSettings) -> Iterator[tuple[StepRecord, list[Event]]]:
    """Records and events of a cell, tick by tick; those of its first two minutes come again and again."""
    cell, records = emulate(settings), list[StepRecord]()
    happened: dict[int, list[Event]] = {}
    run(cell, EmbeddedController(sequence=sequence_of(settings)), _CYCLE, record=records.append)
    for event in cell.drain_events():
        happened.setdefault(round(event.time / PERIOD) % _CYCLE, []).append(event)
    for tick in range(ticks):
        record, time = records[tick % _CYCLE], tick * PERIOD
        truth, sensors, command = record.truth, record.sensors, record.voltages
        yield (
            StepRecord(
                Truth(time, truth.theta, truth.omega, truth.gripper, truth.payload_mass),
                Sensors(tick, time, sensors.theta, sensors.gripper, sensors.box_present, sensors.box_colour),
                record.target,
                Voltages(tick, time, command.volts, command.box_gripped),
            ),
            [Event(time, event.kind, event.text) for event in happened.get(tick % _CYCLE, ())],
        )


def _largest_memory() -> float:
    """Largest resident memory of this process so far, MB."""
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / _MEGABYTE
