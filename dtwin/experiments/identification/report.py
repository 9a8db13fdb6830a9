"""Report pages of the identification experiments: Markdown with tables, and bar charts as PNG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.errors import RecordingError
from dtwin.experiments.identification.experiments import Group
from dtwin.identification.plots import save
from dtwin.run.recording import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAGE: Final = "report.md"
CHART: Final = "errors.png"


@dataclass(frozen=True, slots=True)
class Page:
    """What a report says beside its figures.

    Attributes:
        title: of the page.
        setup: what was done.
        findings: of the thesis, to compare with.
        conclusion: one paragraph from the figures.
    """

    title: str
    setup: str
    findings: str
    conclusion: str


def write_report(page: Page, groups: Sequence[Group], folder: Path) -> Path:
    """Writes the page and its chart into a folder, made if need be; returns the page.

    Raises:
        RecordingError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be made: {error.strerror}") from None
    _chart(groups, folder / CHART)
    path = folder / PAGE
    with replacing(path) as temporary:
        temporary.write_text(text(page, groups), encoding="utf-8")
    return path


def text(page: Page, groups: Sequence[Group]) -> str:
    """The page as Markdown."""
    parts = [
        f"# {page.title}",
        page.setup,
        "## Outcome",
        _overview(groups),
        page.conclusion,
        f"![Mean error and standard deviation of every parameter]({CHART})",
        "## What the thesis found",
        page.findings,
        "## Figures",
        "Errors are relative to the true value, in percent (of coefficients whose true value is 0: absolute, times "
        "100). The bound is the Cramer-Rao bound of the experiment for Gaussian noise of the same variance with the "
        "encoder offsets unknown: least squares cannot do better on average. Where the noise is visibly not "
        "Gaussian, the estimation uses that, and the ratio falls below 1.",
        *(_table(group) for group in groups),
    ]
    return "\n\n".join(parts) + "\n"


def _overview(groups: Sequence[Group]) -> str:
    rows = ["| | runs | converged | same from a second start | white residuals | largest RMS error / bound |"]
    rows.append("|---|---|---|---|---|---|")
    for group in groups:
        outcomes = group.outcomes
        ratios = [ratio for name in group.truth if math.isfinite(ratio := _ratio(group, name))]
        worst = f"{max(ratios):.2f}" if ratios else ""
        rows.append(
            f"| {group.label} | {len(outcomes)} | {sum(o.converged for o in outcomes)} "
            f"| {sum(o.second_converged for o in outcomes)} | {sum(o.white for o in outcomes)} | {worst} |"
        )
    reasons = sorted({outcome.reason for group in groups for outcome in group.outcomes if outcome.reason})
    return "\n".join(rows + [""] * bool(reasons) + [f"- refused: {reason}" for reason in reasons])


def _table(group: Group) -> str:
    rows = [f"### {group.label}", ""]
    rows.append(
        "| | true value | mean error % | variance %^2 | RMS error % | bound % | RMS / bound | 95 % interval holds |"
    )
    rows.append("|---|---|---|---|---|---|---|---|")
    for name, truth in group.truth.items():
        errors = np.array([group.relative(name, error) for error in group.errors(name)]) * 100
        if not errors.size:
            continue
        bound = 100 * group.relative(name, group.bounds[name])
        rms = 100 * group.relative(name, group.root_mean_square(name))
        rows.append(
            f"| {name} | {truth:.6g} | {errors.mean():+.3g} | {errors.var():.3g} | {rms:.3g} | {bound:.3g} "
            f"| {_ratio(group, name):.2f} | {100 * group.coverage(name):.0f} % |"
        )
    return "\n".join(rows)


def _ratio(group: Group, name: str) -> float:
    bound = group.bounds[name]
    return group.root_mean_square(name) / bound if bound > 0 else math.nan


def _chart(groups: Sequence[Group], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 2.6 * len(groups)), layout="constrained")
    rows = figure.subplots(len(groups), 2, squeeze=False)
    for (means, spreads), group in zip(rows, groups, strict=True):
        _bars(means, spreads, group)
    rows[0][0].set_title("mean error, %", fontsize=10)
    rows[0][1].set_title("standard deviation (bars) and bound (lines), %", fontsize=10)
    save(figure, path)


def _bars(means: Axes, spreads: Axes, group: Group) -> None:
    names = list(group.truth)
    position = np.arange(len(names))
    errors = [100 * np.array([group.relative(name, e) for e in group.errors(name)]) for name in names]
    if not errors[0].size:
        means.set_ylabel(f"{group.label}\nno model", fontsize=8)
        return
    means.bar(position, [e.mean() for e in errors], color="#4c72b0")
    means.axhline(0, color="#444444", lw=0.8)
    means.set_ylabel(group.label, fontsize=8)
    spreads.bar(position, [e.std() for e in errors], color="#55a868")
    bounds = [100 * group.relative(name, group.bounds[name]) for name in names]
    spreads.hlines(bounds, position - 0.4, position + 0.4, color="#c44e52", lw=2)
    spreads.set_yscale("log")
    for axis in (means, spreads):
        axis.set_xticks(position, names, fontsize=8)
        axis.grid(alpha=0.3, axis="y")
