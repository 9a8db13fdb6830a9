"""`dtwin run`."""

from __future__ import annotations

import signal
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.api.cell import finished
from dtwin.api.run import RunError
from dtwin.commands.cell.chain import THESIS, other_cell, run_arm
from dtwin.commands.hints import viewer_command, warn_of_places
from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import BLOCKS
from dtwin.controller.remote import RemoteController
from dtwin.controller.runtime import RuntimeOption
from dtwin.errors import ParameterError
from dtwin.files import LOG, RECORDING, ensure_writable
from dtwin.parameters import PERIOD
from dtwin.run.cell import Cell, RunSummary
from dtwin.run.hidden import HiddenLog
from dtwin.run.options import ControlOptions, PlantOptions
from dtwin.run.settings import CellSettings, sequence_of
from dtwin.terminal import print_json, printable
from iec61499.net.address import parse_address

SAME_VOLTS: Final = 1e-9
"""Difference of their voltages within which two controllers count as the same, V."""


@dataclass(frozen=True, kw_only=True)
class Run(PlantOptions, ControlOptions, RuntimeOption):
    """Run the cell: the emulated arm sorts boxes under its function blocks, as fast as the machine allows.

    Writes a recording for the Rerun viewer and prints a summary. Ctrl-C ends the run and keeps what was recorded.
    """

    duration: float = 120.0
    """Plant time to run, s."""
    record: Path | None = None
    """Recording for the Rerun viewer; run.rrd if not given, none with --json."""
    log: Path | None = None
    """Parquet log, one row per 10 ms tick."""
    controller: str | None = None
    """tcp://HOST:PORT of a 4diac FORTE or `dtwin fb run` that controls the arm in lockstep, e.g. tcp://127.0.0.1:61500.
    Its gains and target time are its own, and so is its sequence: --sequence of `dtwin fb run` and `deploy`."""
    realtime: bool = False
    """Run no faster than the wall clock."""
    json: bool = False
    """Print one JSON object on standard output and nothing else."""
    blocks: Path = BLOCKS
    """Folder of the function-block library."""
    arm: str = THESIS
    """Another arm, which goes from pose to pose: a name of arms/, its file (*.toml), or a model (*.urdf, *.xml); its
    --machine is ideal, nominal (as its data sheet) or a number."""
    poses: Path | None = None
    """TOML file of the poses that the arm of --arm takes; some that are drawn by --seed if not given."""
    path: Path | None = None
    """CSV file of a path that the arm of --arm follows: t, and its joints, or x, y, z of its tool (docs/arms.md)."""
    sort: Path | None = None
    """TOML file of a sorting task for the arm of --arm (docs/arms.md)."""
    late: int = 0
    """Ticks from a command until it acts (--arm)."""

    def execute(self) -> int:
        if (other := other_cell(self)) is not None:
            return run_arm(other, self, _Interruption)
        if self.late or any(each is not None for each in (self.poses, self.path, self.sort)):
            raise ParameterError("--poses, --path, --sort, --late: expected --arm with another arm than the thesis's")
        record = self.record or (None if self.json else Path("run.rrd"))
        earlier = record is not None and record.exists()
        for path, ending in ((record, RECORDING), (self.log, LOG)):
            if path is not None:
                ensure_writable(path, ending)
        settings = self.settings()
        warn_of_places(settings.task, settings.machine.arm(settings.arm))
        remote = self._remote(settings) if self.controller else None
        hidden = None if record is None or settings.machine.ideal else HiddenLog()
        cell = Cell(settings, remote, hidden)
        failure: RunError | None = None
        with _Interruption() as interruption, _progress(cell, quiet=self.json) as progress:

            def between(done: int) -> bool:
                progress.update(progress.task_ids[0], completed=done * PERIOD)
                return not interruption.requested

            try:
                run = finished(cell, between, self.realtime)
            except RunError as error:
                run, failure = error.run, error
            if self.log is not None:
                run.save(self.log)
            if record is not None and len(run.log):
                run.record(record)
        if remote is not None:
            remote.close()
            if remote.largest_difference > SAME_VOLTS:
                apart = f"{remote.largest_difference:.3g} V from those of the blocks in {self.blocks}"
                print(printable(f"dtwin: the voltages of {self.controller} are up to {apart}"), file=sys.stderr)
        if failure is not None:
            raise failure
        if self.json:
            print_json(run.score)
        else:
            _print(run.score, record, self.log, earlier)
        return 130 if interruption.requested else 0

    def settings(self) -> CellSettings:
        """The run that the options stand for.

        Raises:
            DtwinError: an option is out of range or cannot be read.
        """
        return replace(super().settings(), duration=self.duration, control=self.control(), blocks=self.blocks)

    def _remote(self, settings: CellSettings) -> RemoteController:
        assert self.controller is not None
        shadow = EmbeddedController(settings.control, settings.blocks, sequence_of(settings))
        return RemoteController(parse_address(self.controller, "tcp"), shadow)


class _Interruption:
    """Turns Ctrl-C and a polite kill into a request to stop between two ticks."""

    def __init__(self) -> None:
        self.requested = False

    def __enter__(self) -> _Interruption:
        self._previous = {number: signal.signal(number, self._request) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._previous.items():
            signal.signal(number, handler)

    def _request(self, *_: object) -> None:
        self.requested = True


def _progress(cell: Cell, quiet: bool) -> Progress:
    columns = (TextColumn("running the cell"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    progress = Progress(*columns, console=Console(file=sys.stderr), transient=True, disable=quiet)
    progress.add_task("", total=cell.ticks * PERIOD)
    return progress


def _print(summary: RunSummary, record: Path | None, log: Path | None, earlier: bool) -> None:
    """Prints the summary for people; `earlier` tells whether a recording of the same name was replaced."""
    boxes, errors = summary.boxes, summary.placement_error_mm
    worst = ", ".join(f"{value:.4f}" for value in summary.tracking_error_rad.max)
    lines = {
        "plant time": f"{summary.duration:g} s in {summary.wall_seconds:.2f} s,"
        f" {summary.real_time_factor:.0f} x real time",
        "boxes": f"{boxes.arrived} arrived, {boxes.picked} picked, {boxes.delivered} delivered,"
        f" {boxes.misplaced} misplaced, {boxes.held} held at the end, {boxes.turned_away} turned away",
        "placement error": f"{errors.max:.2f} mm at most, {errors.mean:.2f} mm on average"
        if errors is not None
        else "no box was delivered",
        "tracking error": f"{worst} rad at most, joints 1 to 3",
        "saturated ticks": str(summary.saturated_ticks),
    }
    if log is not None:
        lines["log"] = str(log)
    if record is not None:
        replaced = " (in place of an earlier one)" if earlier else ""
        lines["recording"] = f"{record}{replaced}: look at it with `{viewer_command(record)}`"
    for name, text in lines.items():
        print(printable(f"{name:<16}  {text}"))
    for text in summary.without_effect:
        print(printable(f"without effect    {text}"))
