"""A file system that can be filled without harm."""

from __future__ import annotations

import errno
import shutil
import subprocess
from pathlib import Path
from typing import Final

SIZE: Final = 64 << 20
"""bytes"""
_BLOCK: Final = b"\0" * (1 << 16)


class SmallDisk:
    """A file system of SIZE bytes in memory, mounted at a folder if this user may; an ordinary folder otherwise.

    Args:
        folder: where it is mounted; made if it is not there.

    Attributes:
        folder: where it is.
        small: whether it could be mounted.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(exist_ok=True)
        mount = ["mount", "-t", "tmpfs", "-o", f"size={SIZE}", "tmpfs", str(folder)]
        self.small = subprocess.run(mount, capture_output=True).returncode == 0
        self._filling = folder / "filling"

    def fill(self) -> None:
        """Leaves no room."""
        try:
            with self._filling.open("wb") as file:
                while True:
                    file.write(_BLOCK)
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise

    def free(self) -> None:
        """Makes room again."""
        self._filling.unlink(missing_ok=True)

    def close(self, keep: Path) -> None:
        """Moves the files on it to a folder, and takes it away."""
        self.free()
        for file in self.folder.iterdir():
            shutil.move(file, keep / file.name)
        if self.small:
            subprocess.run(["umount", str(self.folder)], capture_output=True, check=False)
