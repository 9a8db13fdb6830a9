"""An identification as a Rerun recording: measured motion, predictions of two models, intervals, correlation."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from dtwin.parameters import unit_of
from dtwin.view.layout import plot_view
from dtwin.view.saving import saving
from dtwin.view.series import TIMELINE, send_lines, stream_of

Array = NDArray[np.float64]

_CELL: Final = 12
"""Width of the square of one correlation coefficient, pixels."""
_STYLES: Final = {
    "measured": ((150, 150, 150), 1.2),
    "before": ((220, 90, 90), 1.5),
    "identified": ((80, 150, 240), 4.5),
}
"""Colours and widths of the lines; the measured motion is drawn last, on top of that of the identified model."""


def write_identification(
    path: Path,
    period: float,
    motions: Mapping[str, Array],
    rows: Sequence[tuple[str, float, float]],
    names: Sequence[str],
    correlation: Array,
) -> None:
    """Writes an .rrd file with a prepared layout; the file appears complete or not at all.

    Args:
        path: path of the file.
        period: time between samples, s.
        motions: angles (N, 3) in rad by name: "measured", and those predicted by the model "before" and by the
            "identified" one.
        rows: name, estimate and half width of the 95 % interval of each parameter, SI units.
        names: names of the rows of the correlation matrix.
        correlation: (n, n), correlation matrix; NaN is drawn white.

    Raises:
        RecordingError: the path cannot be written.
    """
    stream = stream_of(b"", motions.values(), "dtwin identification")
    with saving(stream, path, _layout(motions["measured"])):
        for name, angles in motions.items():
            time = rr.TimeColumn(TIMELINE, duration=np.arange(len(angles)) * period)
            for joint in (1, 2, 3):
                colour, width = _STYLES[name]
                entity = f"motion/joint_{joint}/{name}"
                send_lines(stream, time, entity, [name], [colour], width, angles[:, joint - 1])
        lines = [f"| {name} | {value:.6g} | +- {half:.2g} | {unit_of(name)} |" for name, value, half in rows]
        table = "\n".join(["| | estimate | 95 % interval | unit |", "|---|---|---|---|", *lines])
        stream.log("parameters", rr.TextDocument(table, media_type=rr.MediaType.MARKDOWN), static=True)
        stream.log("correlation", rr.Image(_heat(correlation)), static=True)
        stream.log("correlation_order", rr.TextDocument(", ".join(names)), static=True)


def _layout(measured: Array) -> rrb.Blueprint:
    """Axes hold the measured motion, in whole numbers; what a bad model predicts beyond them is cut."""
    shown = math.floor(measured.min()), math.ceil(measured.max())
    motions = [plot_view(f"Joint {j}: held-out motion (rad)", f"motion/joint_{j}", shown) for j in (1, 2, 3)]
    facts = [
        rrb.TextDocumentView(origin="parameters", name="Parameters"),
        rrb.Spatial2DView(origin="correlation", name="Correlation: red +1, blue -1"),
        rrb.TextDocumentView(origin="correlation_order", name="Its rows, from the top"),
    ]
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(*motions), rrb.Vertical(*facts, row_shares=[4, 3, 1]), column_shares=[3, 2]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE),
    )


def _heat(correlation: Array) -> NDArray[np.uint8]:
    """Pixels of a correlation matrix: white at 0 and for NaN, red towards +1, blue towards -1."""
    value = np.nan_to_num(correlation)
    fade = 1.0 - np.abs(value)
    red, blue = np.where(value < 0, fade, 1.0), np.where(value > 0, fade, 1.0)
    pixels = (255 * np.stack([red, fade, blue], axis=-1)).astype(np.uint8)
    return pixels.repeat(_CELL, axis=0).repeat(_CELL, axis=1)
