"""A recording as a file on a disk that may be full."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Final

import rerun as rr
import rerun.blueprint as rrb

from dtwin.files import RECORDING, replacing

_CHUNK: Final = 1 << 16
"""Bytes that are copied at once."""


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
