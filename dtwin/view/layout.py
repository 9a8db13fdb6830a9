"""The prepared layout of the viewer: the cell large on the left, plots on the right, events below."""

from __future__ import annotations

from typing import Final

import rerun.blueprint as rrb

from dtwin.parameters import VOLTAGE_LIMIT
from dtwin.view import scene, series

_TRAIL_SECONDS: Final = 2.0
_VOLTS_SHOWN: Final = 1.1 * VOLTAGE_LIMIT


def blueprint(*more: rrb.Vertical) -> rrb.Blueprint:
    """The layout of a recording; further tabs come first."""
    return _arranged(rrb.TimePanel(state="collapsed", timeline=series.TIMELINE, loop_mode="all"), *more)


def live_blueprint(*more: rrb.Vertical) -> rrb.Blueprint:
    """The layout of a recording that grows, which shows the newest time; further tabs come first."""
    return _arranged(rrb.TimePanel(state="collapsed", timeline=series.TIMELINE, play_state="following"), *more)


def _arranged(time: rrb.TimePanel, *more: rrb.Vertical) -> rrb.Blueprint:
    """The cell on the left, tabs on the right."""
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(cell_view(), _events(), row_shares=[3, 1]),
            rrb.Tabs(*more, _overview(), _joints(), _boxes(), active_tab=0),
            column_shares=[1.15, 1],
        ),
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


def _events() -> rrb.TextLogView:
    return rrb.TextLogView(
        name="Events",
        origin=series.EVENTS,
        columns=rrb.TextLogColumns(timeline_columns=[series.TIMELINE], text_log_columns=["loglevel", "body"]),
    )


def _overview() -> rrb.Vertical:
    return rrb.Vertical(
        plot_view("Angles and targets (rad)", series.ANGLES),
        plot_view("Tracking error (mrad)", series.ERROR),
        plot_view("Voltages (V)", series.VOLTS, rrb.ScalarAxis(range=(-_VOLTS_SHOWN, _VOLTS_SHOWN))),
        name="Overview",
    )


def _joints() -> rrb.Vertical:
    return rrb.Vertical(
        *(
            plot_view(f"Joint {joint}: angle and target (rad)", f"{series.ANGLES}/joint_{joint}")
            for joint in (1, 2, 3)
        ),
        name="Joints",
    )


def _boxes() -> rrb.Vertical:
    return rrb.Vertical(
        rrb.StateTimelineView(name="Boxes", origin=series.STATES),
        plot_view("Gripper angle (rad)", series.GRIPPER),
        plot_view("Payload (kg)", series.PAYLOAD),
        row_shares=[1, 2, 2],
        name="Boxes",
    )


def plot_view(name: str, origin: str, axis_y: rrb.ScalarAxis | None = None) -> rrb.TimeSeriesView:
    """A plot of all entities below an origin, whose time axis is linked to those of all plots."""
    return rrb.TimeSeriesView(
        name=name,
        origin=origin,
        axis_x=rrb.TimeAxis(link="linktoglobal"),
        axis_y=axis_y,
        plot_legend=rrb.PlotLegend(corner="righttop"),
    )
