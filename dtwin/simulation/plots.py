"""Pictures of motions as PNG files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dtwin.parameters import PERIOD, VOLTAGE_LIMIT
from dtwin.pictures import COLOURS, DARK, legend, new_figure, save
from dtwin.simulation.measured import MotionComparison
from dtwin.simulation.whatif import Outcome

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_motions(outcomes: Mapping[str, Outcome], path: Path, comparison: MotionComparison | None = None) -> None:
    """Draws angles with their planned path, distances from the path and voltages, one column for each joint.

    Args:
        outcomes: simulated motions by name.
        path: path of the PNG file.
        comparison: a measured motion to draw beneath the simulated ones, or None.

    Raises:
        RecordingError: the path cannot be written.
    """
    figure = new_figure(14, 9)
    axes = figure.subplots(3, 3, sharex=True)
    for joint in range(3):
        angle, error, volts = axes[:, joint]
        if comparison is not None:
            time = np.arange(len(comparison.measured)) * PERIOD
            measured = comparison.measured[:, joint]
            angle.plot(time, measured, color=DARK, lw=2.5, alpha=0.6, label="measured")
            error.plot(time, comparison.path[:, joint] - measured, color=DARK, lw=2.5, alpha=0.6)
            volts.plot(time, comparison.volts[:, joint], color=DARK, lw=2.5, alpha=0.6)
        for number, (name, outcome) in enumerate(outcomes.items()):
            _one(angle, error, volts, joint, name, outcome, COLOURS[number % len(COLOURS)])
        angle.set_title(f"joint {joint + 1}")
        volts.set_ylim(-1.1 * VOLTAGE_LIMIT, 1.1 * VOLTAGE_LIMIT)
        volts.set_xlabel("time, s")
        for axis in (angle, error, volts):
            axis.grid(alpha=0.3)
    for axis, label in zip(axes[:, 0], ("angle, rad", "path minus angle, rad", "voltage, V"), strict=True):
        axis.set_ylabel(label)
    legend(axes[0, -1])
    save(figure, path)


def _one(angle: Axes, error: Axes, volts: Axes, joint: int, name: str, outcome: Outcome, colour: str) -> None:
    time = outcome.time
    angle.plot(time, outcome.theta[:, joint], color=colour, lw=1.5, label=name)
    angle.plot(time, outcome.path[:, joint], color=colour, lw=1.0, ls=":", label=f"{name}, path")
    error.plot(time, outcome.path[:, joint] - outcome.theta[:, joint], color=colour, lw=1.2)
    volts.step(time, outcome.volts[:, joint], color=colour, lw=1.0, where="post")
