"""Time series of a run: angles against path targets, errors, voltages, gripper, payload, box states, events."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from dtwin.parameters import PLACES, VOLTAGE_LIMIT
from dtwin.recording import Log
from dtwin.signals import NO_COLOUR, Event
from dtwin.view import style
from dtwin.view.boxes import Transport, Waiting

TIMELINE: Final = "plant_time"
ANGLES: Final = "angles"
ERROR: Final = "tracking_error"
VOLTS: Final = "volts"
GRIPPER: Final = "gripper"
PAYLOAD: Final = "payload"
STATES: Final = "box"
EVENTS: Final = "events"

_LEVELS: Final = {
    "misplaced": rr.TextLogLevel.ERROR,
    "dropped_arrival": rr.TextLogLevel.WARN,
    "fault": rr.TextLogLevel.WARN,
}
_NO_BOX: Final = "none"


def time_column(t: ArrayLike) -> rr.TimeColumn:
    """Plant times in s on the recording's time line, rounded to whole nanoseconds."""
    nanoseconds = np.round(np.asarray(t, dtype=np.float64) * 1e9)
    return rr.TimeColumn(TIMELINE, duration=nanoseconds.astype("timedelta64[ns]"))


def log_plots(stream: rr.RecordingStream, log: Log) -> None:
    """Sends the plots of a log with at least one tick, at its full rate."""
    t = log.columns["t"]
    times = time_column(t)
    theta, measured, target = (log.stack(name) for name in ("theta", "measured", "target"))
    numbers = (1, 2, 3)
    for joint in numbers:
        colour = style.JOINTS[joint - 1]
        path = f"{ANGLES}/joint_{joint}"
        _send(stream, f"{path}/measured", times, measured[:, joint - 1], [f"theta {joint}"], [colour], 3.5)
        _send(stream, f"{path}/target", times, target[:, joint - 1], [f"target {joint}"], [style.TARGET], 1.0)
    joints = [f"joint {joint}" for joint in numbers]
    _send(stream, ERROR, times, 1e3 * (target - theta), joints, style.JOINTS, 1.5)
    motors = [*joints, "gripper"]
    _send(stream, f"{VOLTS}/motors", times, log.stack("volts"), motors, [*style.JOINTS, style.GRIPPER], 1.5)
    limits = np.full((2, 2), (VOLTAGE_LIMIT, -VOLTAGE_LIMIT))
    ends = time_column(t[[0, -1]])
    _send(stream, f"{VOLTS}/limits", ends, limits, ["limit", "limit"], [style.LIMIT] * 2, 1.0)
    _send(stream, GRIPPER, times, log.columns["gripper"], ["gripper angle (rad)"], [style.GRIPPER], 2.0)
    _send(stream, PAYLOAD, times, log.columns["payload_mass"], ["payload (kg)"], [style.JOINTS[1]], 2.0)


def log_states(
    stream: rr.RecordingStream, log: Log, waiting: Sequence[Waiting], transports: Sequence[Transport]
) -> None:
    """Sends which box waits and which is held, as lanes of colours over time."""
    held = [(0, NO_COLOUR)]
    for transport in transports:
        held.append((transport.start, transport.colour))
        if transport.end is not None:
            held.append((transport.end, NO_COLOUR))
    lanes = {"waiting": [(change.tick, change.colour) for change in waiting], "held": held}
    for name, changes in lanes.items():
        entity = f"{STATES}/{name}"
        stream.log(
            entity,
            rr.StateConfiguration(
                values=[_NO_BOX, *PLACES],
                labels=["", *PLACES],
                colors=[(0, 0, 0, 0), *(style.box_colour(colour) for colour in PLACES)],
                visible=[False, *(True for _ in PLACES)],
            ),
            static=True,
        )
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
                text=[event.text for event in events],
                level=[_LEVELS.get(event.kind, rr.TextLogLevel.INFO) for event in events],
            ),
        )


def _send(
    stream: rr.RecordingStream,
    entity: str,
    times: rr.TimeColumn,
    values: ArrayLike,
    names: Sequence[str],
    colours: Sequence[style.RGB],
    width: float,
) -> None:
    stream.log(entity, rr.SeriesLines(names=names, colors=colours, widths=[width] * len(names)), static=True)
    stream.send_columns(entity, indexes=[times], columns=rr.Scalars.columns(scalars=values))
