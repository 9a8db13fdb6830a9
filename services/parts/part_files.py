"""Where the parts of a log lie while it grows, and which recording of a run is the one that grows."""

from __future__ import annotations

import contextlib
import re
import shutil
from pathlib import Path
from typing import Final

SUFFIX: Final = ".parts"
"""End of the name of the folder of parts, after the log's name; any Parquet reader takes the folder for one table."""
WHOLE: Final = "whole"
"""Name of the file in that folder which says that the log itself holds all rows so far."""
_BEGUN: Final = re.compile(r"recording-(\d+)")
"""Names of the files in the first recording's folder which say which recordings of the run have begun."""


def folder_of(path: Path) -> Path:
    """The folder of the parts of the log `path`."""
    return path.with_name(path.name + SUFFIX)


def numbered(path: Path, number: int) -> Path:
    """The file of one of a run's recordings: the first has the name that was asked for, the others get a number."""
    return path if number == 1 else path.with_stem(f"{path.stem}-{number}")


def begun(path: Path) -> int:
    """Number of the last recording of a run that is marked as begun, 0 for none.

    Args:
        path: the first log of the run, or its first recording where there is no log.
    """
    names = map(_BEGUN.fullmatch, _names(folder_of(path)))
    return max((int(match[1]) for match in names if match), default=0)


def first_recording(log: Path | None, record: Path | None, resumable: bool) -> int:
    """Number of the recording that a new recorder goes on with, or begins because no log holds the rows before."""
    if resumable and log is not None:
        return max(begun(log), 1)
    if resumable and record is not None:
        return begun(record) + 1
    return 1


def mark_begun(path: Path, number: int) -> None:
    """Marks a recording of the run with the first log or recording `path` as begun, if there is room for that."""
    folder = folder_of(path)
    with contextlib.suppress(OSError):
        folder.mkdir(exist_ok=True)
        (folder / f"recording-{number}").touch()


def discard_parts(path: Path) -> None:
    """Forgets what an earlier run left unfinished of the log `path`, and the marks beside it."""
    shutil.rmtree(folder_of(path), ignore_errors=True)


def discard_markers(path: Path) -> None:
    """Forgets the folders of parts of a run with the first log or recording `path` that hold nothing but marks."""
    for file in {numbered(path, max(begun(path), 1)), path}:
        if all(name == WHOLE or _BEGUN.fullmatch(name) for name in _names(folder_of(file))):
            discard_parts(file)


def _names(folder: Path) -> list[str]:
    return [file.name for file in folder.iterdir()] if folder.is_dir() else []
