"""What a monitor has heard, on disk, so that one whose process ended is brought back with what it knew.

A monitor is a function of what it hears: one that hears the same again knows the same. The first messages are kept,
in which the healthy arm is learned, and the last ones; those between are missing like ticks that were lost.

    file = { kind[1] length[4] message }

Messages are written whole or not at all. A disk that is full costs what it cannot take: the monitor goes on.
"""

from __future__ import annotations

import io
import logging
import os
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from dtwin.files import append_whole, reason_of

log = logging.getLogger(__name__)

SIZE: Final = 2 << 20
"""Size from which on a file is full, bytes: a minute or two at 100 Hz. A monitor of six joints hears it again in one
second, and a safe stop waits for a silent one for some seconds only."""
FIRST: Final = 3
"""Size of the first file, in which an arm is learned, in such sizes."""
NEWEST: Final = 2
"""Number of files that are kept beside the first one."""
_HEAD: Final = struct.Struct("<BI")


class Heard:
    """Messages that a monitor has heard.

    Args:
        folder: Where the files are; the folder is there. Nothing is kept when None.
        kinds: Types of the messages.
        size: Size from which on a file is full, bytes; that of the first one is FIRST times as large.
    """

    def __init__(self, folder: Path | None, kinds: Sequence[type[msgspec.Struct]], size: int = SIZE) -> None:
        self._folder = folder
        self._kinds = tuple(kinds)
        self._size = self._full = size
        self._decoders = [msgspec.msgpack.Decoder(kind) for kind in self._kinds]
        self._encode = msgspec.msgpack.Encoder().encode
        self._file: io.FileIO | None = None
        self._failing = False

    def entries(self) -> Iterator[msgspec.Struct]:
        """Yields the messages, oldest first; what is damaged in a file is cut off."""
        for path in self._paths():
            try:
                content, end = path.read_bytes(), 0
                for message, after in self._parsed(content):
                    yield message
                    end = after
                os.truncate(path, end)
            except OSError as error:
                log.warning("%s: cannot be read: %s", path, reason_of(error))

    def note(self, message: msgspec.Struct) -> None:
        """Keeps a message, whose type is one of the kinds."""
        if self._folder is None:
            return
        data = self._encode(message)
        try:
            if self._file is None or self._file.tell() >= self._full:
                self._file = self._open()
            append_whole(self._file.fileno(), _HEAD.pack(self._kinds.index(type(message)), len(data)) + data)
        except OSError as error:
            if not self._failing:
                log.warning("what the monitor hears cannot be kept, it goes on without: %s", reason_of(error))
            self._failing = True
        else:
            self._failing = False

    def forget(self) -> None:
        """Keeps nothing of what was heard so far."""
        if self._file is not None:
            self._file.close()
            self._file = None
        for path in self._paths():
            path.unlink(missing_ok=True)

    def _paths(self) -> list[Path]:
        return [] if self._folder is None else sorted(self._folder.iterdir(), key=lambda path: int(path.name))

    def _open(self) -> io.FileIO:
        """The file that is written: the last one, or a new one where that is full."""
        assert self._folder is not None
        if self._file is not None:
            self._file.close()
        paths = self._paths()
        if not paths or paths[-1].stat().st_size >= self._size_of(paths[-1]):
            for path in paths[1 : 1 - NEWEST]:
                path.unlink()
            paths.append(self._folder / str(int(paths[-1].name) + 1 if paths else 0))
        self._full = self._size_of(paths[-1])
        return io.FileIO(paths[-1], "a")

    def _size_of(self, path: Path) -> int:
        """The size from which on a file is full, bytes."""
        return self._size if int(path.name) else FIRST * self._size

    def _parsed(self, content: bytes) -> Iterator[tuple[msgspec.Struct, int]]:
        """The messages up to the first that is not whole, and where each ends."""
        at = 0
        while at + _HEAD.size <= len(content):
            kind, length = _HEAD.unpack_from(content, at)
            at, end = at + _HEAD.size, at + _HEAD.size + length
            if end > len(content) or kind >= len(self._decoders):
                return
            try:
                yield self._decoders[kind].decode(content[at:end]), end
            except msgspec.MsgspecError:
                return
            at = end
