"""The prepared layout of the viewer: the cell large on the left, states and plots on the right, events below."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final
from uuid import UUID

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from dtwin.logs.log import Log
from dtwin.parameters import VOLTAGE_LIMIT
from dtwin.task import Task
from dtwin.view import scene, series, story

_TRAIL_SECONDS: Final = 2.0
_LIVE_SECONDS: Final = 60.0
"""Time that plots of a run that goes on look back."""
_LIVE_ERROR: Final = 50.0
"""Tracking error that such plots show, mrad: five times what a healthy arm has."""
_MARGIN: Final = 1.05
"""A range goes on a little beyond the last tick of its axis, which is written otherwise."""
VOLTS: Final = (-1.25 * _MARGIN * VOLTAGE_LIMIT, 1.25 * _MARGIN * VOLTAGE_LIMIT)
"""Range of voltages, V, around the limits."""
GRIPPER_ANGLES: Final = (0.0, 1.0 * _MARGIN)
"""Range of angles of the gripper, rad."""
_SHARED_AXIS: Final = UUID("5c0dca6a-e63f-9cf7-f657-2602590474cc")
"""Number of the view with which Rerun's viewer keeps the range of all linked time axes."""


@dataclass(frozen=True, slots=True)
class Extent:
    """What plots show.

    Attributes:
        time: range of the time axis that all plots share.
        angles: range of angles, rad.
        error: largest tracking error, mrad.
        payload: largest payload, kg.
    """

    time: rr.TimeRange
    angles: tuple[float, float]
    error: float
    payload: float


def extent_of(log: Log, task: Task) -> Extent:
    """What holds a whole log of at least one tick."""
    t = log.columns["t"]
    told = ~np.isnan(log.stack("target"))
    shown = np.concatenate((log.angles(), log.stack("target")[told.all(axis=1)]))
    usual = _angles(task)
    error = 1e3 * (log.stack("target") - log.angles())[told]
    return Extent(
        whole_range(float(t[0]), float(t[-1])),
        (min(usual[0], math.floor(shown.min())), max(usual[1], math.ceil(shown.max()))),
        reach(error, 1.0),
        _payload(float(np.nanmax(log.columns["payload_mass"], initial=task.boxes.heaviest))),
    )


def live_extent(task: Task) -> Extent:
    """What is shown of a run that goes on."""
    back, ahead = (rr.TimeRangeBoundary.cursor_relative(seconds=seconds) for seconds in (-_LIVE_SECONDS, 2.0))
    return Extent(rr.TimeRange(back, ahead), _angles(task), _MARGIN * _LIVE_ERROR, _payload(task.boxes.heaviest))


def _angles(task: Task) -> tuple[float, float]:
    """Whole numbers around the angles of all places, rad."""
    angles = [angle for place in task.all_places.values() for angle in place.theta]
    return float(math.floor(min(angles))), float(math.ceil(max(angles)))


def _payload(heaviest: float) -> float:
    """The end of an axis that has whole tenths and holds a mass, kg."""
    return _MARGIN * math.ceil(10 * heaviest) / 10


def reach(values: NDArray[np.float64], least: float) -> float:
    """The end of an axis that holds the sizes of some values, those that are finite, and at least `least`.

    It is a little beyond 1, 2 or 5 times a power of ten, so that runs that are alike have the same axis.
    """
    return _MARGIN * _round(float(np.max(np.abs(values), initial=least, where=np.isfinite(values))))


def _round(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(value))
    return next(step * power for step in (1, 2, 5, 10) if step * power >= value * (1 - 1e-9))


def blueprint(extent: Extent, *more: rrb.Vertical) -> rrb.Blueprint:
    """The layout of a recording; further tabs come first."""
    return _arranged(extent, whole_time(), *more)


def whole_time() -> rrb.TimePanel:
    """The time of a finished run, which plays in a loop."""
    return rrb.TimePanel(state="collapsed", timeline=series.TIMELINE, loop_mode="all")


def live_blueprint(extent: Extent, *more: rrb.Vertical) -> rrb.Blueprint:
    """The layout of a recording that grows, which shows the newest time; further tabs come first."""
    time = rrb.TimePanel(state="collapsed", timeline=series.TIMELINE, play_state="following")
    return _arranged(extent, time, *more)


def sparse_blueprint(extent: Extent) -> rrb.Blueprint:
    """The layout of a run that is sent sparsely: as few views as tell what happens."""
    time = rrb.TimePanel(state="collapsed", timeline=series.TIMELINE, play_state="following")
    side = rrb.Vertical(_states(extent), _error(extent), _events())
    return _whole(rrb.Horizontal(rrb.Vertical(_status(), cell_view(), row_shares=[0.45, 4]), side), time)


def _arranged(extent: Extent, time: rrb.TimePanel, *more: rrb.Vertical) -> rrb.Blueprint:
    """State and cell on the left, states over tabs on the right."""
    tabs = rrb.Tabs(*more, _overview(extent), _joints(extent), _gripper(extent), active_tab=0)
    views = rrb.Horizontal(
        rrb.Vertical(_status(), cell_view(), _events(), row_shares=[0.45, 3, 1]),
        rrb.Vertical(_states(extent), tabs, row_shares=[1, 4]),
        column_shares=[1.15, 1],
    )
    return _whole(views, time)


def _whole(views: rrb.Horizontal, time: rrb.TimePanel) -> rrb.Blueprint:
    return rrb.Blueprint(
        views,
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        time,
    )


def cell_view() -> rrb.Spatial3DView:
    """The cell in 3D."""
    trail = rrb.VisibleTimeRanges(
        timeline=series.TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_TRAIL_SECONDS),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    return rrb.Spatial3DView(
        name="Cell",
        origin=scene.ROOT,
        background=[222, 228, 234],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            kind="orbital",
            position=(-0.3, -0.9, 0.15),
            look_target=(0.1, 0.0, -0.02),
            eye_up=(0.0, 0.0, 1.0),
        ),
        overrides={scene.TRAIL: trail},
    )


def _status() -> rrb.TextDocumentView:
    return rrb.TextDocumentView(name="Status", origin=story.STATUS)


def _events() -> rrb.TextLogView:
    return rrb.TextLogView(
        name="Events",
        origin="/",
        contents=[series.EVENTS, "monitor/findings"],
        columns=rrb.TextLogColumns(timeline_columns=[series.TIMELINE], text_log_columns=["loglevel", "body"]),
    )


def _states(extent: Extent) -> rrb.StateTimelineView:
    return lanes_view("Controller and boxes", ["controller/**", f"{series.STATES}/**"], extent.time)


def lanes_view(name: str, contents: Sequence[str], time: rr.TimeRange) -> rrb.StateTimelineView:
    """Lanes of states over a time, which all linked time axes then show."""
    axis = rrb.TimeAxis(link="linktoglobal", view_range=time)
    view = rrb.StateTimelineView(name=name, origin="/", contents=list(contents), time_view=axis)
    view.id = _SHARED_AXIS
    return view


def whole_range(first: float, last: float) -> rr.TimeRange:
    """The time from a first to a last moment, s, and a little around it."""
    margin = 0.02 * max(last - first, 0.1)
    ends = (rr.TimeRangeBoundary.absolute(seconds=moment) for moment in (first - margin, last + margin))
    return rr.TimeRange(*ends)


def _error(extent: Extent) -> rrb.TimeSeriesView:
    return plot_view("Tracking error (mrad)", series.ERROR, (-extent.error, extent.error))


def _overview(extent: Extent) -> rrb.Vertical:
    return rrb.Vertical(
        plot_view("Angles and targets (rad)", series.ANGLES, extent.angles),
        _error(extent),
        plot_view("Voltages (V)", series.VOLTS, VOLTS),
        name="Overview",
    )


def _joints(extent: Extent) -> rrb.Vertical:
    return rrb.Vertical(
        *(
            plot_view(f"Joint {joint}: angle and target (rad)", f"{series.ANGLES}/joint_{joint}", extent.angles)
            for joint in (1, 2, 3)
        ),
        name="Joints",
    )


def _gripper(extent: Extent) -> rrb.Vertical:
    return rrb.Vertical(
        plot_view("Gripper angle (rad)", series.GRIPPER, GRIPPER_ANGLES),
        plot_view("Payload (kg)", series.PAYLOAD, (0.0, extent.payload)),
        name="Gripper",
    )


def plot_view(name: str, origin: str, shown: Sequence[float] | None = None) -> rrb.TimeSeriesView:
    """A plot of all entities below an origin, whose time axis is that of all plots.

    Args:
        name: its title.
        origin: the entity.
        shown: lowest and highest value; as the values have it without. With it, moments worth a look are marked.
    """
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        contents=["$origin/**"] if shown is None else ["$origin/**", f"{story.MARKS}/**"],
        axis_x=rrb.TimeAxis(link="linktoglobal"),
        axis_y=None if shown is None else rrb.ScalarAxis(range=(shown[0], shown[1])),
        plot_legend=rrb.PlotLegend(corner="righttop"),
    )
