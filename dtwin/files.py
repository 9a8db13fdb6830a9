"""Files that appear complete or not at all."""

from __future__ import annotations

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from dtwin.errors import NoSpaceError, RecordingError

NO_SPACE: Final = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Numbers of the system's errors that say that there is no room for a file."""


def ensure_writable(path: Path) -> None:
    """Checks that a file can be written at `path`, so that a long run does not fail at its end.

    Raises:
        RecordingError: the folder is missing or read-only, or the path is not a regular file.
    """
    with contextlib.suppress(_Checked), replacing(path):
        raise _Checked


class _Checked(Exception):
    """Leaves the block of `replacing` without replacing the file."""


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Gives a temporary path beside `path` to write to; the file replaces `path` when the block succeeds.

    Raises:
        NoSpaceError: there is no room for the file.
        RecordingError: `path` is no path of a file, or it cannot be written.
    """
    target = path.resolve()
    if target.exists() and not target.is_file():
        kind = "a folder" if target.is_dir() else "a device"
        raise RecordingError(f"{path}: expected the path of a file, this is {kind}")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.part")
    try:
        temporary.touch()
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        failure = NoSpaceError if error.errno in NO_SPACE else RecordingError
        raise failure(f"{path}: cannot be written: {reason_of(error)}") from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()


def reason_of(error: OSError) -> str:
    """The operating system's text of an error; the text of Arrow would name temporary files."""
    return os.strerror(error.errno) if error.errno else str(error).splitlines()[0]
