"""Figures 5.6 to 5.9 and 5.15: responses of single identified models beside the data, and their parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.controller.excitation import ExcitationController
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, identify
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.pictures import COLOURS, DARK, legend, new_figure
from evidence.identification.friction import COULOMB
from evidence.report import Picture
from evidence.reproduce.chapter import Chapter, Line, Part, Scope, curve, percent
from evidence.reproduce.parameters import settings, thesis_settings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DIFFERENCE: Final = np.array([-49 / 20, 6, -15 / 2, 20 / 3, -15 / 4, 6 / 5, -1 / 6])
"""The sixth-order forward difference by which the thesis estimates the speeds at the first sample, times PERIOD."""
_CASES: Final = {
    "5.6": ("no noise", 0.0, 0),
    "5.7": ("both friction laws, 0.005 rad", 0.005, 3),
    "5.8": ("0.010 rad, another run", 0.010, 4),
    "5.9": ("0.010 rad", 0.010, 6),
    "5.15": ("0.001 rad", 0.001, 1),
}
"""what it is, magnitude of the noise in rad, and number of the run"""


def _measure(scope: Scope, progress: Progress) -> dict[str, Any]:
    blocks, truth, numbers = ExcitationController(), ArmParameters(), {}
    for done, (figure, (_, noise, run)) in enumerate(_CASES.items()):
        progress(done, len(_CASES))
        experiment = Rig(noise=noise).measure(Plan(), blocks, np.random.default_rng((scope.seed, 30, run)))
        chosen = {"thesis": settings("thesis"), "ours": settings("ours")}
        if figure == "5.7":
            chosen["thesis"] = thesis_settings(tuple(COULOMB))
        numbers[figure] = {
            "speeds": (DIFFERENCE @ experiment.measured[: len(DIFFERENCE)] / PERIOD).tolist(),
            **{
                way: _fitted(identify([experiment], made), made, experiment.measured, truth)
                for way, made in chosen.items()
            },
        }
    return numbers


def _fitted(found: Estimate, made: EstimationSettings, measured: np.ndarray, truth: ArmParameters) -> dict[str, Any]:
    left = found.residuals[0]
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    return {
        "fit": (1.0 - np.linalg.norm(left, axis=0) / spread).tolist(),
        "error": {name: abs(found.values[name] - truth.get(name)) / (truth.get(name) or 1.0) for name in made.free},
        "curves": curve(PERIOD * np.arange(len(measured)), *measured.T, *(measured - left).T),
    }


def _lines(numbers: Mapping[str, Any]) -> list[Line]:
    def fits(figure: str) -> str:
        return ", ".join(
            f"{way}: {min(numbers[figure][key]['fit']):.4f}" for key, way in (("thesis", "18"), ("ours", "12"))
        )

    def worst(figure: str, way: str) -> str:
        errors = numbers[figure][way]["error"]
        name = max((each for each in errors if not each.startswith("mu")), key=lambda each: errors[each])
        return f"{percent(errors[name])} ({name})"

    deviation = 0.010 / math.sqrt(12) * float(np.linalg.norm(DIFFERENCE)) / PERIOD
    off = ", ".join(f"{speed:+.2f}" for speed in numbers["5.8"]["speeds"])
    return [
        Line("5.6", "smallest fit without noise", "nearly perfect", fits("5.6")),
        Line(
            "5.6",
            "largest error of a parameter all the same",
            "clearly large",
            f"{worst('5.6', 'thesis')} with 18, {worst('5.6', 'ours')} with 12",
        ),
        Line("5.7", "smallest fit with both friction laws", "excellent", fits("5.7")),
        Line(
            "5.8", "initial speeds of an arm at rest by differences, rad/s", "wildly different on links 1 and 2", off
        ),
        Line(
            "5.8",
            "standard deviation of such a speed at 0.010 rad",
            "not given",
            f"{deviation:.1f} rad/s by propagation of the noise",
        ),
        Line("5.9", "smallest fit at 0.010 rad", "above 0.90", fits("5.9")),
        Line(
            "5.9",
            "largest error of a parameter",
            "sizeable",
            f"{worst('5.9', 'thesis')} with 18, {worst('5.9', 'ours')} with 12",
        ),
        Line("5.15", "smallest fit at 0.001 rad", "very good", fits("5.15")),
    ]


def _curves(numbers: Mapping[str, Any]) -> Figure:
    """Angles read and those of the model of 18 parameters, one row an experiment."""
    figure = new_figure(13, 12)
    grid = figure.subplots(len(_CASES), 3, sharex=True)
    for row, (name, (words, _, _)) in zip(grid, _CASES.items(), strict=True):
        time, *columns = numbers[name]["thesis"]["curves"]
        for joint in range(3):
            row[joint].plot(time, columns[joint], color=DARK, lw=2.2, alpha=0.5, label="read")
            row[joint].plot(time, columns[3 + joint], color=COLOURS[joint], lw=1.0, label="model")
            row[joint].grid(alpha=0.3)
        row[0].set_ylabel(f"{name}\n{words}\nrad", fontsize=8)
    for joint in range(3):
        grid[0, joint].set_title(f"link {joint + 1}", fontsize=10)
        grid[-1, joint].set_xlabel("time, s")
    legend(grid[0, -1])
    return figure


def _errors(numbers: Mapping[str, Any]) -> Figure:
    """Errors of the 18 parameters without noise and with it."""
    figure = new_figure(13, 5)
    for axis, name in zip(figure.subplots(1, 2, sharey=True), ("5.6", "5.9"), strict=True):
        errors = numbers[name]["thesis"]["error"]
        axis.bar(range(len(errors)), [100 * value for value in errors.values()], color=COLOURS[0])
        axis.set_xticks(range(len(errors)), list(errors), fontsize=8)
        axis.set_title(f"{name}: {_CASES[name][0]}", fontsize=10)
        axis.grid(alpha=0.3, axis="y")
    figure.axes[0].set_yscale("log")
    figure.axes[0].set_ylabel("error, %")
    return figure


def _tell(numbers: Mapping[str, Any]) -> Chapter:
    return Chapter(
        "Single experiments of 350 samples, fitted with the thesis's 18 parameters, and with 12 parameters and "
        "offsets.",
        _lines(numbers),
        "All fits start from an arm known to be at rest and keep all 350 samples. The thesis kept 346, and starts "
        "from the difference of the first seven, which multiplies their noise, as Figure 5.8 shows.",
        "A fit near 1 says nothing of single parameters, which the thesis found too; which combinations the data "
        "determine is told by `dtwin identify`.",
        [
            Picture(
                _curves(numbers),
                "Angles that the encoders read (grey) and the response of the identified model of 18 parameters "
                "(coloured) over time, for the experiments of the thesis's Figures 5.6 to 5.9 and 5.15.",
            ),
            Picture(
                _errors(numbers),
                "Absolute error of each of the 18 parameters of the models without noise and with 0.010 u rad of "
                "it (the thesis's Figures 5.6 and 5.9).",
            ),
        ],
    )


FITS = Part("fits", "Responses of identified models (Figures 5.6 to 5.9 and 5.15)", _measure, _tell)
