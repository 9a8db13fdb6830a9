"""Keeps how a line that runs in real time goes, in the same form as that of a run that is over."""

from __future__ import annotations

import itertools
import logging
from pathlib import Path
from typing import Final

from dtwin.errors import DtwinError
from dtwin.line.floor import Floor
from dtwin.line.records.kept import COURSE, HISTORY, kept_of, write_course
from dtwin.line.records.tables import write_tables
from dtwin.line.twins.decisions import Decision
from dtwin.line_file import LineFile

log = logging.getLogger(__name__)

EVERY: Final = 300.0
"""Plant time after which it is written again, s."""


class Keeper:
    """Writes course and tables of a line from time to time; a plant that begins anew gets a folder inside the first.

    Args:
        floor: plant and blocks of the line.
        folder: folder of the run, with the history of what is decided.

    Attributes:
        folder: folder that is written.

    Raises:
        RecordingError: the folder cannot be made.
    """

    def __init__(self, floor: Floor, folder: Path) -> None:
        self._floor = floor
        self._history = LineFile(folder / HISTORY, Decision, "a decision of the line")
        self._written = 0.0
        again = (folder / f"again-{number}" for number in itertools.count(1))
        self.folder = next(path for path in itertools.chain([folder], again) if not (path / COURSE).exists())

    def look(self) -> None:
        """Writes when that is due."""
        if self._floor.time - self._written >= EVERY:
            self.write()

    def write(self) -> None:
        """Writes how the line has gone so far; what cannot be written is told and tried again later."""
        self._written = self._floor.time
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            found = kept_of(self._floor, self._history.entries())
            write_course(found, self.folder)
            write_tables(found, self.folder)
        except (DtwinError, OSError) as error:
            log.error("the run of the line is not kept: %s", error)
