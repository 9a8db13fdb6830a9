"""Pictures of an identification."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.identification.data import Array
from dtwin.identification.estimation.estimate import NINETY_FIVE, Estimate
from dtwin.identification.held_out import Comparison
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.pictures import COLOURS, DARK, RED, legend, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SHOWN: Final = 1000
"""Largest number of samples of a motion that a picture shows."""


def picture(estimate: Estimate, old: Comparison, new: Comparison, truth: ArmParameters | None, title: str) -> Figure:
    """Draws a held-out motion beside the predictions of two models, the confidence intervals and the correlation.

    Args:
        estimate: result of the identification.
        old: held-out motion and the prediction of the model before the identification.
        new: held-out motion and the prediction of the identified model.
        truth: true parameters, drawn beside the intervals; None where they are not known.
        title: title of the picture.
    """
    figure = new_figure(13, 9)
    figure.suptitle(title)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.25, 1))
    for joint in range(3):
        _motion(figure.add_subplot(grid[joint, 0]), joint, old, new)
    names = [name for name in estimate.problem.free if np.isfinite(estimate.standard_errors[name])]
    if names:
        _intervals(figure.add_subplot(grid[0, 1]), estimate, names, truth)
        _correlation(figure, figure.add_subplot(grid[1:, 1]), estimate)
    return figure


def _motion(axis: Axes, joint: int, old: Comparison, new: Comparison) -> None:
    time = np.arange(len(new.measured))[:_SHOWN] * PERIOD
    lines: tuple[tuple[Array, str, str], ...] = (
        (new.measured, DARK, "measured"),
        (old.predicted, RED, f"model before, fit {old.fit[joint]:.3f}"),
        (new.predicted, COLOURS[0], f"identified, fit {new.fit[joint]:.3f}"),
    )
    for angles, colour, label in lines:
        wide = label == "measured"
        axis.plot(
            time,
            angles[:_SHOWN, joint],
            color=colour,
            lw=2.5 if wide else 1.1,
            alpha=0.45 if wide else 1,
            label=label,
        )
    axis.set_ylabel(f"theta {joint + 1}, rad")
    legend(axis)
    axis.grid(alpha=0.3)
    if joint == 0:
        axis.set_title("motion the model was not fitted to", fontsize=10)
    if joint == 2:
        axis.set_xlabel("time, s")


def _intervals(axis: Axes, estimate: Estimate, names: list[str], truth: ArmParameters | None) -> None:
    reference = truth or estimate.problem.fixed
    size = np.array([reference.get(name) or 1.0 for name in names])
    value = np.array([estimate.values[name] for name in names])
    centre = np.array([reference.get(name) for name in names])
    half = NINETY_FIVE * np.array([estimate.standard_errors[name] for name in names])
    position = np.arange(len(names))
    axis.errorbar(
        position, 100 * (value - centre) / size, 100 * half / size, fmt="o", color=COLOURS[0], ms=4, capsize=3
    )
    axis.axhline(0, color=DARK, lw=1)
    axis.set_xticks(position, names)
    axis.set_ylabel(f"% from the {'truth' if truth else 'data sheet'}")
    axis.set_title("estimates with 95 % intervals", fontsize=10)
    axis.grid(alpha=0.3)


def _correlation(figure: Figure, axis: Axes, estimate: Estimate) -> None:
    names = estimate.problem.shared
    image = axis.imshow(estimate.correlation, vmin=-1, vmax=1, cmap="RdBu_r")
    axis.set_xticks(np.arange(len(names)), names, rotation=90, fontsize=8)
    axis.set_yticks(np.arange(len(names)), names, fontsize=8)
    axis.set_title("correlation of the estimates", fontsize=10)
    figure.colorbar(image, ax=axis, shrink=0.8)
