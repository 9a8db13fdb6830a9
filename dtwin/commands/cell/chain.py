"""`dtwin run --arm NAME`: any serial arm from pose to pose."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.commands.hints import viewer_command
from dtwin.files import LOG, RECORDING, ensure_writable
from dtwin.options import refuse_others
from dtwin.run.arm_cell import ArmCell, arm_cell_of
from dtwin.run.chain import ChainRun, run
from dtwin.terminal import print_json, printable

THESIS: Final = "thesis"
"""The arm of a run without --arm."""
KNOWN: Final = frozenset(
    {
        "arm",
        "cell_file",
        "poses",
        "path",
        "sort",
        "late",
        "fault",
        "machine",
        "seed",
        "duration",
        "log",
        "record",
        "json",
        "runtime",
    }
)
"""Options of `dtwin run` that mean something for any arm."""


def other_cell(options: Any) -> ArmCell | None:
    """The cell of another arm that --arm or --cell-file stands for; None for the thesis's.

    What an option says counts instead of what the file says.

    Raises:
        ModelError: the file cannot be read.
    """
    found = None if options.cell_file is None else arm_cell_of(options.cell_file)
    if found is None and options.arm == THESIS:
        return None
    own = ArmCell(arm=options.arm) if found is None or options.arm != THESIS else found
    task = {name: getattr(options, name) for name in ("poses", "path", "sort")}
    if any(each is not None for each in task.values()):
        own = replace(own, **task)
    return replace(
        own,
        machine=options.machine or own.machine,
        late=options.late or own.late,
        faults=(*own.faults, *options.fault),
    )


def run_arm(cell: ArmCell, options: Any, interruption: Callable[[], AbstractContextManager[Any]]) -> int:
    """Runs the cell of another arm; returns the exit status.

    Args:
        cell: the cell.
        options: those of `dtwin run`.
        interruption: turns Ctrl-C into an attribute `requested`.
    """
    refuse_others(options, KNOWN, ("arm",))
    for path, ending in ((options.log, LOG), (options.record, RECORDING)):
        if path is not None:
            ensure_writable(path, ending)
    settings = cell.settings(options.duration, options.seed)
    period = settings.arm.period
    with interruption() as asked, _progress(options) as progress:

        def between(done: int) -> bool:
            progress.update(progress.task_ids[0], completed=done * period)
            return not asked.requested

        result = run(settings, between)
    if options.log is not None:
        result.save(options.log)
    if options.record is not None:
        from dtwin.view.chain.recording import write_chain_recording  # Rerun takes a while to load

        write_chain_recording(result, options.record)
    if options.json:
        print_json(result.score())
    else:
        _print(result, options.log, options.record)
    return 130 if asked.requested else 0


def _progress(options: Any) -> Progress:
    columns = (TextColumn("running the arm"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    progress = Progress(*columns, console=Console(file=sys.stderr), transient=True, disable=options.json)
    progress.add_task("", total=options.duration)
    return progress


def _print(result: ChainRun, log: Path | None, record: Path | None) -> None:
    score = result.score()
    unit = {True: "rad", False: "m"}
    units = [unit[joint.turns] for joint in result.settings.arm.joints]
    largest, usual = score["tracking_error_max"], score["tracking_error_rms"]
    lines = {
        "arm": f"{score['arm']}, machine {score['machine']}",
        "plant time": f"{score['duration']:g} s in {score['wall_seconds']:.2f} s, "
        f"{score['duration'] / score['wall_seconds']:.0f} x real time",
        "poses": f"{score['poses_reached']} of {len(result.settings.poses.positions)} headed for",
    }
    for k, name in enumerate(score["joints"]):
        lines[name] = (
            f"{largest[k]:.5f} {units[k]} off its path at most, {usual[k]:.5f} {units[k]} rms; "
            f"{score['saturated_ticks'][k]} ticks at the limit of its drive"
        )
        if score["beyond_range"][k] > 0.0:
            lines[name] += f"; {score['beyond_range'][k]:.5f} {units[k]} beyond its range"
    if missed := [str(fault) for fault in result.settings.faults if fault.start >= score["duration"]]:
        lines["not come"] = f"{', '.join(missed)}: the run was over at {score['duration']:g} s"
    if boxes := score.get("boxes"):
        lines["boxes"] = (
            f"{boxes['arrived']} arrived, {boxes['picked']} picked, {boxes['delivered']} delivered, "
            f"{boxes['within_5_mm']} of them within 5 mm, {boxes['missed']} missed; "
            f"{boxes['held']} held and {boxes['waiting']} waiting at the end"
        )
        lines["placement error"] = (
            f"{1e3 * boxes['placement_error_max']:.2f} mm at most, "
            f"{1e3 * boxes['placement_error_mean']:.2f} mm on average"
        )
    if score["stop"]:
        hint = "`dtwin arm check` tells whether its loop is stable and its drives hold it"
        lines["stop"] = f"safe stop {score['stop']} is in force: a joint left its path; {hint}"
    if log is not None:
        lines["log"] = str(log)
    if record is not None:
        lines["recording"] = f"{record}: look at it with `{viewer_command(record)}`"
    for name, text in lines.items():
        print(printable(f"{name:<16}  {text}"))
