"""What an emulated cell has been told, tick by tick, so that one that was killed can be brought back as it was.

The emulation is a function of its settings and its commands: a journal holds the seed, then every tick's command and
every fault in the order they came, and replaying it gives the same cell to the bit. Beside them it holds the latched
stop, which outlives the cell: a journal that begins anew keeps it. A record is written whole with one system call;
what a kill leaves of the last one is cut off.

    journal = MAGIC, seed, { "V" volts[4] gripped | "F" length text | "S" number stop }
"""

from __future__ import annotations

import logging
import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dtwin.errors import RecordingError
from dtwin.signals import STOPS, Quad
from services.parts.latch import Latched

log = logging.getLogger(__name__)

MAGIC: Final = b"dtwin journal 2\n"
_EARLIER: Final = b"dtwin journal 1\n"
"""Head of the layout without stops, which is read as one that holds none."""
_SEED: Final = struct.Struct("<Q")
_COMMAND: Final = struct.Struct("<c4d?")
_TEXT: Final = struct.Struct("<cH")
_STOP: Final = struct.Struct("<cQB")

Entry = tuple[Quad, bool] | str
"""A tick's volts and whether a box was held, or a fault."""


class Journal:
    """Appends to a journal; opening one that exists keeps what it holds, for `entries`.

    Args:
        path: of the file.
        seed: of the cell, for a new journal.

    Attributes:
        seed: of the cell the journal is about.
        latched: stop that was latched last.

    Raises:
        RecordingError: the file cannot be opened, or is no journal.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self._path = path
        self.seed = seed
        self.latched = Latched()
        self._entries: list[Entry] = []
        try:
            self._file = path.open("r+b" if path.exists() else "w+b", buffering=0)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from None
        content = self._file.read()
        head = len(MAGIC) + _SEED.size
        if len(content) < head:
            self.restart(seed)
            return
        if not content.startswith((MAGIC, _EARLIER)):
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
        self._file.seek(records[-1][1] if records else head)
        self._file.truncate()

    def entries(self) -> list[Entry]:
        """What the journal held when it was opened, oldest first."""
        return self._entries

    def restart(self, seed: int) -> None:
        """Forgets everything but the latched stop: the cell starts anew."""
        self.seed = seed
        # A file in place of the old one: a kill meanwhile must not lose the stop.
        fresh = self._path.with_name(f"{self._path.name}.new")
        file = fresh.open("w+b", buffering=0)
        file.write(MAGIC + _SEED.pack(seed) + _packed(self.latched))
        os.replace(fresh, self._path)
        self._file.close()
        self._file = file

    def command(self, volts: Quad, gripped: bool) -> None:
        """Notes a tick and the command that held in it."""
        self._file.write(_COMMAND.pack(b"V", *volts, gripped))

    def fault(self, text: str) -> None:
        """Notes a fault that came before the next tick."""
        data = text.encode()
        self._file.write(_TEXT.pack(b"F", len(data)) + data)

    def latch(self, latched: Latched) -> None:
        """Notes a stop that is latched, or released."""
        self._file.write(_packed(latched))
        self.latched = latched

    def close(self) -> None:
        self._file.close()


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
    size = len(content)
    while at < size:
        if content[at : at + 1] == b"V" and at + _COMMAND.size <= size:
            _, v_1, v_2, v_3, v_4, gripped = _COMMAND.unpack_from(content, at)
            at += _COMMAND.size
            yield ((v_1, v_2, v_3, v_4), gripped), at
        elif content[at : at + 1] == b"F" and at + _TEXT.size <= size:
            length = _TEXT.unpack_from(content, at)[1]
            end = at + _TEXT.size + length
            if end > size:
                return
            yield content[at + _TEXT.size : end].decode(), end
            at = end
        elif content[at : at + 1] == b"S" and at + _STOP.size <= size:
            _, number, stop = _STOP.unpack_from(content, at)
            if stop >= len(STOPS):
                return
            at += _STOP.size
            yield Latched(number, STOPS[stop]), at
        else:
            return
