"""What a run of a line leaves in its folder: how it went, what was decided, and the logs of its stations.

RUN/course.json has line, events and samples; RUN/history.jsonl every decision as it was made; RUN/NAME.parquet the
log of a station; RUN/tables what happened, as tables for SQL.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec

from dtwin.errors import RecordingError
from dtwin.files import reason_of, replacing
from dtwin.line.floor import Floor, Sample
from dtwin.line.plant import LineEvent
from dtwin.line.run import LineRun
from dtwin.line.twins.decisions import Decision

COURSE: Final = "course.json"
HISTORY: Final = "history.jsonl"
_LARGEST: Final = 1 << 28
"""Largest course that is read, bytes."""


class Kept(msgspec.Struct, frozen=True):
    """How a run went.

    Attributes:
        line: name of the line.
        stations, vehicles: their names.
        operations: names of the operations.
        duration: plant time, s.
        entered, lost, collisions: number of boxes that came, of those that were lost, and of touches of vehicles.
        left: times at which boxes left, s.
        events, decisions, samples: see `dtwin.line.run.Course`.
    """

    line: str
    stations: tuple[str, ...]
    vehicles: tuple[str, ...]
    operations: tuple[str, ...]
    duration: float
    entered: int
    lost: int
    collisions: int
    left: tuple[float, ...]
    events: tuple[LineEvent, ...]
    decisions: tuple[Decision, ...]
    samples: tuple[Sample, ...]


def kept(run: LineRun) -> Kept:
    """How a run went so far."""
    return kept_of(run.floor, run.course.decisions)


def kept_of(floor: Floor, decisions: Iterable[Decision]) -> Kept:
    """How a line has gone so far, as far as its floor has not forgotten it, and what was decided."""
    plant = floor.plant
    return Kept(
        floor.line.name,
        tuple(plant.stations),
        tuple(plant.vehicles),
        tuple(operation.name for operation in floor.line.operations),
        floor.time,
        len(plant.boxes),
        plant.lost,
        plant.collisions,
        tuple(time for _, time in plant.left),
        tuple(floor.events),
        tuple(decisions),
        tuple(floor.samples),
    )


def prepare(folder: Path) -> Path:
    """Makes the folder of a run; the path of its history.

    Raises:
        RecordingError: it is not empty, or cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise RecordingError(f"{folder}: expected a new or an empty folder")
    except (FileExistsError, NotADirectoryError):
        raise RecordingError(f"{folder}: expected a new or an empty folder, got a file") from None
    except OSError as error:
        raise RecordingError(f"{folder}: {reason_of(error)}") from None
    return folder / HISTORY


def write(run: LineRun, folder: Path) -> None:
    """Writes how a run went, and the logs of its stations.

    Raises:
        RecordingError: the folder cannot be written.
    """
    write_course(kept(run), folder)
    for name, station in run.emulated.items():
        station.write_log(folder / f"{name}.parquet")


def write_course(found: Kept, folder: Path) -> None:
    """Writes how a run went.

    Raises:
        RecordingError: the folder cannot be written.
    """
    with replacing(folder / COURSE) as temporary:
        temporary.write_bytes(msgspec.json.encode(found) + b"\n")


def read(folder: Path) -> Kept:
    """Reads how a run went.

    Raises:
        RecordingError: it cannot be read, or is not that of a run.
    """
    path = folder / COURSE
    try:
        with path.open("rb") as file:
            data = file.read(_LARGEST + 1)
    except OSError as error:
        raise RecordingError(
            f"{path}: {reason_of(error)}: expected the folder of a run of `dtwin line run`"
        ) from None
    if len(data) > _LARGEST:
        raise RecordingError(f"{path}: expected at most {_LARGEST} bytes")
    try:
        return msgspec.json.decode(data, type=Kept)
    except msgspec.MsgspecError as error:
        raise RecordingError(f"{path}: expected the course of a line: {error}") from None
