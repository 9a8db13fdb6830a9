"""The arms of a line's stations on the bus, as in a cell: their samples, commands and paths go out, and come in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from dtwin.bus.following import following_ticks
from dtwin.bus.messages import (
    EVENTS,
    PATH,
    SENSORS,
    TICKS,
    TOGETHER,
    TRUTH,
    VOLTAGES,
    Acted,
    PassedTick,
    PassedTicks,
    Path,
)
from dtwin.bus.session import Bus
from dtwin.bus.ticks import Tick
from dtwin.logs.collecting import RunLog
from dtwin.parameters import PERIOD
from dtwin.signals import UNKNOWN, Event, Sensors, StepRecord, Truth, Voltages

_WAITING: Final = 1000
"""Number of paths that may wait for their samples."""


class ArmPublisher:
    """Publishes what the log of a station has got since the last call, and forgets it.

    Args:
        bus: session with the station in the place of an arm.
        log: log of the station.
    """

    def __init__(self, bus: Bus, log: RunLog) -> None:
        self._log = log
        self._sensors, self._voltages = bus.publisher(SENSORS), bus.publisher(VOLTAGES)
        self._path, self._ticks = bus.publisher(PATH), bus.publisher(TICKS)
        self._truth, self._event = bus.publisher(TRUTH), bus.publisher(EVENTS)

    def publish(self, events: Sequence[Event]) -> None:
        """Publishes the new ticks, and events."""
        log, first = self._log, self._log.forgotten
        new = log.since(first)
        log.forget(len(log))
        columns = new.columns
        rows = zip(
            *(columns["t"].tolist(), new.stack("measured").tolist(), columns["gripper"].tolist()),
            *(columns["box_present"].tolist(), columns["box_colour"].tolist(), new.stack("volts").tolist()),
            *(columns["box_gripped"].tolist(), new.stack("target").tolist(), new.stack("theta").tolist()),
            *(new.stack("omega").tolist(), columns["payload_mass"].tolist()),
            strict=True,
        )
        passed = []
        wanted = [out.wanted for out in (self._sensors, self._voltages, self._path, self._truth)]
        for number, row in enumerate(rows, first):
            time, measured, gripper, present, colour, volts, gripped, target, theta, omega, mass = row
            sample = Sensors(number, time, tuple(measured), gripper, present, colour)
            if wanted[0]:
                self._sensors(sample)
            if wanted[3]:
                self._truth(Truth(time, tuple(theta), tuple(omega), gripper, mass))
            if wanted[1]:
                self._voltages(Voltages(number, time, tuple(volts), gripped))
            if wanted[2]:
                self._path(Path(number, time, tuple(target)))
            passed.append(PassedTick(sample, Acted(number, time, tuple(volts), gripped)))
        for start in range(0, len(passed), TOGETHER):
            self._ticks(PassedTicks(tuple(passed[start : start + TOGETHER])))
        for event in events:
            self._event(event)


class ArmFollower:
    """Collects what is published of an arm in a log, which has what sensors and commands tell and no truth.

    Args:
        bus: session with the station in the place of an arm.
        put: called on a thread of Zenoh with what has come, for `take` on another one.

    Attributes:
        log: what has come; its rows are numbered as the arm's ticks.
    """

    def __init__(self, bus: Bus, put: Callable[[ArmFollower, list[Tick] | Path], None]) -> None:
        self.log = RunLog()
        self._paths: dict[int, Path] = {}
        self._bus = bus
        bus.subscribe(PATH, Path, lambda path: put(self, path))
        bus.subscribe(TICKS, PassedTicks, following_ticks(lambda ticks: put(self, ticks), bus.refuse))

    def take(self, came: list[Tick] | Path) -> None:
        """Takes ticks that have passed, or the path of one, which comes before it."""
        if isinstance(came, Path):
            self._paths[came.sequence] = came
            while len(self._paths) > _WAITING:
                del self._paths[next(iter(self._paths))]
            return
        if came[0][0].sequence < len(self.log):  # the arm has begun anew
            self.log = RunLog()
        for sensors, acted in came:
            path = self._paths.pop(sensors.sequence, None)
            if not len(self.log):
                self.log.forget(sensors.sequence)
            volts = Voltages(sensors.sequence, sensors.time, acted.volts, acted.box_gripped)
            target = sensors.theta if path is None else path.theta  # nobody knows how far it is from its path
            self.log.append(StepRecord(UNKNOWN, sensors, target, volts))

    def forget(self, seconds: float) -> None:
        """Forgets what is older than some seconds."""
        self.log.forget(len(self.log) - round(seconds / PERIOD))
