"""A run of any serial arm as a Rerun recording: its own shapes, joints against their targets, commands, boxes."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun_loader_mjcf import MJCFLogger

from dtwin.arm.chain import Arm, Array
from dtwin.arm.sorting import Sorting
from dtwin.emulation.chain.geometry import Geometry
from dtwin.equations.kinematics import tool_of
from dtwin.errors import RecordingError
from dtwin.run.chain import EFFORTS, ChainRun
from dtwin.view import style
from dtwin.view.layout import plot_view, reach, whole_time
from dtwin.view.saving import saving
from dtwin.view.series import TIMELINE, send_lines, stream_of, time_column

ROOT: Final = "arm"
JOINTS: Final = "joints"
ERROR: Final = "error"
COMMANDS: Final = "commands"
BOXES: Final = f"{ROOT}/boxes"
PLACES: Final = f"{ROOT}/places"
TRAIL: Final = f"{ROOT}/trail"
_DRAWN: Final = 0.02
"""Time between two drawn poses, s."""
_TRAIL: Final = 2.0
"""Time that the trail of the tool goes back, s."""
_DENSITY: Final = 600.0
"""What the drawn boxes weigh, kg/m^3."""


def write_chain_recording(run: ChainRun, path: Path) -> None:
    """Writes a run as an .rrd file with a prepared layout; the file appears complete or not at all.

    Raises:
        RecordingError: the run has no tick, or the path cannot be written.
    """
    if not len(run.t):
        raise RecordingError(f"{path}: expected a run of at least one tick to draw")
    geometry = Geometry(run.settings.arm)
    notes = f"{run.settings.arm.name} {run.settings.machine.name}".encode()
    stream = stream_of(notes, (run.t, run.q, run.target, run.command, run.true, run.places))
    with saving(stream, path, _layout(run, geometry)):
        _log_arm(stream, run, geometry)
        _log_series(stream, run)
        if run.settings.sorting is not None:
            _log_boxes(stream, run, run.settings.sorting)


def _log_arm(stream: rr.RecordingStream, run: ChainRun, geometry: Geometry) -> None:
    """The shapes, the motion of the bodies and the trail of the tool."""
    logger = MJCFLogger(geometry.model, ROOT)
    stream.set_time(TIMELINE, duration=float(run.t[0]))
    with contextlib.redirect_stdout(io.StringIO()):  # the loader tells of shapes that it leaves out
        logger.log_model(stream)
    stream.reset_time()
    stride = max(1, round(_DRAWN / run.settings.arm.period))
    times, q = time_column(run.t[::stride]), run.true[::stride]
    positions, quaternions = geometry.poses(q)
    for body in range(1, geometry.model.nbody):
        name = geometry.model.body(body).name or f"body_{body}"
        columns = rr.Transform3D.columns(
            translation=positions[:, body], quaternion=np.roll(quaternions[:, body], -1, axis=1)
        )
        stream.send_columns(logger.paths.body_path(name), indexes=[times], columns=columns)
    stream.log(TRAIL, rr.Points3D.from_fields(colors=style.TRAIL, radii=0.003), static=True)
    tool = tool_of(run.settings.arm, q)[0]
    stream.send_columns(TRAIL, indexes=[times], columns=rr.Points3D.columns(positions=tool))


def _lines(run: ChainRun) -> Iterator[tuple[str, Sequence[str], Sequence[style.RGB], float, Array]]:
    """Entity, names, colours, width and values (N, lines) of what is plotted."""
    names = _names(run.settings.arm)
    colours = [style.joint_colour(k) for k in range(len(names))]
    for k, name in enumerate(names):
        path = joint_path(name)
        yield f"{path}/measured", [name], [colours[k]], 3.0, run.q[:, k : k + 1]
        yield f"{path}/target", [f"target of {name}"], [style.TARGET], 1.0, run.target[:, k : k + 1]
    yield ERROR, names, colours, 1.5, 1e3 * run.error
    yield COMMANDS, names, colours, 1.5, run.command


def joint_path(name: str) -> str:
    """The entity with the plots of a joint."""
    return f"{JOINTS}/{rr.escape_entity_path_part(name)}"


def _names(arm: Arm) -> list[str]:
    return [joint.name for joint in arm.joints]


def _log_series(stream: rr.RecordingStream, run: ChainRun) -> None:
    times = time_column(run.t)
    for line in _lines(run):
        send_lines(stream, times, *line)


def _log_boxes(stream: rr.RecordingStream, run: ChainRun, task: Sorting) -> None:
    """The places with their names, and the boxes that wait, are held, or were put down last at each place."""
    names = list(task.places)
    stream.log(
        PLACES,
        rr.Points3D(
            [task.pick, *task.places.values()],
            labels=["pick", *names],
            colors=[style.LABEL, *(style.joint_colour(k) for k in range(len(names)))],
            radii=0.006,
            show_labels=True,
        ),
        static=True,
    )
    half = 0.5 * (task.usual / _DENSITY) ** (1.0 / 3.0)
    stream.log(BOXES, rr.Boxes3D.from_fields(fill_mode="solid"), static=True)
    tool = tool_of(run.settings.arm, run.true)[0]
    put: dict[int, Array] = {}
    before = (0, 0)
    for tick, places in enumerate(run.places.astype(int).tolist()):
        waits, held = places
        if before[1] and not held:
            put[before[1]] = tool[tick]
        if held or (waits, held) != before or not tick:
            shown = {**put, **({0: task.pick} if waits else {}), **({-1: tool[tick]} if held else {})}
            kinds = [{0: waits, -1: held}.get(number, number) for number in shown]
            stream.set_time(TIMELINE, duration=float(run.t[tick]))
            stream.log(
                BOXES,
                rr.Boxes3D(
                    half_sizes=[[half] * 3] * len(shown),
                    centers=list(shown.values()),
                    colors=[style.joint_colour(kind - 1) for kind in kinds],
                    fill_mode="solid",
                ),
            )
        before = (waits, held)
    stream.reset_time()


def _layout(run: ChainRun, geometry: Geometry) -> rrb.Blueprint:
    """The arm on the left, joints, errors and commands on the right."""
    arm = run.settings.arm
    tool = tool_of(arm, run.true[:: max(1, len(run.t) // 500)])[0]
    size = float(max(np.abs(tool).max(), *(np.linalg.norm(joint.translation) for joint in arm.joints)))
    error = reach(1e3 * run.error, 0.1)
    unit = " or ".join(sorted({joint.command_unit for joint in arm.joints}))
    what = EFFORTS.get(arm.joints[0].actuator.commanded, "command")
    side = rrb.Tabs(
        rrb.Vertical(
            plot_view("Joints and targets (rad or m)", JOINTS),
            plot_view("Distance from the path (mrad or mm)", ERROR, (-error, error)),
            plot_view(f"Commands, {what} ({unit})", COMMANDS),
            name="Overview",
        ),
        rrb.Vertical(*(plot_view(f"{name} and target", joint_path(name)) for name in _names(arm)), name="Joints"),
    )
    return rrb.Blueprint(
        rrb.Horizontal(_view(size, tool), side, column_shares=[1.15, 1]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        whole_time(),
    )


def _view(size: float, tool: Array) -> rrb.Spatial3DView:
    trail = rrb.VisibleTimeRanges(
        timeline=TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_TRAIL),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    middle = 0.5 * (tool.min(axis=0) + tool.max(axis=0))
    away = np.array([1.3, -2.2, 0.9]) * size
    return rrb.Spatial3DView(
        name="Arm",
        origin=ROOT,
        background=[222, 228, 234],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="orbital",
            position=tuple((middle + away).tolist()),
            look_target=tuple((0.5 * middle).tolist()),
            eye_up=(0.0, 0.0, 1.0),
        ),
        overrides={TRAIL: trail},
    )
