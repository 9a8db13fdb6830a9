"""Pictures of runs and of what the monitor made of them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.logs.log import Log
from dtwin.monitoring.offline import Trace
from dtwin.parameters import VOLTAGE_LIMIT
from dtwin.pictures import COLOURS, DARK, RED, legend, new_figure
from dtwin.signals import MONITOR, Event, EventKind

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_GRAVE: Final = (
    *(MONITOR + EventKind.FAILED, MONITOR + EventKind.MISFIT),
    *(EventKind.FAULT, EventKind.SAFE, EventKind.STOP, EventKind.DIVERGED),
    *(EventKind.COLLISION, EventKind.MISPLACED, EventKind.SLIPPED, EventKind.GRIP_MISSED),
)
"""kinds of events that are drawn in red"""
_LINES: Final = 3
"""lines of text that the names of events above a picture share, so that near ones can be read"""


def draw_run(log: Log) -> Figure:
    """Draws measured angles on their paths, one row for each joint, and the voltages of all; events are marked."""
    figure = new_figure(11, 8)
    *joints, last = figure.subplots(4, 1, sharex=True)
    time, measured, path, volts = log.columns["t"], log.stack("measured"), log.stack("target"), log.stack("volts")
    for joint, axis in enumerate(joints):
        axis.plot(time, measured[:, joint], color=COLOURS[joint], lw=2.5, alpha=0.6, label="measured")
        axis.plot(time, path[:, joint], color=DARK, lw=1.0, ls="--", label="path")
        axis.set_ylabel(f"joint {joint + 1}, rad")
        last.step(time, volts[:, joint], color=COLOURS[joint], lw=0.8, where="post", label=f"joint {joint + 1}")
    last.set_ylim(-1.1 * VOLTAGE_LIMIT, 1.1 * VOLTAGE_LIMIT)
    last.set_ylabel("voltage, V")
    _finish((*joints, last), log.events)
    return figure


def draw_trace(log: Log, trace: Trace) -> Figure:
    """Draws how far readings are from what the monitor expected, with what a healthy arm's have, and its evidence."""
    figure = new_figure(11, 8)
    *joints, last = figure.subplots(4, 1, sharex=True)
    time = log.columns["t"]
    residual = 1e3 * (log.stack("measured") - trace.predicted)
    spread = 3e3 * trace.deviation
    for joint, axis in enumerate(joints):
        axis.plot(time, residual[:, joint], color=COLOURS[joint], lw=0.8, label="reading minus prediction")
        axis.fill_between(
            time,
            -spread[:, joint],
            spread[:, joint],
            color=DARK,
            alpha=0.2,
            lw=0,
            label="three standard deviations",
        )
        # The first samples are expected with a deviation beyond all that follows.
        axis.set_ylim(*(1.2 * np.array((-1, 1)) * max(abs(residual[:, joint]).max(), np.median(spread[:, joint]))))
        axis.set_ylabel(f"joint {joint + 1}, mrad")
    last.plot(time, trace.statistic, color=DARK, lw=0.8, label="evidence of a change")
    last.axhline(trace.threshold, color=RED, lw=1.0, ls="--", label="threshold")
    last.set_ylabel("2 log likelihood ratio")
    _finish((*joints, last), trace.events)
    return figure


def _finish(axes: tuple[Axes, ...], events: Iterable[Event]) -> None:
    """Marks events by vertical lines, the first of each kind by its name, and lets legends and grids be seen."""
    named: set[str] = set()
    for event in events:
        colour = RED if event.kind in _GRAVE else COLOURS[6]
        for axis in axes:
            axis.axvline(event.time, color=colour, lw=0.8, alpha=0.6, gid=event.kind)
        if event.kind not in named:
            height = 2 + 9 * (len(named) % _LINES)
            named.add(event.kind)
            axes[0].annotate(
                event.kind,
                (event.time, 1.0),
                (1, height),
                xycoords=("data", "axes fraction"),
                textcoords="offset points",
                fontsize=7,
                color=colour,
            )
    for axis in axes:
        axis.grid(alpha=0.3)
        legend(axis)
    axes[-1].set_xlabel("time, s")
