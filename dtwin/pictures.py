"""Pictures for people: figures of Matplotlib, written as PNG, and the colours they share."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dtwin.files import PICTURE, replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS: Final = ("#4c72b0", "#dd8452", "#55a868", "#8172b3", "#937860", "#da8bc3", "#8c8c8c", "#ccb974", "#64b5cd")
"""of lines side by side, in this order"""
RED: Final = "#c44e52"
"""of what is old, wrong or a bound"""
DARK: Final = "#444444"
"""of what was measured, and of axes"""


def new_figure(width: float, height: float) -> Figure:
    """An empty figure whose parts make room for one another.

    Args:
        width, height: size, inches.
    """
    # Matplotlib takes half a second to load, and most commands draw nothing.
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def legend(axis: Axes) -> None:
    """Shows what the lines of a plot are, beside it on the right, where no line is covered."""
    axis.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, fontsize=8, frameon=False)


def save(figure: Figure, path: Path) -> None:
    """Writes a figure as PNG, whole or not at all, equal bytes for equal figures.

    Raises:
        RecordingError: the path cannot be written.
    """
    with replacing(path, PICTURE) as temporary:
        figure.savefig(temporary, format="png", dpi=110, metadata={"Software": None})


def vector_graphics(figure: Figure) -> str:
    """A figure as an SVG element for a page, equal text for equal figures; its letters are outlines."""
    from matplotlib import rc_context

    drawn = io.StringIO()
    with rc_context({"svg.hashsalt": "dtwin"}):
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = drawn.getvalue()
    return re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
