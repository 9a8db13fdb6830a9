"""Brings an emulated cell back from its journal; one that cannot be read is set aside, and the cell starts anew."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from dtwin.errors import DtwinError, RecordingError
from dtwin.run.emulate import emulate
from dtwin.run.settings import CellSettings
from dtwin.services.parts.journal import Journal
from dtwin.services.parts.journaled import JournaledCell

KEPT: Final = 8
"""Number of journals set aside that are kept; a further one takes the place of the last."""


def revive(settings: CellSettings, path: Path) -> tuple[JournaledCell, str]:
    """The cell that a journal tells of, and "", or a new cell and what was wrong with the journal.

    Args:
        settings: Settings of the cell; a journal that can be read brings its own seed.
        path: File of the journal, which is made when there is none.

    Raises:
        DtwinError: A setting cannot be used, or no journal can be kept at that place.
    """
    emulate(settings)  # What is wrong with the settings is no fault of the journal.
    try:
        return _replayed(settings, path), ""
    except RecordingError as error:
        aside = _set_aside(path)
        cell = _replayed(settings, path)
        cell.latch.stop("torque off", b"")  # The journal may have held a stop that nobody has released.
        trouble = f"the cell starts anew with the torque off, its journal is kept as {aside.name}: {error}"
        return cell, trouble


def _replayed(settings: CellSettings, path: Path) -> JournaledCell:
    try:
        return JournaledCell(settings, Journal(path, settings.seed))
    except RecordingError:
        raise
    except (DtwinError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: cannot be replayed: {error}") from None


def _set_aside(path: Path) -> Path:
    names = [path.with_name(f"{path.name}.unreadable-{number}") for number in range(1, KEPT + 1)]
    aside = next((name for name in names if not name.exists()), names[-1])
    try:
        os.replace(path, aside)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be set aside: {error.strerror}") from None
    return aside
