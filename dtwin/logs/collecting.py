"""The log of a run that goes on, collected in memory tick by tick."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.logs.log import COLUMNS, NUMBERS, Log, read_only
from dtwin.signals import NO_COLOUR, Event, StepRecord

_ROW: Final = struct.Struct(f"={len(NUMBERS)}d?H?")
_ROW_DTYPE: Final = np.dtype(
    [*((name, "<f8") for name in NUMBERS), ("box_present", "?"), ("box_colour", "<u2"), ("box_gripped", "?")]
)
_pack_row: Final = _ROW.pack
_TARGET, _MEASURED = (slice(at := NUMBERS.index(f"{name}_1"), at + 3) for name in ("target", "measured"))


class Tail(NamedTuple):
    """The newest ticks of a log, as far as they tell how an arm works.

    Attributes:
        target: the path, (n, 3), rad.
        measured: measured angles, (n, 3), rad.
        boxes: number of the place of the box that waits, (n,), from 1, 0 for none.
        gripped: whether the gripper is closed, (n,).
    """

    target: NDArray[np.float64]
    measured: NDArray[np.float64]
    boxes: NDArray[np.int64]
    gripped: NDArray[np.bool_]


class RunLog:
    """Collects ticks and events of a running cell; a tick takes 155 bytes and less than a microsecond.

    Attributes:
        metadata: JSON values that are kept with the log.
        forgotten: number of ticks before the first that it still has.
    """

    __slots__ = ("_codes", "_events", "_rows", "forgotten", "metadata")

    def __init__(self, metadata: Mapping[str, Any] | None = None) -> None:
        """Starts an empty log.

        Args:
            metadata: JSON values to keep with the log, such as seed and parameters.
        """
        self.metadata: Mapping[str, Any] = dict(metadata or {})
        self._rows = bytearray()
        self._codes: dict[str, int] = {NO_COLOUR: 0}
        self._events: list[Event] = []
        self.forgotten = 0

    def __len__(self) -> int:
        """Number of ticks so far, those that were forgotten, too."""
        return self.forgotten + len(self._rows) // _ROW.size

    def append(self, record: StepRecord) -> None:
        """Adds one tick."""
        sensors = record.sensors
        truth = record.truth
        command = record.voltages
        codes = self._codes
        self._rows += _pack_row(
            sensors.time,
            *truth.theta,
            *truth.omega,
            *sensors.theta,
            *record.target,
            *command.volts,
            sensors.gripper,
            truth.payload_mass,
            sensors.box_present,
            codes.setdefault(sensors.box_colour, len(codes)),
            command.box_gripped,
        )

    def extend(self, numbers: NDArray[np.float64], box_present: bool, box_colour: str, gripped: bool) -> None:
        """Adds n ticks with the same box and grip, and the values of NUMBERS of each, (n, 19)."""
        rows = np.empty(len(numbers), _ROW_DTYPE)
        whole = rows.view(np.uint8).reshape(len(numbers), _ROW.size)
        whole[:, : 8 * len(NUMBERS)] = np.ascontiguousarray(numbers, "<f8").view(np.uint8)
        rows["box_present"], rows["box_gripped"] = box_present, gripped
        rows["box_colour"] = self._codes.setdefault(box_colour, len(self._codes))
        self._rows += rows.tobytes()

    def add_events(self, events: Iterable[Event]) -> None:
        """Adds events, which must come in order of time."""
        self._events.extend(events)

    def freeze(self) -> Log:
        """An independent copy of what has been collected so far."""
        return self.since(0)

    def forget(self, before: int) -> None:
        """Forgets the ticks before a number, and all events; one that is still to come is the first one then."""
        if before > self.forgotten:
            del self._rows[: (before - self.forgotten) * _ROW.size]
            self.forgotten = before
            self._events.clear()

    def tail(self, first: int, places: Sequence[str]) -> Tail:
        """The ticks from a number on, as far as it still has them, without what says nothing of its work.

        Args:
            first: number of the first tick.
            places: names of the places for boxes.
        """
        rows = np.frombuffer(self._rows, dtype=_ROW_DTYPE, offset=max(0, first - self.forgotten) * _ROW.size)
        bytewise = rows.view(np.uint8).reshape(len(rows), _ROW.size)
        numbers = np.ascontiguousarray(bytewise[:, : 8 * len(NUMBERS)]).view("<f8")
        place_of = np.array([places.index(name) + 1 if name in places else 0 for name in self._codes])
        boxes = np.where(rows["box_present"], place_of[rows["box_colour"]], 0)
        return Tail(numbers[:, _TARGET], numbers[:, _MEASURED], boxes, rows["box_gripped"].copy())

    def since(self, first: int) -> Log:
        """An independent copy of the ticks from a number on, as far as it still has them, with all events."""
        rows = np.frombuffer(self._rows, dtype=_ROW_DTYPE, offset=max(0, first - self.forgotten) * _ROW.size)
        columns = {name: rows[name].copy() for name in COLUMNS}
        columns["box_colour"] = np.array(list(self._codes))[columns["box_colour"]]
        return Log(read_only(columns), tuple(self._events), self.metadata)
