"""Where the parts of a log lie while it grows."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Final

SUFFIX: Final = ".parts"
"""End of the name of the folder of parts, after the log's name; any Parquet reader takes the folder for one table."""
WHOLE: Final = "whole"
"""Name of the file in that folder which says that the log itself holds all rows so far."""


def folder_of(path: Path) -> Path:
    """The folder of the parts of the log `path`."""
    return path.with_name(path.name + SUFFIX)


def discard_parts(path: Path) -> None:
    """Forgets what an earlier run left unfinished of the log `path`."""
    shutil.rmtree(folder_of(path), ignore_errors=True)


def discard_marker(path: Path) -> None:
    """Forgets the folder of parts of the log `path` if the log holds all rows and nothing else is kept there."""
    folder = folder_of(path)
    if folder.is_dir() and [file.name for file in folder.iterdir()] == [WHOLE]:
        discard_parts(path)
