"""Time series of a run: angles against path targets, errors, voltages, gripper, payload, box states, events."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from dtwin.logs.log import Log
from dtwin.parameters import VOLTAGE_LIMIT
from dtwin.signals import MONITOR, NO_COLOUR, Event, EventKind
from dtwin.task import Task
from dtwin.view import style
from dtwin.view.boxes import Grasp, Waiting

APPLICATION: Final = "dtwin"
TIMELINE: Final = "plant_time"
ANGLES: Final = "angles"
ERROR: Final = "tracking_error"
VOLTS: Final = "volts"
GRIPPER: Final = "gripper"
PAYLOAD: Final = "payload"
STATES: Final = "box"
EVENTS: Final = "events"

_LEVELS: Final[Mapping[str, rr.TextLogLevel]] = {
    EventKind.MISPLACED: rr.TextLogLevel.ERROR,
    EventKind.TURNED_AWAY: rr.TextLogLevel.WARN,
    EventKind.FAULT: rr.TextLogLevel.WARN,
    EventKind.SAFE: rr.TextLogLevel.WARN,
    EventKind.DIVERGED: rr.TextLogLevel.ERROR,
    EventKind.RIVALS: rr.TextLogLevel.WARN,
    EventKind.DISK: rr.TextLogLevel.WARN,
    MONITOR + EventKind.SUSPECTED: rr.TextLogLevel.WARN,
    MONITOR + EventKind.FAILED: rr.TextLogLevel.ERROR,
    MONITOR + EventKind.RESTART: rr.TextLogLevel.WARN,
}
_EQUAL: Final = 10
"""Number of ticks of which one is plotted though nothing changes."""
_NO_BOX: Final = "none"
_UNSEEN_ANGLE: Final = 5e-3
"""rad: the plots of angles are some radians high"""


@dataclass(frozen=True, slots=True)
class Plot:
    """The lines of one entity.

    Attributes:
        entity: path of the entity.
        names: names of the lines.
        colours: colours of the lines.
        width: width of all lines, in points of the user interface.
        unseen: distance from a line that does not show where the plot is as high as a screen, in units of the values.
        values: returns the values of the lines for a log, shape (ticks, lines).
    """

    entity: str
    names: Sequence[str]
    colours: Sequence[style.RGB]
    width: float
    unseen: float
    values: Callable[[Log], NDArray[np.float64]]


def _joint_plots(joint: int) -> tuple[Plot, Plot]:
    path = f"{ANGLES}/joint_{joint}"
    measured, target = f"measured_{joint}", f"target_{joint}"
    return (
        Plot(
            f"{path}/measured",
            [f"theta {joint}"],
            [style.JOINTS[joint - 1]],
            3.5,
            _UNSEEN_ANGLE,
            lambda log: log.columns[measured],
        ),
        Plot(
            f"{path}/target", [f"target {joint}"], [style.TARGET], 1.0, _UNSEEN_ANGLE, lambda log: log.columns[target]
        ),
    )


_NAMES: Final = ("joint 1", "joint 2", "joint 3")
PLOTS: Final = (
    *_joint_plots(1),
    *_joint_plots(2),
    *_joint_plots(3),
    Plot(ERROR, _NAMES, style.JOINTS, 1.5, 0.2, lambda log: 1e3 * (log.stack("target") - log.angles())),
    Plot(
        f"{VOLTS}/motors",
        (*_NAMES, "gripper"),
        (*style.JOINTS, style.GRIPPER),
        1.5,
        0.02,
        lambda log: log.stack("volts"),
    ),
    Plot(GRIPPER, ["gripper angle"], [style.GRIPPER], 2.0, _UNSEEN_ANGLE, lambda log: log.columns["gripper"]),
    Plot(PAYLOAD, ["payload"], [style.PAYLOAD], 2.0, 0.0, lambda log: log.columns["payload_mass"]),
)
LIMITS: Final = Plot(
    f"{VOLTS}/limits",
    ["limit", "limit"],
    [style.LIMIT, style.LIMIT],
    1.0,
    0.0,
    lambda log: np.tile([VOLTAGE_LIMIT, -VOLTAGE_LIMIT], (2, 1)),
)


def time_column(t: ArrayLike) -> rr.TimeColumn:
    """Plant times (s) on the time line of the recording, rounded to whole nanoseconds."""
    nanoseconds = np.round(np.asarray(t, dtype=np.float64) * 1e9)
    return rr.TimeColumn(TIMELINE, duration=nanoseconds.astype("timedelta64[ns]"))


def stream_of(notes: bytes, values: Iterable[NDArray[Any]], application: str = APPLICATION) -> rr.RecordingStream:
    """A stream in plant time, without a wall clock, whose id is the digest of what is drawn.

    By the id the viewer tells recordings apart.

    Args:
        notes: what is drawn, in words.
        values: the numbers of it.
        application: name of the program under which the viewer keeps layouts.
    """
    digest = hashlib.blake2b(notes, digest_size=16)
    for each in values:
        digest.update(each.tobytes())
    stream = rr.RecordingStream(application, recording_id=digest.hexdigest(), send_properties=False)
    stream.set_log_tick_enabled(False)
    stream.set_log_time_enabled(False)
    return stream


def send_lines(
    stream: rr.RecordingStream,
    times: rr.TimeColumn,
    entity: str,
    names: Sequence[str],
    colours: Sequence[style.RGB],
    width: float,
    values: NDArray[Any],
) -> None:
    """Sends the lines of one entity, values of shape (ticks, lines) or (ticks,), and how they look."""
    lines = rr.SeriesLines(names=names, colors=colours, widths=[width] * len(names))
    stream.log(entity, lines, static=True)
    stream.send_columns(entity, indexes=[times], columns=rr.Scalars.columns(scalars=values))


def log_styles(stream: rr.RecordingStream) -> None:
    """Sends names, colours and widths of the plotted lines."""
    for plot in (*PLOTS, LIMITS):
        lines = rr.SeriesLines(names=plot.names, colors=plot.colours, widths=[plot.width] * len(plot.names))
        stream.log(plot.entity, lines, static=True)


def log_limits(stream: rr.RecordingStream, log: Log) -> None:
    """Sends the limits of the voltages as lines from the start to the end of a log."""
    times = time_column(log.columns["t"][[0, -1]])
    stream.send_columns(LIMITS.entity, indexes=[times], columns=rr.Scalars.columns(scalars=LIMITS.values(log)))


def log_plots(stream: rr.RecordingStream, log: Log, plots: Sequence[Plot] = PLOTS, every: int = 1) -> None:
    """Sends the plotted values of a log, or a part of one; of equal ones in a row the outer two and a tenth.

    The viewer draws the mean of what falls on a pixel, so that a line has to have values on the next ones, too.

    Args:
        stream: where they are sent.
        log: the run.
        plots: what is plotted.
        every: number of ticks of which one is sent; between them only what a straight line would show otherwise.
    """
    t = log.columns["t"]
    for plot in plots:
        values = plot.values(log).reshape(len(log), -1)
        differs = np.ones(len(log) + 1, dtype=bool)
        differs[1:-1] = (values[1:] != values[:-1]).any(axis=1)
        kept = differs[1:] | differs[:-1]
        if every > 1:
            ends = differs[1:] != differs[:-1]
            kept &= ends | bends(values, every, plot.unseen)
        kept[::_EQUAL] = True
        columns = rr.Scalars.columns(scalars=values[kept])
        stream.send_columns(plot.entity, indexes=[time_column(t[kept])], columns=columns)


def bends(values: NDArray[np.float64], every: int, unseen: float) -> NDArray[np.bool_]:
    """The ticks that lines need which go straight from one to the next.

    Args:
        values: values of the lines, shape (ticks, lines).
        every: number of ticks of which one is needed at least.
        unseen: distance from the straight lines within which the others are; from lines through all that are needed
            they are no more than twice as far.

    Returns:
        Whether a tick is needed, shape (ticks,); beside a tick that is farther away both neighbours are, too.
    """
    ticks = np.arange(len(values))
    nodes = np.unique([*ticks[::every], len(values) - 1])
    straight = np.column_stack([np.interp(ticks, nodes, line[nodes]) for line in values.T])
    away = np.pad((np.abs(values - straight) > unseen).any(axis=1), 1)
    needed: NDArray[np.bool_] = away[:-2] | away[1:-1] | away[2:]
    needed[nodes] = True
    return needed


def log_states(
    stream: rr.RecordingStream,
    log: Log,
    waiting: Sequence[Waiting],
    grasps: Sequence[Grasp],
    task: Task,
    since: int = 0,
) -> None:
    """Sends which box waits and which is held from the tick `since` on, as lanes of colours over time."""
    held = [(0, NO_COLOUR)]
    for grasp in grasps:
        held.append((grasp.start, grasp.colour))
        if grasp.end is not None:
            held.append((grasp.end, NO_COLOUR))
    lanes = {"waiting": [(change.tick, change.colour) for change in waiting], "held": held}
    for name, changes in lanes.items():
        entity = f"{STATES}/{name}"
        stream.log(
            entity,
            rr.StateConfiguration(
                values=[_NO_BOX, *task.colours],
                labels=["", *task.colours],
                colors=[(0, 0, 0, 0), *map(task.rgb, task.colours)],
                visible=[False, *(True for _ in task.colours)],
            ),
            static=True,
        )
        changes = [change for change in changes if change[0] >= since]
        if not changes:
            continue
        ticks, colours = zip(*changes, strict=True)
        stream.send_columns(
            entity,
            indexes=[time_column(log.columns["t"][list(ticks)])],
            columns=rr.StateChange.columns(state=[colour or _NO_BOX for colour in colours]),
        )


def log_events(stream: rr.RecordingStream, events: Sequence[Event]) -> None:
    """Sends the events as text with levels."""
    if events:
        stream.send_columns(
            EVENTS,
            indexes=[time_column([event.time for event in events])],
            columns=rr.TextLog.columns(
                text=[_text(event) for event in events],
                level=[_LEVELS.get(event.kind, rr.TextLogLevel.INFO) for event in events],
            ),
        )


def _text(event: Event) -> str:
    """The text of an event; that of an event of the monitor starts with its kind."""
    if event.kind.startswith(MONITOR):
        return f"monitor: {event.kind.removeprefix(MONITOR)}: {event.text}"
    return event.text
