"""Keeps the folder of kept machine code small: what was not used for longest goes first.

A process that has loaded a file does not need it any more, and one that finds it gone makes it again.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from pathlib import Path
from typing import Final

LIMIT: Final = 64 << 20
"""Largest size of all kept files, bytes: some hundreds of units."""
MAKING: Final = ".making-"
"""Begins the names of the folders in which files are made."""
ABANDONED: Final = 3600.0
"""Age from which nobody works in such a folder any more, s."""
_KEPT: Final = re.compile(r".+-[0-9a-f]{64}\.so")


def used(path: Path) -> None:
    """Notes that a file is in use now; the times at which files are read are not kept everywhere."""
    with contextlib.suppress(OSError):
        os.utime(path)


def tidy(folder: Path, newest: Path) -> None:
    """Removes the oldest files until all are no larger than LIMIT, and folders of processes that were killed.

    Args:
        folder: folder of the kept files; other files in it stay.
        newest: file that was just made, which stays.
    """
    with contextlib.suppress(OSError):  # somebody else tidies, or may not; the next file that is made comes here, too
        entries = [(entry, entry.stat(follow_symlinks=False)) for entry in os.scandir(folder)]
        now = newest.stat().st_mtime
        for entry, status in entries:
            if entry.name.startswith(MAKING) and now - status.st_mtime > ABANDONED:
                shutil.rmtree(entry.path, ignore_errors=True)
        files = [
            (status.st_mtime_ns, status.st_size, entry) for entry, status in entries if _KEPT.fullmatch(entry.name)
        ]
        excess = sum(size for _, size, _ in files) - LIMIT
        for _, size, entry in sorted(files, key=lambda file: file[0]):
            if excess > 0 and entry.name != newest.name:
                Path(entry).unlink(missing_ok=True)
                excess -= size
