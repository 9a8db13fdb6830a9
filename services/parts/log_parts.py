"""A log on disk while it grows: whole Parquet files side by side, put together at the end.

A process that is killed loses what came after its last part; one that starts again finds the parts and goes on.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from dtwin.errors import RecordingError
from dtwin.files import ensure_writable
from dtwin.run.recording import Log, concatenate, read_log
from services.parts.part_files import folder_of


class Parts:
    """The parts of the log `path`.

    Args:
        path: where the whole log goes at the end.

    Attributes:
        logs: the parts so far, oldest first, with those that were there before.

    Raises:
        RecordingError: the folder cannot be made or the log not be written there.
    """

    def __init__(self, path: Path) -> None:
        ensure_writable(path)
        self._path = path
        self._folder = folder_of(path)
        try:
            self._folder.mkdir(exist_ok=True)
        except OSError as error:
            raise RecordingError(f"{self._folder}: cannot be made: {error.strerror}") from None
        self.logs = [read_log(part) for part in sorted(self._folder.glob("*.parquet"))]

    def add(self, log: Log) -> None:
        """Keeps one more part."""
        log.write_parquet(self._folder / f"{len(self.logs):06d}.parquet")
        self.logs.append(log)

    def clear(self) -> None:
        """Forgets all parts: they belong to another run."""
        shutil.rmtree(self._folder)
        self._folder.mkdir()
        self.logs = []

    def finish(self, metadata: dict[str, Any]) -> Log | None:
        """Writes the whole log in the place of its parts; None when there is nothing to write."""
        whole = concatenate(self.logs, metadata) if self.logs else None
        if whole is not None:
            whole.write_parquet(self._path)
        shutil.rmtree(self._folder)
        return whole
