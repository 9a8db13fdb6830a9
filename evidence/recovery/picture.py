"""The picture of a recovery: who did what, and how far the arm was from its path."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.pictures import COLOURS, RED, legend, new_figure, save
from evidence.recovery.demonstration import LIMIT
from evidence.recovery.outcome import Recovery, fault_text

_COLOURS: Final = {
    "cell": RED,
    "monitoring": COLOURS[1],
    "identification": COLOURS[3],
    "simulation": COLOURS[0],
}


def draw(run: Recovery, path: Path) -> None:
    """Draws the distance from the path around the fault, and who did what.

    Raises:
        RecordingError: the path cannot be written.
    """
    figure = new_figure(13, 9)
    above, below = figure.subplots(2, height_ratios=(1, 1.2), sharex=True)
    began = run.story.fault or 0.0
    time = run.log.columns["t"] - began
    shown = time > -LIMIT / 2
    away = np.abs(run.log.stack("target") - run.log.stack("theta"))
    for joint in range(3):
        distance = np.maximum(1e3 * away[shown, joint], 0.1)
        below.semilogy(time[shown], distance, color=COLOURS[joint], lw=1.0, label=f"joint {joint + 1}")
    for row, moment in enumerate(run.moments):
        since, colour = moment.time - began, _COLOURS.get(moment.who, COLOURS[2])
        text = textwrap.shorten(f"{moment.who}: {moment.text}", 95, placeholder=" ...")
        late = since > 0.3 * LIMIT
        above.plot(since, row, "o", color=colour)
        above.text(
            since + (-0.8 if late else 0.8), row, text, ha="right" if late else "left", va="center", fontsize=8
        )
        below.axvline(since, color=colour, ls="--", lw=1.0)
    above.invert_yaxis()
    above.set_yticks([])
    above.set_title(f"seed {run.seed}: {fault_text(run)}")
    below.set_xlabel("time since the fault, s")
    below.set_ylabel("distance from the path, mrad")
    legend(below)
    below.grid(alpha=0.3)
    save(figure, path)
