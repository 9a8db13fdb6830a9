"""Takes the records that machine code makes of events, and writes them in packets."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any, Final

from iec61499.native.tracing import TracedEvent
from iec61499.trace.ctf import TraceWriter
from iec61499.trace.recorder import Recorder

ROOM: Final = 1_000_000
"""Bytes of records that become a packet, beside those of the longest record."""


class _Trace(ctypes.Structure):
    """`struct fb_trace`."""

    flush: Any
    used: int
    records: int

    _fields_ = (
        ("flush", ctypes.CFUNCTYPE(None)),
        ("buffer", ctypes.c_void_p),
        ("size", ctypes.c_uint64),
        ("used", ctypes.c_uint64),
        ("records", ctypes.c_uint64),
        ("time", ctypes.c_int64),
        ("kinds", ctypes.c_void_p),
    )


class NativeRecorder:
    """Records the events of a unit.

    The time of all records is 0, as time does not move in what machine code runs.

    Args:
        writer: writes the trace.
        events: the events that the unit records.

    Attributes:
        address: the address of what the unit writes to.
    """

    def __init__(self, writer: TraceWriter, events: Sequence[TracedEvent]) -> None:
        self._writer = writer
        self._values = Recorder(writer)
        kinds = [writer.kind(event.name, event.fields).number for event in events]
        size = ROOM + max((event.longest for event in events), default=0)
        self._kinds = (ctypes.c_uint16 * len(kinds))(*kinds)
        self._buffer = ctypes.create_string_buffer(size)
        buffer, table = ctypes.addressof(self._buffer), ctypes.addressof(self._kinds)
        self._flush = ctypes.CFUNCTYPE(None)(self.flush)
        self._trace = _Trace(self._flush, buffer, size, 0, 0, 0, table)
        self.address = ctypes.addressof(self._trace)
        writer.end_with(self.flush)

    def start(self, states: Mapping[str, dict[str, Any]]) -> None:
        """Records the variables of all blocks, by the name of the block."""
        self._values.start(0, dict(states))

    def written(self, name: str, value: Any) -> None:
        """Records that a variable, `BLOCK.VARIABLE`, has been given a value from outside."""
        self.flush()
        self._values.written(0, name, value)

    def flush(self) -> None:
        """Writes what has not been written yet."""
        self._values.flush()
        trace = self._trace
        if trace.records:
            self._writer.write(ctypes.string_at(self._buffer, trace.used), trace.records, 0, 0)
            trace.used = trace.records = 0
