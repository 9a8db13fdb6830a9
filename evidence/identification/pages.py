"""What the reports of the identification experiments share: their frame, tables and chart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.pictures import COLOURS, DARK, RED, new_figure
from evidence.identification.groups import Group
from evidence.report import Picture, Report, page, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SETUP: Final = (
    "The arm of the emulation (MuJoCo) starts at rest in its home position and follows the 3-2-1-1 signal of the "
    "function blocks (+-6, 4, 3 V, units of 50 ms) for 350 samples of 10 ms, a known load of 200 g on its tip. "
    "Estimated are K, I, c and D of the three links and the offsets of the three encoders; masses, lengths and the "
    "load are taken as known."
)


def identification_report(title: str, setup: str, findings: str, conclusion: str, groups: Sequence[Group]) -> Report:
    """The page of an identification experiment.

    Args:
        title: the heading of the page.
        setup: what was done.
        findings: what the thesis found, to compare with.
        conclusion: one paragraph from the figures.
        groups: the runs.
    """
    return page(
        title,
        setup,
        "## Outcome",
        _overview(groups),
        *_refusals(groups),
        conclusion,
        Picture(
            _chart(groups),
            "Errors of the identified parameters of the arm over repeated experiments, relative to the true "
            "values: mean (left) and standard deviation (right) of each parameter, one row for each group of "
            "runs; the lines are the Cramer-Rao bound for Gaussian noise.",
        ),
        "## What the thesis found",
        findings,
        "## Figures",
        "Errors are relative to the true value, in percent (of coefficients whose true value is 0: absolute, times "
        "100). The bound is the Cramer-Rao bound of the experiment for Gaussian noise of the same variance with the "
        "encoder offsets unknown: least squares cannot do better on average. Where the noise is visibly not "
        "Gaussian, the estimation uses that, and the ratio falls below 1.",
        *(part for group in groups for part in (f"### {group.label}", _parameters(group))),
    )


def _overview(groups: Sequence[Group]) -> str:
    header = ["", "runs", "converged", "same from a second start", "white residuals", "largest RMS error / bound"]
    rows = []
    for group in groups:
        outcomes = group.outcomes
        ratios = [ratio for name in group.truth if math.isfinite(ratio := group.ratio(name))]
        counts = (
            len(outcomes),
            sum(o.converged for o in outcomes),
            sum(o.second_converged for o in outcomes),
            sum(o.white for o in outcomes),
        )
        rows.append([group.label, *map(str, counts), f"{max(ratios):.2f}" if ratios else ""])
    return table(header, rows)


def _refusals(groups: Sequence[Group]) -> list[str]:
    """A list of the reasons for which there is no model; nothing when there are none."""
    reasons = sorted({outcome.reason for group in groups for outcome in group.outcomes if outcome.reason})
    return ["\n".join(f"- refused: {reason}" for reason in reasons)] if reasons else []


def _parameters(group: Group) -> str:
    header = [
        *("", "true value", "mean error %", "variance %^2", "RMS error %", "bound %", "RMS / bound"),
        "95 % interval holds",
    ]
    rows = []
    for name, truth in group.truth.items():
        errors = np.array([group.relative(name, error) for error in group.errors(name)]) * 100
        if not errors.size:
            continue
        bound = 100 * group.relative(name, group.bounds[name])
        rms = 100 * group.relative(name, group.root_mean_square(name))
        rows.append(
            [
                *(name, f"{truth:.6g}", f"{errors.mean():+.3g}", f"{errors.var():.3g}", f"{rms:.3g}", f"{bound:.3g}"),
                *(f"{group.ratio(name):.2f}", f"{100 * group.coverage(name):.0f} %"),
            ]
        )
    return table(header, rows)


def _chart(groups: Sequence[Group]) -> Figure:
    figure = new_figure(12, 2.6 * len(groups))
    rows = figure.subplots(len(groups), 2, squeeze=False)
    for (means, spreads), group in zip(rows, groups, strict=True):
        _bars(means, spreads, group)
    rows[0][0].set_title("mean error, %", fontsize=10)
    rows[0][1].set_title("standard deviation (bars) and bound (lines), %", fontsize=10)
    return figure


def _bars(means: Axes, spreads: Axes, group: Group) -> None:
    names = list(group.truth)
    position = np.arange(len(names))
    errors = [100 * np.array([group.relative(name, e) for e in group.errors(name)]) for name in names]
    if not errors[0].size:
        means.set_ylabel(f"{group.label}\nno model", fontsize=8)
        return
    means.bar(position, [e.mean() for e in errors], color=COLOURS[0])
    means.axhline(0, color=DARK, lw=0.8)
    means.set_ylabel(group.label, fontsize=8)
    spreads.bar(position, [e.std() for e in errors], color=COLOURS[2])
    bounds = [100 * group.relative(name, group.bounds[name]) for name in names]
    spreads.hlines(bounds, position - 0.4, position + 0.4, color=RED, lw=2)
    spreads.set_yscale("log")
    for axis in (means, spreads):
        axis.set_xticks(position, names, fontsize=8)
        axis.grid(alpha=0.3, axis="y")
