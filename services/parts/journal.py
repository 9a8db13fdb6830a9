"""What an emulated cell has been told, tick by tick, so that one that was killed can be brought back as it was.

The emulation is a function of its settings and its commands: a journal holds the seed, then every tick's command and
every fault in the order they came, and replaying it gives the same cell to the bit. Beside them it holds the latched
stop, which outlives the cell: a journal that begins anew keeps it. A record is written whole or not at all;
what a kill leaves of the last one is cut off. So that neither the file nor the replay grows with the
run, the journal begins anew with a checkpoint, the state of the cell, from time to time. Hundreds of records a
second would be too many lines of text for a `LineFile`; both append with `append_whole`.

    journal = MAGIC, seed, stop, [ "C" length state ], { "V" volts[4] gripped | "F" length text | stop }
    stop = "S" number stop

A disk that is full costs what it cannot take and nothing else: the journal keeps what it holds, the cell goes on, and
a checkpoint begins the journal anew when there is room. A stop that finds no room takes that of the ticks.
"""

from __future__ import annotations

import io
import logging
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dtwin.errors import RecordingError
from dtwin.files import NO_SPACE, append_whole, reason_of, replacing
from dtwin.services.parts.latch import Latched
from dtwin.signals import STOPS, DriveVector

log = logging.getLogger(__name__)

MAGIC: Final = b"dtwin journal 3\n"
_EARLIER: Final = (b"dtwin journal 1\n", b"dtwin journal 2\n")
"""Heads of the layouts without stops and without checkpoints, which are read as journals that hold none."""
ROTATION: Final = 6000
"""Number of ticks after which a checkpoint is due."""
RETRY: Final = 100
"""Number of ticks after which a checkpoint is due when the journal could not be written."""
_SEED: Final = struct.Struct("<Q")
_COMMAND: Final = struct.Struct("<c4d?")
_TEXT: Final = struct.Struct("<cH")
_STOP: Final = struct.Struct("<cQB")
_STATE: Final = struct.Struct("<cI")

Entry = tuple[DriveVector, bool] | str | bytes
"""A tick's volts and whether a box was held, a fault, or, first of all, the state of a checkpoint."""


class Journal:
    """Appends to a journal; opening one that exists keeps what it holds, for `entries`.

    Args:
        path: path of the file.
        seed: number of the random generators of the cell, for a new journal.

    Attributes:
        seed: number of the random generators of the cell that the journal is about.
        latched: stop that was latched last.
        news: what happened to the file, in words; whoever reads it clears it.

    Raises:
        RecordingError: the file cannot be opened for another reason than a full disk, or is no journal.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self._path = path
        self.seed = seed
        self.latched = Latched()
        self.news: list[str] = []
        self._entries: list[Entry] = []
        self._ticks = 0
        self._complete = True
        self._failing = False
        self._file: io.FileIO | None = None
        try:
            self._file = io.FileIO(path, "r+" if path.exists() else "w+")
            content = self._file.readall()
        except OSError as error:
            if error.errno not in NO_SPACE:
                raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from None
            self._fail(str(error.strerror))
            return
        head = len(MAGIC) + _SEED.size
        if len(content) < head:
            self.restart(seed)
            return
        if not content.startswith((MAGIC, *_EARLIER)):
            raise RecordingError(f"{path}: expected a journal of an emulated cell")
        self.seed = _SEED.unpack_from(content, len(MAGIC))[0]
        records = list(_parse(content, head))
        for record, _ in records:
            if isinstance(record, Latched):
                self.latched = record
            else:
                self._entries.append(record)
        self._file.seek(0)
        self._file.write(MAGIC)
        self._ticks = sum(isinstance(entry, tuple) for entry in self._entries)
        self._cut(records[-1][1] if records else head)

    @property
    def due(self) -> bool:
        """Whether it is time for a checkpoint."""
        return self._ticks >= (RETRY if self._failing else ROTATION)

    def entries(self) -> list[Entry]:
        """What the journal held when it was opened, oldest first; afterwards it is forgotten."""
        entries, self._entries = self._entries, []
        return entries

    def restart(self, seed: int) -> None:
        """Forgets everything but the latched stop: the cell starts anew."""
        self.seed = seed
        self._rewrite(b"")
        if self._failing and self._file is not None:
            # An emulator that is started again must not go on with the run that is over.
            self._keep_stop_alone()

    def checkpoint(self, state: bytes) -> None:
        """Begins anew with the state of the cell, which makes everything before it superfluous."""
        self._rewrite(_STATE.pack(b"C", len(state)) + state)

    def command(self, volts: DriveVector, gripped: bool) -> None:
        """Notes a tick and the command that held in it."""
        self._ticks += 1
        self._append(_COMMAND.pack(b"V", *volts, gripped))

    def fault(self, text: str) -> None:
        """Notes a fault that came before the next tick."""
        data = text.encode()
        self._append(_TEXT.pack(b"F", len(data)) + data)

    def latch(self, latched: Latched) -> None:
        """Notes a stop that is latched, or released."""
        self.latched = latched
        if not self._try(_packed(latched)) and self._file is not None:
            self._keep_stop_alone()

    def close(self) -> None:
        if self._file is not None:
            self._file.close()

    def _append(self, record: bytes) -> None:
        """Writes a record whole; after one that could not be written none is, until the journal begins anew."""
        if self._complete:
            self._try(record)

    def _try(self, record: bytes) -> bool:
        """Writes a record whole or not at all; returns whether it was written."""
        if self._file is None:
            return False
        try:
            append_whole(self._file.fileno(), record)
        except OSError as error:
            self._complete = False
            self._fail(reason_of(error))
            return False
        return True

    def _keep_stop_alone(self) -> None:
        """Leaves nothing but the stop in the file, which even a full disk takes: it needs less room than before."""
        self._cut(0)
        self._complete = False
        self._try(MAGIC + _SEED.pack(self.seed) + _packed(self.latched))

    def _rewrite(self, content: bytes) -> None:
        """Replaces the file by a journal with this content; where that cannot be done it stays as it is."""
        self._ticks = 0
        head = MAGIC + _SEED.pack(self.seed) + _packed(self.latched)
        try:
            with replacing(self._path) as temporary:
                temporary.write_bytes(head + content)
                file = io.FileIO(temporary, "r+")
        except RecordingError as error:
            self._fail(str(error))
            return
        self.close()
        self._file = file
        self._cut(len(head) + len(content))
        self._complete = True
        if self._failing:
            self._failing = False
            self.news.append("the journal is written again")

    def _cut(self, end: int) -> None:
        assert self._file is not None
        self._file.truncate(end)

    def _fail(self, reason: str) -> None:
        if not self._failing:
            self._failing = True
            self.news.append(f"the journal cannot be written, the cell goes on without it: {reason}")


def carry_over(path: Path, seed: int) -> None:
    """Ends the journal of a run that was killed: what is left of it is a stop that nobody has released.

    A file that is no journal is set aside. It may have held a stop, so one is latched.

    Args:
        path: path of the journal, which need not exist.
        seed: seed of the cell that starts now.

    Raises:
        RecordingError: the file can be neither read nor set aside.
    """
    if not path.exists():
        return
    try:
        journal = Journal(path, seed)
    except RecordingError as error:
        aside = path.with_name(f"{path.name}.unreadable")
        log.warning("%s: it is set aside as %s, and the arm is stopped", error, aside.name)
        try:
            os.replace(path, aside)
        except OSError:
            raise error from None
        journal = Journal(path, seed)
        journal.latched = Latched(1, "torque off")
    stopped = journal.latched.stop != "none"
    if stopped:
        journal.restart(seed)
    journal.close()
    if not stopped:
        path.unlink()


def _packed(latched: Latched) -> bytes:
    return _STOP.pack(b"S", latched.number, STOPS.index(latched.stop))


def _parse(content: bytes, at: int) -> Iterator[tuple[Entry | Latched, int]]:
    """Whole records and where each ends; stops at the first that is not whole."""
    while at < len(content):
        kind = content[at : at + 1]
        layout = {b"V": _COMMAND, b"F": _TEXT, b"C": _STATE, b"S": _STOP}.get(kind)
        if layout is None or at + layout.size > len(content):
            return
        _, *values = layout.unpack_from(content, at)
        at += layout.size
        if layout is _COMMAND:
            v_1, v_2, v_3, v_4, gripped = values
            yield ((v_1, v_2, v_3, v_4), gripped), at
            continue
        if layout is _STOP:
            number, stop = values
            if stop >= len(STOPS):
                return
            yield Latched(number, STOPS[stop]), at
            continue
        end = at + values[0]
        if end > len(content):
            return
        data = content[at:end]
        yield (data if layout is _STATE else data.decode()), end
        at = end
