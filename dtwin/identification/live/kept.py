"""Identified arms as files that all commands take: `NAME.toml`, with the model of the same name beside it."""

from __future__ import annotations

from pathlib import Path

from dtwin.arm.file import ArmFile
from dtwin.emulation.chain.overlay import write_mjcf
from dtwin.errors import ModelError
from dtwin.identification.chain.identify import Identification
from dtwin.identification.chain.overlay import overlaid, write_arm, write_urdf
from dtwin.names import check_name


def keep(found: Identification, known: ArmFile, folder: Path, name: str) -> Path:
    """Writes an arm under a name into a folder, which is made if it is not there; returns the arm's file.

    Raises:
        ModelError: the name cannot be that of a file, is that of the arm's own model, or the folder cannot be made.
        RecordingError: a file cannot be written.
    """
    check_name(name, "model name", ModelError)
    path = folder / f"{name}.toml"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ModelError(f"{folder}: cannot be made: {error.strerror}") from None
    if path.with_suffix(known.model.suffix.lower()).resolve() == known.model.resolve():
        raise ModelError(f"{path}: expected another name than that of the arm's model")
    write_beside(found, known, path)
    return path


def write_beside(found: Identification, known: ArmFile, path: Path) -> None:
    """Writes an arm's file, and the model with what was found beside it.

    Args:
        found: what was found.
        known: what the file says that the arm came from.
        path: file to write, *.toml.

    Raises:
        RecordingError: a file cannot be written.
    """
    model = known.model
    beside = path.with_suffix(model.suffix.lower())
    if model.suffix.lower() == ".urdf":
        write_urdf(found, model, beside)
    else:
        write_mjcf(overlaid(found), model, beside)
    write_arm(found, known, beside, path)
