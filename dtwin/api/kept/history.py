"""The history of a controller's settings that a cell keeps."""

from __future__ import annotations

from pathlib import Path

from dtwin.api.arguments import AnyPath, checked
from dtwin.errors import RecordingError
from dtwin.services import runfile
from dtwin.services.chain.starting import history_of
from dtwin.services.runfile import kept
from dtwin.simulation.chain.history import ArmEntry, ArmHistory
from dtwin.simulation.history import HISTORY, Entry, History


@checked
def history(*, file: AnyPath | None = None, cell: str = "cell") -> list[Entry] | list[ArmEntry]:
    """Every change of a controller's settings, as `dtwin history` shows them: when, who, why, what came of it.

    Args:
        file: file of the history; None for that of the cell if it is up on this machine, else uploads.jsonl.
        cell: name of the cell.

    Raises:
        RecordingError: there is no history yet, or the file is none.
    """
    path = _history_of(cell) if file is None else Path(file)
    if not path.exists():
        raise RecordingError(f"{path}: there is no history yet; the simulation service keeps it")
    try:
        return History(path).entries()
    except RecordingError as error:
        try:
            return ArmHistory(path).entries()
        except RecordingError:
            raise error from None


def _history_of(cell: str) -> Path:
    """The file of the cell that is up on this machine; that of its arm, where it is not the thesis's."""
    up, file = runfile.find(cell), kept(cell, "history", HISTORY)
    other = file if up is None else history_of(file, up.arm)
    return other if other.exists() else file
