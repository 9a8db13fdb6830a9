"""Files that appear complete or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dtwin.errors import NoSpaceError, RecordingError, choices

NO_SPACE: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Numbers of the system's errors that say that there is no room for a file."""
LOG: Final = ".parquet"
"""Ending of the names of logs."""
RECORDING: Final = ".rrd"
"""Ending of the names of recordings for the Rerun viewer."""
PICTURE: Final = ".png"
"""Ending of the names of pictures."""


def ensure_writable(path: Path, *endings: str) -> None:
    """Checks that a file can be written at `path`, so that a long run does not fail at its end.

    Args:
        path: file to be written.
        endings: endings of names for its kind, such as LOG; any name will do where none is given.

    Raises:
        RecordingError: the folder is missing or read-only, the path is not a regular file, or its name ends as those
            of other kinds of files.
    """
    with contextlib.suppress(_Checked), replacing(path, *endings):
        raise _Checked


class _Checked(Exception):
    """Leaves the block of `replacing` without replacing the file."""


@contextlib.contextmanager
def replacing(path: Path, *endings: str) -> Iterator[Path]:
    """Gives a temporary path beside `path` to write to; the file replaces `path` when the block succeeds.

    Args:
        path: file to be written.
        endings: endings of names for its kind, see `ensure_writable`.

    Raises:
        NoSpaceError: there is no room for the file.
        RecordingError: `path` is no path of such a file, or it cannot be written.
    """
    if endings and path.suffix.lower() not in endings:
        got = f"{path.suffix!r} for another kind of file" if path.suffix else "no ending"
        raise RecordingError(f"{path}: expected a name that ends in {choices(endings)}, got {got}")
    target = path.resolve()
    if target.exists() and not target.is_file():
        kind = "a folder" if target.is_dir() else "a device"
        raise RecordingError(f"{path}: expected the path of a file, this is {kind}")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        with writing(path):
            temporary.touch()
            yield temporary
            os.replace(temporary, target)
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Tells of the system's errors meanwhile as of a file that cannot be written.

    Raises:
        NoSpaceError: there is no room for the file.
        RecordingError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        failure = NoSpaceError if error.errno in NO_SPACE else RecordingError
        raise failure(f"{path}: cannot be written: {reason_of(error)}") from None


def append_whole(file: int, data: bytes, *, sync: bool = False) -> None:
    """Appends all of `data` to a file, or nothing: the system may take a part of it, and none of the rest.

    Args:
        file: descriptor of the file, which nobody else writes meanwhile.
        data: what is appended.
        sync: whether it shall be on disk, and not only in the system's memory, in the end.

    Raises:
        OSError: it cannot be written; the file is as it was.
    """
    end = os.lseek(file, 0, os.SEEK_END)
    rest = memoryview(data)
    try:
        while rest:
            written = os.write(file, rest)
            if not written:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            rest = rest[written:]
        if sync:
            os.fsync(file)
    except BaseException:
        os.ftruncate(file, end)
        os.lseek(file, end, os.SEEK_SET)
        raise


def reason_of(error: OSError) -> str:
    """The operating system's text of an error; the text of Arrow would name temporary files."""
    if isinstance(error, FileNotFoundError):
        return os.strerror(errno.ENOENT)  # Arrow's has no number, and names the file alone
    return os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
