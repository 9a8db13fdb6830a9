"""Puts rows of the log together from what comes over the bus in several streams."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from dtwin.bus.messages import Acted, Path
from dtwin.parameters import JointVector, every_joint
from dtwin.signals import UNKNOWN, DriveVector, Sensors, StepRecord, Truth, Voltages

PATIENCE: Final = 2.0
"""s that a row waits for what belongs to it, where messages may be lost"""
LOSSLESS_PATIENCE: Final = 30.0
"""s that a row waits where none is lost: what is not there on a busy machine comes, unless its sender is gone"""
PENDING_LIMIT: Final = 20_000
"""rows that wait at most"""
EARLY_LIMIT: Final = 1000
"""ticks that a command may come before its sample: the two come from different senders"""
NO_TARGET: Final[JointVector] = every_joint(math.nan)
_NO_VOLTS: Final[DriveVector] = (0.0, 0.0, 0.0, 0.0)


class _Row:
    __slots__ = ("acted", "came", "command", "path", "sensors", "truth")

    def __init__(self, sensors: Sensors, came: float) -> None:
        self.sensors = sensors
        self.came = came
        self.truth: Truth | None = None
        self.command: Voltages | None = None
        self.acted: Acted | None = None
        self.path: Path | None = None

    def add(self, message: Voltages | Path) -> None:
        if isinstance(message, Path):
            self.path = self.path or message
        else:
            self.command = self.command or message


class Rows:
    """Emits a record for every sample, in order, once all that belongs to it and the next one are there, or too late.

    A row shows what acted on the arm, which the emulator tells before the next sample if it was not the command; a
    row of which nobody told anything shows what acted before. A path that never came is NaN. The truth is NaN where
    nobody knows it; where it comes at all, a row without it is left out.

    Args:
        emit: receives the records.
        restarted: Function that is called before the first sample of a new run, whose numbers have gone back.
            It tells whether the new run counts; otherwise nothing counts any more.
        paths: whether paths are sent at all.
        patience: how long a row waits for what belongs to it, s.

    Attributes:
        late: rows emitted without all their parts.
    """

    def __init__(
        self,
        emit: Callable[[StepRecord], None],
        restarted: Callable[[], bool],
        paths: bool = True,
        patience: float = PATIENCE,
    ) -> None:
        self._emit = emit
        self._restarted = restarted
        self._paths, self._patience = paths, patience
        self._rows: dict[int, _Row] = {}
        self._early: dict[int, list[Voltages | Path]] = {}
        self._last: Sensors | None = None
        self._over = False
        self._told = False
        self._volts = _NO_VOLTS
        self._gripped = False
        self.late = 0

    def sensors(self, sample: Sensors, now: float) -> None:
        """Takes a sample; one that is repeated because nobody answered it counts once."""
        last = self._last
        if self._over:
            return
        if last is not None and sample.sequence <= last.sequence:
            if sample == last:
                return
            self.flush()
            if not self._restarted():
                self._over = True
                return
            self._early.clear()
            self._volts, self._gripped = _NO_VOLTS, False
        self._last = sample
        self._rows[sample.sequence] = row = _Row(sample, now)
        for message in self._early.pop(sample.sequence, ()):
            row.add(message)
        if len(self._early) >= EARLY_LIMIT:
            self._early = {number: kept for number, kept in self._early.items() if self._may_be_early(number)}

    def truth(self, truth: Truth, now: float) -> None:
        """Takes the truth of the last sample; both come from the emulator, in this order."""
        last = self._last
        if last is not None and last.time == truth.time and last.sequence in self._rows:
            self._rows[last.sequence].truth = truth
            self._told = True
            self._emit_due(now)

    def answer(self, message: Voltages | Path, now: float) -> None:
        """Takes the command or the path angles that answer a sample; the first of each counts."""
        row = self._rows.get(message.sequence)
        if row is not None:
            row.add(message)
            self._emit_due(now)
        elif len(self._early) < EARLY_LIMIT and self._may_be_early(message.sequence):
            early = self._early.setdefault(message.sequence, [])
            if not any(type(other) is type(message) for other in early):
                early.append(message)

    def acted(self, message: Acted, now: float) -> None:
        """Takes what acted after the last sample instead of its command; the emulator sends both in this order."""
        row = self._rows.get(message.sequence)
        if row is not None:
            row.acted = message
            self._emit_due(now)

    def flush(self) -> None:
        """Emits all rows."""
        for row in self._rows.values():
            self._finish(row)
        self._rows.clear()

    def _may_be_early(self, sequence: int) -> bool:
        return self._last is None or 0 < sequence - self._last.sequence < EARLY_LIMIT

    def _emit_due(self, now: float) -> None:
        rows = self._rows
        while rows:
            row = next(iter(rows.values()))
            complete = len(rows) > 1 and row.truth and (row.acted or row.command) and (row.path or not self._paths)
            if not complete and now - row.came < self._patience and len(rows) < PENDING_LIMIT:
                return
            self._finish(row)
            del rows[row.sensors.sequence]

    def _finish(self, row: _Row) -> None:
        acted = row.acted or row.command
        if acted is not None:
            self._volts, self._gripped = acted.volts, acted.box_gripped
        if row.truth is None and self._told:
            self.late += 1
            return
        sensors = row.sensors
        if acted is None or (self._paths and row.path is None):
            self.late += 1
        command = Voltages(sensors.sequence, sensors.time, self._volts, self._gripped)
        target = row.path.theta if row.path is not None else NO_TARGET
        self._emit(StepRecord(row.truth or UNKNOWN, sensors, target, command))
