"""Picture of an optimisation: all candidates that keep the limits, and their Pareto fronts."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dtwin.pictures import COLOURS, DARK, legend, new_figure, save
from dtwin.simulation.optimise import Found, Scored

_LABELS: Final = {
    "time": "settling time, s",
    "tracking": "farthest from the path, rad",
    "energy": "energy a motion, J",
    "voltage": "peak voltage, V",
    "command": "largest command, parts of what a drive takes",
}


def draw_front(found: Found[Scored], path: Path) -> None:
    """Draws the settling time against the other terms, such as tracking, energy and peak voltage, as a PNG file.

    Raises:
        RecordingError: the path cannot be written.
    """
    figure = new_figure(15, 5)
    usable = [each for each in found.scores if not each.broken]
    figure.suptitle(f"{len(usable)} of {len(found.scores)} candidates keep all limits, in every scenario")
    first, *others = found.reference.terms
    for axis, second in zip(figure.subplots(1, len(others)), others, strict=True):
        points = [(each.terms[first], each.terms[second]) for each in usable]
        front = [(each.terms[first], each.terms[second]) for each in found.front(first, second)]
        if points:
            axis.scatter(*zip(*points, strict=True), s=10, color="#b0b8c4", label="candidates")
            axis.plot(*zip(*front, strict=True), "o-", ms=4, lw=1.2, color=COLOURS[0], label="Pareto front")
            best = found.best.terms
            axis.plot(best[first], best[second], "*", ms=14, color=COLOURS[1], label="least cost")
        reference = found.reference.terms
        axis.plot(reference[first], reference[second], "D", ms=7, color=DARK, label="in use")
        axis.set_xlabel(_LABELS[first])
        axis.set_ylabel(_LABELS[second])
        axis.grid(alpha=0.3)
        legend(axis)
    save(figure, path)
