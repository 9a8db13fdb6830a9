"""A run of a production line as a Rerun recording: track, vehicles, boxes, arms, what each did, what was decided."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from dtwin.errors import RecordingError
from dtwin.view import style
from dtwin.view.layout import lanes_view, plot_view, whole_range, whole_time
from dtwin.view.saving import saving
from dtwin.view.series import EVENTS, TIMELINE, send_lines, stream_of, time_column

Array = NDArray[np.float64]

ROOT: Final = "line"
STATIONS: Final = "stations"
VEHICLES: Final = "vehicles"
THROUGHPUT: Final = "throughput"
BOXES: Final = "boxes"
WAITS, WORKS, STOPPED, BLOCKED = range(4)
HOME, EMPTY, LOADED, CHARGES = range(4)
_STATION: Final[Mapping[int, tuple[str, style.RGB]]] = {
    WAITS: ("waits", (200, 200, 200)),
    WORKS: ("works", (72, 120, 168)),
    STOPPED: ("stopped", (196, 78, 82)),
    BLOCKED: ("blocked", (204, 185, 116)),
}
_VEHICLE: Final[Mapping[int, tuple[str, style.RGB]]] = {
    HOME: ("at home", (200, 200, 200)),
    EMPTY: ("without a box", (168, 196, 222)),
    LOADED: ("with a box", (72, 120, 168)),
    CHARGES: ("charges", (85, 168, 104)),
}
_LEVELS: Final = {"finding": rr.TextLogLevel.ERROR, "stop": rr.TextLogLevel.ERROR}
_SIZE: Final = (0.25, 0.18, 0.08)
"""Half the size of a drawn vehicle, m."""
_TABLE: Final = (0.4, 0.3, 0.04)
"""Half the size of the drawn table that an arm stands on, m."""
TABLE: Final = 0.4
"""Height of that table, m."""
_BOX: Final = 0.08
"""Half the edge of a drawn box, m: larger than it is, so that it is seen in a line of many metres."""
_LINK: Final = 0.03
"""Radius of a drawn link, m."""


class Poses(NamedTuple):
    """Where an arm was.

    Attributes:
        times: plant times, (n,), s.
        joints: joints and tip, (n, points, 3), m.
    """

    times: Array
    joints: Array


class Drawn(NamedTuple):
    """The boxes in the line at a time.

    Attributes:
        places: where they are, (boxes, 3), m.
        done: number of operations that were done to each.
    """

    places: Array
    done: Sequence[int]


class Decided(NamedTuple):
    """Something that was decided, at a plant time (s)."""

    time: float
    kind: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class LineCourse:
    """What a line did, as it is drawn.

    Attributes:
        name: name of the line.
        segments: ends of the segments of its track, (segments, 2, 2), m.
        docks: names and places of its docks, m.
        tables: places of the stations' arms by the stations' names, m.
        vehicles: names of the vehicles.
        times: plant times, (n,), s.
        stations: what each station does, (n, stations): WAITS, WORKS, STOPPED or BLOCKED.
        phases: what each vehicle does, (n, vehicles): HOME, EMPTY, LOADED or CHARGES.
        positions: where each vehicle is, (n, vehicles, 2), m.
        boxes: the boxes in the line, n of them.
        rate: boxes an hour that leave, (n,).
        arms: where each station's arm was, by the stations' names.
        decisions: what was decided.
    """

    name: str
    segments: Array
    docks: Sequence[tuple[str, tuple[float, float]]]
    tables: Mapping[str, tuple[float, float]]
    vehicles: Sequence[str]
    times: Array
    stations: NDArray[np.int_]
    phases: NDArray[np.int_]
    positions: Array
    boxes: Sequence[Drawn]
    rate: Array
    arms: Mapping[str, Poses]
    decisions: Sequence[Decided]


def write_line_recording(course: LineCourse, path: Path) -> None:
    """Writes what a line did as an .rrd file with a prepared layout; the file appears complete or not at all.

    Equal runs have equal contents and the same recording id.

    Raises:
        RecordingError: nothing was done, or the path cannot be written.
    """
    if not len(course.times):
        raise RecordingError(f"{path}: expected a run of at least one look at the line to draw")
    drawn = (course.times, course.stations, course.phases, course.positions, course.rate)
    stream = stream_of(course.name.encode(), drawn)
    with saving(stream, path, _layout(course)):
        _log_track(stream, course)
        _log_stations(stream, course)
        _log_vehicles(stream, course)
        _log_boxes(stream, course)
        _log_series(stream, course)
        _log_decisions(stream, course)


def _log_track(stream: rr.RecordingStream, course: LineCourse) -> None:
    strips = np.concatenate([course.segments, np.zeros((*course.segments.shape[:2], 1))], axis=2)
    stream.log(f"{ROOT}/track", rr.LineStrips3D(strips, colors=style.TARGET, radii=0.02), static=True)
    stream.log(
        f"{ROOT}/docks",
        rr.Points3D(
            [(x, y, 0.0) for _, (x, y) in course.docks],
            labels=[name for name, _ in course.docks],
            colors=style.LABEL,
            radii=0.05,
            show_labels=True,
        ),
        static=True,
    )


def _log_stations(stream: rr.RecordingStream, course: LineCourse) -> None:
    """The tables, in the colour of what the station does, with their arms."""
    for number, (name, place) in enumerate(course.tables.items()):
        entity = f"{ROOT}/{STATIONS}/{rr.escape_entity_path_part(name)}"
        stream.log(
            entity,
            rr.Boxes3D(
                half_sizes=[_TABLE],
                centers=[(*place, TABLE - _TABLE[2])],
                labels=[name],
                show_labels=True,
                fill_mode="solid",
            ),
            static=True,
        )
        changes = _changes(course.stations[:, number])
        colours = np.array([_STATION[int(course.stations[k, number])][1] for k in changes], dtype=np.uint8)
        stream.send_columns(
            entity, indexes=[time_column(course.times[changes])], columns=rr.Boxes3D.columns(colors=colours)
        )
        _log_arm(stream, f"{entity}/arm", place, course.arms[name])
        _log_lane(stream, f"{STATIONS}/{name}", course.times, course.stations[:, number], _STATION)


def _log_arm(stream: rr.RecordingStream, entity: str, place: tuple[float, float], poses: Poses) -> None:
    if not len(poses.times):
        return
    strips = list(poses.joints + np.array([*place, TABLE]))
    stream.log(entity, rr.LineStrips3D.from_fields(colors=[style.JOINTS[0]], radii=[_LINK]), static=True)
    stream.send_columns(entity, indexes=[time_column(poses.times)], columns=rr.LineStrips3D.columns(strips=strips))


def _log_vehicles(stream: rr.RecordingStream, course: LineCourse) -> None:
    for number, name in enumerate(course.vehicles):
        entity = f"{ROOT}/{VEHICLES}/{rr.escape_entity_path_part(name)}"
        stream.log(entity, rr.Boxes3D(half_sizes=[_SIZE], labels=[name], fill_mode="solid"), static=True)
        places = np.column_stack((course.positions[:, number], np.full(len(course.times), _SIZE[2])))
        moved = _changes(places)
        columns = rr.Transform3D.columns(translation=places[moved])
        stream.send_columns(entity, indexes=[time_column(course.times[moved])], columns=columns)
        changes = _changes(course.phases[:, number])
        colours = np.array([_VEHICLE[int(course.phases[k, number])][1] for k in changes], dtype=np.uint8)
        stream.send_columns(
            entity, indexes=[time_column(course.times[changes])], columns=rr.Boxes3D.columns(colors=colours)
        )
        _log_lane(stream, f"{VEHICLES}/{name}", course.times, course.phases[:, number], _VEHICLE)


def _log_boxes(stream: rr.RecordingStream, course: LineCourse) -> None:
    """The boxes, each in the colour of the number of operations that were done to it."""
    entity = f"{ROOT}/{BOXES}"
    stream.log(entity, rr.Boxes3D.from_fields(fill_mode="solid"), static=True)
    rows = [k for k in range(len(course.boxes)) if not k or not _alike(course.boxes[k], course.boxes[k - 1])]
    shown = [course.boxes[k] for k in rows]
    places = np.concatenate([row.places.reshape(-1, 3) for row in shown])
    columns = rr.Boxes3D.columns(
        half_sizes=np.full((len(places), 3), _BOX),
        centers=places,
        colors=np.array([style.joint_colour(n) for row in shown for n in row.done], dtype=np.uint8).reshape(-1, 3),
    )
    stream.send_columns(
        entity,
        indexes=[time_column(course.times[rows])],
        columns=columns.partition([len(row.done) for row in shown]),
    )


def _log_series(stream: rr.RecordingStream, course: LineCourse) -> None:
    lines = {
        THROUGHPUT: ("boxes an hour", style.JOINTS[0], course.rate),
        BOXES: ("boxes in the line", style.JOINTS[1], np.array([len(row.done) for row in course.boxes], float)),
    }
    for entity, (name, colour, values) in lines.items():
        send_lines(stream, time_column(course.times), entity, [name], [colour], 2.0, values)


def _log_lane(
    stream: rr.RecordingStream,
    entity: str,
    times: Array,
    states: NDArray[np.int_],
    known: Mapping[int, tuple[str, style.RGB]],
) -> None:
    """A lane of colours over time: a row of a Gantt chart."""
    words = [word for word, _ in known.values()]
    stream.log(
        entity,
        rr.StateConfiguration(values=words, labels=words, colors=[colour for _, colour in known.values()]),
        static=True,
    )
    changes = _changes(states)
    columns = rr.StateChange.columns(state=[known[int(states[k])][0] for k in changes])
    stream.send_columns(entity, indexes=[time_column(times[changes])], columns=columns)


def _log_decisions(stream: rr.RecordingStream, course: LineCourse) -> None:
    if course.decisions:
        stream.send_columns(
            EVENTS,
            indexes=[time_column([decided.time for decided in course.decisions])],
            columns=rr.TextLog.columns(
                text=[decided.text for decided in course.decisions],
                level=[_LEVELS.get(decided.kind, rr.TextLogLevel.INFO) for decided in course.decisions],
            ),
        )


def _changes(values: NDArray[np.generic]) -> NDArray[np.int_]:
    """The rows that are others than those before them, the first one among them."""
    rows = values.reshape(len(values), -1)
    return np.flatnonzero(np.concatenate(([True], (rows[1:] != rows[:-1]).any(axis=1))))


def _alike(one: Drawn, other: Drawn) -> bool:
    return one.done == other.done and np.array_equal(one.places, other.places)


def _layout(course: LineCourse) -> rrb.Blueprint:
    """The line above what it did; throughput and decisions beside it."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(_view(course), _lanes(course), row_shares=[1.3, 1.0]),
            rrb.Vertical(
                plot_view("Boxes that left in the minute before, an hour", THROUGHPUT),
                plot_view("Boxes in the line", BOXES),
                rrb.TextLogView(
                    name="Decisions",
                    origin="/",
                    contents=[EVENTS],
                    columns=rrb.TextLogColumns(timeline_columns=[TIMELINE], text_log_columns=["loglevel", "body"]),
                ),
            ),
            column_shares=[1.6, 1.0],
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        whole_time(),
    )


def _lanes(course: LineCourse) -> rrb.StateTimelineView:
    time = whole_range(float(course.times[0]), float(course.times[-1]))
    return lanes_view("What stations and vehicles did", [f"{STATIONS}/**", f"{VEHICLES}/**"], time)


def _view(course: LineCourse) -> rrb.Spatial3DView:
    points = np.array([*_points(course)])
    low, high = points.min(axis=0), points.max(axis=0)
    middle, size = 0.5 * (low + high), float(np.linalg.norm(high - low))
    return rrb.Spatial3DView(
        name=f"Line {course.name}",
        origin=ROOT,
        background=[222, 228, 234],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="orbital",
            position=(float(middle[0]), float(middle[1]) - 0.4 * size, 0.34 * size),
            look_target=(float(middle[0]), float(middle[1]), 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def _points(course: LineCourse) -> Iterator[Array]:
    yield from course.segments.reshape(-1, 2)
    yield from map(np.asarray, course.tables.values())
