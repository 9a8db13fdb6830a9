"""A recording as a file on a disk that may be full."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

import rerun as rr
import rerun.blueprint as rrb

from dtwin.errors import NoSpaceError
from dtwin.files import RECORDING, ensure_writable, replacing

_CHUNK: Final = 1 << 16
"""Bytes that are copied at once."""
RESERVE: Final = 64 << 20
"""Room on the disk below which no more is sent to a file, bytes: Rerun waits for ever for a disk that is full."""


@contextmanager
def saving(stream: rr.RecordingStream, path: Path, layout: rrb.Blueprint) -> Iterator[None]:
    """Saves what is logged to a stream meanwhile; the file appears complete or not at all.

    Rerun does not come back from a file that cannot be written. So it writes into a pipe, from which a thread copies.

    Args:
        stream: Stream to which nothing has been logged; it is disconnected in the end.
        path: Path of the .rrd file.
        layout: Layout in which the viewer shows it.

    Raises:
        NoSpaceError: There is no room for the file.
        RecordingError: The path cannot be written.
    """
    with replacing(path, RECORDING) as temporary, temporary.open("wb") as file:
        failures: list[OSError] = []
        source, sink = os.pipe()
        copier = threading.Thread(target=_copy, args=(source, file, failures))
        try:
            copier.start()
            with stream:
                stream.save(f"/dev/fd/{sink}", default_blueprint=layout)
                os.close(sink)
                yield
        finally:
            stream.disconnect()
            copier.join()
            os.close(source)
        if failures:
            raise failures[0]


def _copy(source: int, file: BinaryIO, failures: list[OSError]) -> None:
    """Copies to a file until the pipe ends; after a failure it only empties the pipe."""
    while data := os.read(source, _CHUNK):
        try:
            if not failures:
                file.write(data)
        except OSError as error:
            failures.append(error)
    try:
        if not failures:
            file.flush()
    except OSError as error:
        failures.append(error)


class RecordingFile:
    """A recording on disk.

    Args:
        path: the file.

    Attributes:
        begun: what is to be written until `appear`.
        appeared: whether the file is in the place of an earlier one.

    Raises:
        NoSpaceError: there is no room for it.
        RecordingError: it cannot be written.
    """

    def __init__(self, path: Path) -> None:
        if not has_room(path):
            raise NoSpaceError(f"{path}: cannot be written: no space left on device")
        ensure_writable(path)
        self._path = path
        self.begun = path.with_name(f".{path.name}.part")
        self.appeared = False

    @property
    def has_room(self) -> bool:
        """Whether there is room for more."""
        return has_room(self._path)

    def appear(self) -> None:
        """Puts the file into its place, which may be what a killed recorder left, once its rows hold all of that."""
        if not self.appeared:
            os.replace(self.begun, self._path)
            self.appeared = True

    def discard(self) -> None:
        """Leaves nothing of a file that has not appeared."""
        if not self.appeared:
            self.begun.unlink(missing_ok=True)


def has_room(file: Path) -> bool:
    """Whether the disk has the reserve of room for a file."""
    return shutil.disk_usage(file.parent).free >= RESERVE
