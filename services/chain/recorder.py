"""The log of an arm of n joints, from the ticks that have passed on the bus; the columns of `dtwin run --log`.

The log is written as a whole once a minute, and at the end; a recorder that was killed goes on with what it wrote.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow.parquet as pq

from dtwin.arm.chain import Array
from dtwin.bus.chain.messages import JointTick, JointTicks
from dtwin.bus.messages import EVENTS, JOINT_TICKS
from dtwin.errors import RecordingError
from dtwin.run.chain import GRIPPED, ChainRun, ChainSettings
from dtwin.services.chain.options import ArmCellOptions
from dtwin.services.parts.missed.leaving import LastMessages
from dtwin.services.service import Link, Service, main
from dtwin.services.supervisor import PREPARED
from dtwin.signals import Event, EventKind

log = logging.getLogger(__name__)

NAME: Final = "recorder"
KEEP: Final = 60.0
"""Time between two times that the log is written, s."""
WAIT: Final = 0.5
"""Longest wait for ticks before the status is looked after, s."""
MOST: Final = 86_400.0
"""Longest log, s: all its rows are kept in memory."""
_FEW: Final = 4096
_LEAVING: Final = JointTicks(())
"""Stands in the inbox for the word of the emulator that it is about to leave."""


@dataclass(frozen=True, kw_only=True)
class Options(ArmCellOptions, Link):
    """Write the log of an arm."""

    log: Path
    """Parquet log to write."""

    def run(self) -> int:
        settings = self.settings()
        rows = Rows(settings)
        if PREPARED in os.environ and self.log.exists():
            rows.go_on(self.log)
        with Service(NAME, self) as service:
            Recorder(service, rows, self.log).run()
        return 0


class Rows:
    """What has passed, a row for each tick.

    Args:
        settings: run of the arm.
    """

    def __init__(self, settings: ChainSettings) -> None:
        self._settings = settings
        self._most = round(MOST / settings.arm.period)
        self.clear()

    def clear(self) -> None:
        """Forgets all rows."""
        self.count = 0
        self._t, self._gripped = np.zeros(_FEW), np.zeros(_FEW, dtype=bool)
        self._values = np.zeros((3, _FEW, len(self._settings.arm)))

    def go_on(self, path: Path) -> None:
        """Takes the rows of a log that an earlier recorder has written.

        Raises:
            RecordingError: it cannot be read.
        """
        try:
            table = pq.read_table(path)
            t = np.asarray(table["t"])
            gripped = np.asarray(table[GRIPPED]) if GRIPPED in table.column_names else np.zeros(len(t), dtype=bool)
            columns = [
                [np.asarray(table[f"{name}_{k + 1}"]) for k in range(len(self._settings.arm))]
                for name in ("q", "target", "sent")
            ]
        except (OSError, ValueError, KeyError) as error:
            raise RecordingError(f"{path}: cannot be gone on with: {error}") from None
        for row, values, closed in zip(t, np.array(columns).transpose(2, 0, 1), gripped, strict=True):
            self._append(float(row), values, bool(closed))

    @property
    def last(self) -> float:
        """Time of the last row, s; -1 without any."""
        return float(self._t[self.count - 1]) if self.count else -1.0

    def add(self, tick: JointTick) -> bool:
        """Takes a tick that is later than the last one; whether it was taken."""
        if tick.sensors.time <= self.last or self.count >= self._most:
            return False
        values = tick.sensors.theta, tick.acted.target, tick.acted.commands
        self._append(tick.sensors.time, values, tick.acted.gripped)
        return True

    def _append(self, t: float, values: tuple[tuple[float, ...], ...] | Array, gripped: bool) -> None:
        if self.count == len(self._t):
            self._t = np.concatenate([self._t, np.zeros_like(self._t)])
            self._gripped = np.concatenate([self._gripped, np.zeros_like(self._gripped)])
            self._values = np.concatenate([self._values, np.zeros_like(self._values)], axis=1)
        self._t[self.count], self._gripped[self.count] = t, gripped
        self._values[:, self.count] = values
        self.count += 1

    def run(self) -> ChainRun:
        """The rows as a run; what truly was is not known, and stands as it was measured."""
        count = self.count
        q, target, sent = (self._values[k, :count] for k in range(3))
        t, gripped = self._t[:count], self._gripped[:count]
        return ChainRun(self._settings, t, q, target, sent, q, np.zeros(count), 0, 0.0, gripped)


class Recorder:
    """Takes ticks and writes the log.

    Args:
        service: frame of this service.
        rows: rows so far.
        path: file of the log.
    """

    def __init__(self, service: Service, rows: Rows, path: Path) -> None:
        self._service = service
        self._rows = rows
        self._path = path
        self._number = 1
        self._left_out = 0
        self._tell = service.bus.publisher(EVENTS)
        service.bus.subscribe(JOINT_TICKS, JointTicks, service.inbox.put)

    def run(self) -> None:
        """Records until it is asked to end, and what was on its way then."""
        service = self._service
        last = LastMessages(service, _LEAVING)
        service.ready()
        due = time.monotonic() + KEEP
        while not service.stopping:
            self._deal_with(service.next(WAIT))
            if time.monotonic() >= due:
                self._keep()
                due = time.monotonic() + KEEP
            if service.report_due():
                self._report()
        for passed in last:
            self._deal_with(passed)
        self._keep()

    def _report(self) -> None:
        time = max(0.0, self._rows.last)
        self._service.report("running", self._rows.count, time=time, late_ticks=self._left_out)

    def _deal_with(self, passed: JointTicks | None) -> None:
        if passed is _LEAVING:
            self._report()  # It stays until it knows that all rows are here.
        for tick in () if passed is None else passed.ticks:
            if tick.sensors.sequence == 0 and self._rows.count:
                self._begin_another()
            self._left_out += not self._rows.add(tick)

    def _begin_another(self) -> None:
        """Ends the log of an arm that has begun anew, and begins one of the next number."""
        self._keep()
        self._rows.clear()
        self._number += 1
        text = f"the arm has begun anew: its log goes on in {self._file.name}"
        self._tell(Event(0.0, EventKind.RECORDING, text))

    @property
    def _file(self) -> Path:
        return self._path if self._number == 1 else self._path.with_stem(f"{self._path.stem}-{self._number}")

    def _keep(self) -> None:
        if not self._rows.count:
            return
        try:
            self._rows.run().save(self._file)
        except RecordingError as error:
            log.warning("%s", error)
            self._tell(Event(max(0.0, self._rows.last), EventKind.DISK, str(error)[:1000]))


if __name__ == "__main__":
    sys.exit(main(NAME, Options))
