"""`dtwin run --arm NAME`: any serial arm from pose to pose."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from dtwin.arm.chain import Arm
from dtwin.arm.poses import Poses, drawn_poses, read_poses
from dtwin.arm.sorting import Sorting, read_sorting
from dtwin.commands.hints import viewer_command
from dtwin.controller.chain.application import Control
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import IDEAL, machine_of
from dtwin.emulation.generators import check_seed
from dtwin.errors import ParameterError
from dtwin.files import LOG, RECORDING, ensure_writable
from dtwin.run.chain import ChainRun, ChainSettings, run, sorting_poses
from dtwin.run.following import read_path
from dtwin.terminal import print_json, printable

THESIS: Final = "thesis"
"""The arm of a run without --arm."""
KNOWN: Final = frozenset(
    {"arm", "poses", "path", "sort", "late", "machine", "seed", "duration", "log", "record", "json", "runtime"}
)
"""Options of `dtwin run` that mean something for any arm."""
LONGEST: Final = 86_400.0
"""Longest run, s: all its ticks are kept in memory."""
_DRAWN: Final = 6
"""Number of poses that are drawn where none are given."""


def refuse_others(options: Any) -> None:
    """Refuses what means something for the thesis's arm alone.

    Raises:
        ParameterError: an option was given that has no meaning for another arm.
    """
    for field in fields(options):
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in KNOWN and getattr(options, field.name) != default:
            known = ", ".join(f"--{name}" for name in sorted(KNOWN - {"arm"}))
            name = field.name.replace("_", "-")
            raise ParameterError(f"--{name}: has no meaning for --arm {options.arm}: expected {known}")


def poses_for(arm: Arm, file: Path | None, seed: int) -> Poses:
    """The poses of a file, or some that are drawn from the ranges of the joints, again and again.

    Raises:
        ParameterError: the file cannot be used.
    """
    if file is not None:
        return read_poses(file, arm)
    drawn = drawn_poses(arm, _DRAWN, np.random.default_rng(seed))
    return Poses(drawn.positions, 0.3, True)


def _task(arm: Arm, options: Any, sorting: Sorting | None) -> Poses:
    if sorting is not None:
        return sorting_poses(arm, sorting)
    return poses_for(arm, options.poses, options.seed) if options.path is None else read_path(options.path, arm)


def run_arm(options: Any, interruption: Callable[[], AbstractContextManager[Any]]) -> int:
    """Runs the arm of --arm; returns the exit status.

    Args:
        options: those of `dtwin run`.
        interruption: turns Ctrl-C into an attribute `requested`.
    """
    refuse_others(options)
    check_seed(options.seed)
    if not 0 <= options.late <= 10:
        raise ParameterError(f"--late: expected 0 to 10 ticks, got {options.late}")
    if not 0.0 < options.duration <= LONGEST:
        raise ParameterError(f"--duration: expected above 0 and at most {LONGEST:g} s, got {options.duration:g}")
    for path, ending in ((options.log, LOG), (options.record, RECORDING)):
        if path is not None:
            ensure_writable(path, ending)
    arm = arm_of(options.arm)
    if sum(each is not None for each in (options.sort, options.poses, options.path)) > 1:
        raise ParameterError("--sort, --poses and --path: expected one of them")
    sorting = None if options.sort is None else read_sorting(options.sort)
    settings = ChainSettings(
        arm,
        machine_of(options.machine or IDEAL, arm),
        _task(arm, options, sorting),
        Control(delay=min(options.late, 1) * arm.period),
        options.duration,
        options.seed,
        options.late,
        sorting=sorting,
    )
    with interruption() as asked, _progress(options) as progress:

        def between(done: int) -> bool:
            progress.update(progress.task_ids[0], completed=done * arm.period)
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
    if boxes := score.get("boxes"):
        lines["boxes"] = (
            f"{boxes['arrived']} arrived, {boxes['picked']} picked, {boxes['delivered']} delivered, "
            f"{boxes['within_5_mm']} of them within 5 mm, {boxes['missed']} missed"
        )
        lines["placement error"] = (
            f"{1e3 * boxes['placement_error_max']:.2f} mm at most, "
            f"{1e3 * boxes['placement_error_mean']:.2f} mm on average"
        )
    if score["stop"]:
        hint = "`dtwin arm check` tells whether its loop is stable"
        lines["stop"] = f"safe stop {score['stop']} is in force: a joint left its path; {hint}"
    if log is not None:
        lines["log"] = str(log)
    if record is not None:
        lines["recording"] = f"{record}: look at it with `{viewer_command(record)}`"
    for name, text in lines.items():
        print(printable(f"{name:<16}  {text}"))
