"""Commissioning of a real arm at its healthy work: from a log, or from a running cell."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import msgspec

from dtwin import __version__
from dtwin.api.arguments import AnyPath, checked
from dtwin.bus.messages import DECIDE, IDENTIFY
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import IdentificationDecision, IdentificationRequest, IdentificationState
from dtwin.commissioning import procedure
from dtwin.commissioning.collection import collect
from dtwin.commissioning.procedure import Commissioned
from dtwin.commissioning.stages import Stages
from dtwin.errors import CommunicationError, ParameterError, RecordingError, UnansweredError
from dtwin.files import ensure_writable, reason_of, replacing
from dtwin.identification.machine.record import write_record
from dtwin.logs.log import Log
from dtwin.logs.reading import read_log
from dtwin.monitoring.calibration import LEAST
from dtwin.names import check_name
from dtwin.parameters import ArmParameters, load_arm
from dtwin.run.cell_file import cell_of
from dtwin.run.out_of_place import out_of_place
from dtwin.services.runfile import join
from dtwin.task import DEFAULT_TASK, Task, notes_of, task_of

SHORTEST: Final = 120.0
"""Shortest motion from which an arm is identified, s."""

Tell = Callable[[str], None]


def _unheard(text: str) -> None:
    """Says nothing."""


@checked
def commission(
    log: AnyPath,
    *,
    known: ArmParameters | AnyPath | None = None,
    out: AnyPath | None = None,
    report: AnyPath | None = None,
    tell: Callable[[str], None] = _unheard,
    warn: Callable[[str], None] = _unheard,
    progress: Callable[[str], None] = _unheard,
) -> Commissioned:
    """Commissions the arm of a log: sensors, identification, settings of the controller, monitor.

    It does as `dtwin commission LOG` does. What the data do not tell keeps the value and the tolerance of the data
    sheet; what is true in the log is not looked at.

    Args:
        log: Parquet log of two minutes of ordinary work or more.
        known: parameters of the arm as it was designed, or their JSON file; None for the data sheet.
        out: file that the record is written to, *.json, beside which stages that are done are kept: the same call
            goes on where an earlier one was interrupted.
        report: page that the report is written to, *.html.
        tell: is told in words which stage is done.
        warn: is told in words at which places an arm will do no work.
        progress: is told in words how far a stage is.

    Returns:
        The record of the arm, for `monitor`, `simulate` and `Cell`, and what its identification found.

    Raises:
        ParameterError: an argument is unknown or of another kind.
        RecordingError: the log cannot be read, what is in it does not belong together, or a file cannot be written.
        IdentificationError: the log is too short or too poor.
    """
    files = _Files(out, report)
    arm = _designed(known)
    path = Path(log)
    rows = read_log(path)
    _warn(task_of(rows.metadata), arm, warn)
    stages = files.stages(arm, tell, str(path), _digest(path))
    found = procedure.commission(stages, rows, lambda: rows, arm, str(path), progress)
    files.write(found, progress)
    stages.finish()
    return found


@checked
def commission_live(
    out: AnyPath,
    *,
    cell: str = "cell",
    motion: float = 300.0,
    watch: float = 600.0,
    excite: bool = False,
    zenoh: AnyPath | None = None,
    cell_file: AnyPath | None = None,
    known: ArmParameters | AnyPath | None = None,
    report: AnyPath | None = None,
    tell: Callable[[str], None] = _unheard,
    warn: Callable[[str], None] = _unheard,
    progress: Callable[[str], None] = _unheard,
) -> Commissioned:
    """Commissions the arm of a running cell at its healthy work, as `dtwin commission --live` does.

    Args:
        out: file that the record is written to, *.json, beside which what was collected, and stages that are done,
            are kept: the same call goes on where an earlier one was interrupted.
        cell: name of the cell.
        motion: plant time of the work from which the arm is identified, s, at least 120.
        watch: plant time of the work after that on which the monitor is calibrated, s, at least 30.
        excite: whether the identification service excites the arm once while its motion is collected.
        zenoh: Zenoh configuration file, for a cell on another machine.
        cell_file: cell whose places the arm works at: a file (*.toml), or a name of the folder cells.
        known: parameters of the arm as it was designed, or their JSON file; None for the data sheet.
        report: page that the report is written to, *.html.
        tell: is told in words which stage is done.
        warn: is told in words at which places an arm will do no work.
        progress: is told in words how far a stage is.

    Returns:
        The record of the arm, for `monitor`, `simulate` and `Cell`, and what its identification found.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range.
        CommunicationError: the cell is not up, or does not answer.
        RecordingError: what was collected does not belong together, or a file cannot be written.
        IdentificationError: the work is too poor.
    """
    check_name(cell, "cell")
    for name, value, least in (("motion", motion, SHORTEST), ("watch", watch, LEAST)):
        if not least <= value < float("inf"):
            raise ParameterError(f"{name}: expected at least {least:g} s, got {value:g}")
    files = _Files(out, report)
    arm = _designed(known)
    task = DEFAULT_TASK if cell_file is None else cell_of(str(cell_file)).task
    _warn(task, arm, warn)
    stages = files.stages(arm, tell, "live", cell, motion, watch, excite, notes_of(task))

    def collected(name: str, seconds: float, excited: bool) -> Log:
        def make(path: Path) -> None:
            with join(cell, None if zenoh is None else Path(zenoh)) as bus:
                if excited:
                    _excite(bus)
                log = collect(bus, seconds, lambda done: progress(f"{name}: {done:.0f} of {seconds:.0f} s"))
                if excited:
                    _reject(bus)
            replace(log, metadata={**log.metadata, **notes_of(task)}).write_parquet(path)

        progress(f"{name}: waits for the cell")
        return read_log(stages.file(f"{name}.parquet", make))

    moved = collected("motion", motion, excite)
    source = f"cell {cell}: {motion:g} s of motion, {watch:g} s watched"
    found = procedure.commission(stages, moved, lambda: collected("watched", watch, False), arm, source, progress)
    files.write(found, progress)
    stages.finish(Path(f"{out}.data"))
    return found


@dataclass(frozen=True)
class _Files:
    """Where the results go; checked before anything is done."""

    out: AnyPath | None
    report: AnyPath | None

    def __post_init__(self) -> None:
        for path, ending in ((self.out, ".json"), (self.report, ".html")):
            if path is not None:
                ensure_writable(Path(path), ending)

    def stages(self, arm: ArmParameters, tell: Tell, *inputs: object) -> Stages:
        """The stages, of which those that are done are kept in a folder beside the record."""
        folder = None if self.out is None else Path(f"{self.out}.parts")
        return Stages(folder, msgspec.json.encode([__version__, *inputs, arm]).decode(), tell)

    def write(self, found: Commissioned, progress: Tell) -> None:
        """Writes the record and the report."""
        if self.out is not None:
            write_record(found.record, Path(self.out))
        if self.report is not None:
            from dtwin.commissioning.page import report  # Matplotlib takes half a second to load.

            progress("drawing the report")
            with replacing(Path(self.report)) as temporary:
                temporary.write_text(report(found), encoding="utf-8")


def _designed(known: ArmParameters | AnyPath | None) -> ArmParameters:
    return load_arm(Path(known)) if isinstance(known, str | Path) else known or ArmParameters()


def _warn(task: Task, arm: ArmParameters, warn: Tell) -> None:
    """Tells, before anybody waits for it, at which places an arm will do no work."""
    for text in out_of_place(task, arm):
        warn(text)


def _excite(bus: Bus) -> None:
    """Asks the identification service to excite the arm as soon as its gripper is empty."""
    try:
        bus.ask(IDENTIFY, IdentificationRequest(), IdentificationState)
    except UnansweredError as error:
        raise CommunicationError(f"{error} The arm is excited by that service: dtwin up --identification") from None


def _reject(bus: Bus) -> None:
    """Rejects the model that the identification service proposes, if it does; the signal is what was wanted."""
    if bus.ask(IDENTIFY, None, IdentificationState).phase == "proposed":
        bus.ask(DECIDE, IdentificationDecision(accept=False), IdentificationState)


def _digest(path: Path) -> str:
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read: {reason_of(error)}") from None
