"""The monitor over a log: the same code as online, fed with what sensors and commands said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.bus.twin_messages import MonitoringVerdict
from dtwin.errors import ParameterError
from dtwin.logs.log import Log
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.thesis import ThesisMonitor
from dtwin.monitoring.tracking.samples import NO_TAPE, Samples, Tape
from dtwin.signals import Event, of_monitor

Array = NDArray[np.float64]

SECOND: Final = 100
"""rows"""


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """What a monitor may see of a log.

    Attributes:
        sample: (N,), tick numbers.
        measured: (N, 3), rad.
        volts: (N, 4), that of the gripper last, V.
        gripped: (N,) bool.
        colour: (N,), colour of the box that waits, "" for none.
        jaw: (N,), readings of the gripper's encoder, rad.
    """

    sample: NDArray[np.int64]
    measured: Array
    volts: Array
    gripped: NDArray[np.bool_]
    colour: NDArray[np.str_]
    jaw: Array

    def __len__(self) -> int:
        return len(self.sample)

    def part(self, start: int, stop: int) -> Stream:
        """Rows start to stop - 1."""
        rows = slice(start, stop)
        return Stream(*(getattr(self, field.name)[rows] for field in fields(self)))

    def feed(self, monitor: Monitor | ThesisMonitor, start: int, stop: int) -> None:
        """Gives rows start to stop - 1 to a monitor."""
        if isinstance(monitor, ThesisMonitor):
            for row in range(start, stop):
                monitor.update(
                    int(self.sample[row]), self.measured[row], bool(self.gripped[row]), str(self.colour[row])
                )
            return
        while start < stop:
            start += self.follow(monitor, start, stop)

    def follow(self, monitor: Monitor, start: int, stop: int, tape: Tape = NO_TAPE) -> int:
        """Gives rows from start on, and before stop, to a monitor up to the first at which it notices something;
        returns how many. A tape that is as long as the stream receives what is made of them."""
        rows = slice(start, stop)
        seen = Samples(self.sample[rows], self.measured[rows], self.volts[rows], self.gripped[rows], self.jaw[rows])
        done = monitor.follow(seen, tape.part(start, stop))
        if len(tape.statistic):
            row, estimator = start + done - 1, monitor.estimator
            tape.innovation[row], tape.variance[row] = estimator.innovation, estimator.variance
            tape.score[row], tape.information[row] = estimator.score, estimator.information
            tape.used[row], tape.statistic[row] = monitor.used, monitor.statistic
            tape.statistics[row] = monitor.statistics
        return done


def stream(log: Log) -> Stream:
    """The readings and commands of a log; no truth, no masses.

    Raises:
        ParameterError: the log is empty.
    """
    if not len(log):
        raise ParameterError("the log is empty: expected at least one tick to monitor")
    return Stream(
        log.ticks(),
        log.stack("measured"),
        log.stack("volts"),
        log.columns["box_gripped"],
        log.columns["box_colour"],
        log.columns["gripper"],
    )


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What the default monitor made of every sample, to be drawn.

    Attributes:
        predicted: (N, 3), what the encoders should have read, rad.
        deviation: (N, 3), standard deviation of the readings about it, rad.
        statistic: (N,), the strongest evidence of a fault, 2 log likelihood ratio.
        threshold: value of the statistic from which on a change is diagnosed.
        verdicts: the opinion, from the row at which it came to be on; the first is for row 0.
        events: everything that was noticed.
    """

    predicted: Array
    deviation: Array
    statistic: Array
    threshold: float
    verdicts: tuple[tuple[int, MonitoringVerdict], ...]
    events: tuple[Event, ...]


def watch(monitor: Monitor, seen: Stream, progress: Callable[[int], None] = lambda done: None) -> Trace:
    """Gives a whole log to a fresh monitor; `progress` is told the rows done once a second of plant time."""
    tape = Tape.of(len(seen))
    verdicts: list[tuple[int, MonitoringVerdict]] = []
    noticed, done = -1, 0
    while done < len(seen):
        next_second = -(-done // SECOND) * SECOND + 1
        done += seen.follow(monitor, done, min(next_second, len(seen)), tape)
        row = done - 1
        if row % SECOND == 0 or len(monitor.events) != noticed:
            noticed = len(monitor.events)
            verdict = monitor.verdict()
            if not verdicts or _content(verdict) != _content(verdicts[-1][1]):
                verdicts.append((row, verdict))
            progress(done)
    predicted, deviation = seen.measured - tape.innovation, np.sqrt(tape.variance)
    return Trace(predicted, deviation, tape.statistic, monitor.threshold, tuple(verdicts), of_monitor(monitor.events))


def _content(verdict: MonitoringVerdict) -> list[tuple[object, ...]]:
    """What must change for a verdict to be another one; sizes are refined all the time."""
    return [(unit.state, unit.parameter, unit.settled) for unit in verdict.units.values()]
