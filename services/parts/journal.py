"""What an emulated cell has been told, tick by tick, so that one that was killed can be brought back as it was.

The emulation is a function of its settings and its commands: a journal holds the seed, then every tick's command and
every fault in the order they came, and replaying it gives the same cell to the bit. A record is written whole with
one system call; what a kill leaves of the last one is cut off.

    journal = MAGIC, seed, { "V" volts[4] gripped | "F" length text }
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dtwin.errors import RecordingError
from dtwin.signals import Quad

MAGIC: Final = b"dtwin journal 1\n"
_SEED: Final = struct.Struct("<Q")
_COMMAND: Final = struct.Struct("<c4d?")
_TEXT: Final = struct.Struct("<cH")

Entry = tuple[Quad, bool] | str
"""A tick's volts and whether a box was held, or a fault."""


class Journal:
    """Appends to a journal; opening one that exists keeps what it holds, for `entries`.

    Args:
        path: of the file.
        seed: of the cell, for a new journal.

    Attributes:
        seed: of the cell the journal is about.

    Raises:
        RecordingError: the file cannot be opened, or is no journal.
    """

    def __init__(self, path: Path, seed: int) -> None:
        self._path = path
        self.seed = seed
        try:
            self._file = path.open("r+b" if path.exists() else "w+b", buffering=0)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be opened: {error.strerror}") from None
        content = self._file.read()
        head = len(MAGIC) + _SEED.size
        if len(content) < head:
            self.restart(seed)
            self._entries: list[Entry] = []
            return
        if not content.startswith(MAGIC):
            raise RecordingError(f"{path}: expected a journal of an emulated cell")
        self.seed = _SEED.unpack_from(content, len(MAGIC))[0]
        records = list(_parse(content, head))
        self._entries = [entry for entry, _ in records]
        self._file.seek(records[-1][1] if records else head)
        self._file.truncate()

    def entries(self) -> list[Entry]:
        """What the journal held when it was opened, oldest first."""
        return self._entries

    def restart(self, seed: int) -> None:
        """Forgets everything: the cell starts anew."""
        self.seed = seed
        self._file.seek(0)
        self._file.truncate()
        self._file.write(MAGIC + _SEED.pack(seed))

    def command(self, volts: Quad, gripped: bool) -> None:
        """Notes a tick and the command that held in it."""
        self._file.write(_COMMAND.pack(b"V", *volts, gripped))

    def fault(self, text: str) -> None:
        """Notes a fault that came before the next tick."""
        data = text.encode()
        self._file.write(_TEXT.pack(b"F", len(data)) + data)

    def close(self) -> None:
        self._file.close()


def _parse(content: bytes, at: int) -> Iterator[tuple[Entry, int]]:
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
        else:
            return
