"""The folder of kept machine code and written Python: only this user can write it, and what was not used for longest
goes first.

Whoever can write there could make this process do anything. A process that has loaded a file does not need it any
more, and one that finds it gone makes it again.
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import shutil
import stat
import tempfile
from pathlib import Path
from typing import Final

log = logging.getLogger(__name__)

LIMIT: Final = 128 << 20
"""Largest size of all kept files, bytes: some hundreds of units, and the compiled kernels of some checkouts."""
MAKING: Final = ".making-"
"""Begins the names of the folders in which files are made."""
ABANDONED: Final = 3600.0
"""Age from which nobody works in such a folder any more, s."""
_KEPT: Final = re.compile(r".+-[0-9a-f]{64}(\.\d+)?\.[a-z]+")


def own(path: Path) -> Path | None:
    """A folder, which is made if there is none; None if it cannot be made, or if others may read or write it."""
    try:
        path = path.absolute()  # a name without a folder would be looked for elsewhere
        path.mkdir(parents=True, exist_ok=True, mode=0o700)
        status = path.lstat()
    except OSError as error:
        log.info("%s: machine code is not kept: %s", path, error.strerror)
        return None
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or stat.S_IMODE(status.st_mode) & 0o077:
        log.info("%s: machine code is not kept: expected a folder of this user with mode 0700", path)
        return None
    return path


def temporary(name: str) -> Path | None:
    """A folder of this user among the temporary files, for one who has no home; see `own`."""
    base = own(Path(tempfile.gettempdir()) / f"dtwin-{os.geteuid()}")
    return None if base is None else own(base / name)


def kept_folder() -> Path | None:
    """The folder of machine code: DTWIN_CACHE_DIR, or in the user's cache folder, or else a `temporary` one."""
    given = os.environ.get("DTWIN_CACHE_DIR")
    if given:
        return own(Path(given))
    try:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    except RuntimeError:  # this user has none
        return temporary("native")
    return own(home / "dtwin" / "native") or temporary("native")


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
