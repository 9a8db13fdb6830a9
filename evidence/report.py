"""Reports of experiments: one page in HTML with its figures in it, and the same words for a terminal."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from markdown_it import MarkdownIt

from dtwin import __version__
from dtwin.commissioning.html import document, paragraph, picture
from dtwin.errors import RecordingError
from dtwin.files import replacing
from dtwin.pictures import vector_graphics

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE: Final = "report.html"
_LIBRARIES: Final = ("numpy", "scipy", "numba", "mujoco", "matplotlib")


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A figure of a report.

    Attributes:
        figure: what is drawn.
        caption: what it shows; it stands alone, without the words around it.
    """

    figure: Figure
    caption: str


@dataclass(frozen=True, slots=True, eq=False)
class Report:
    """A page.

    Attributes:
        title: the heading of the page.
        parts: paragraphs, headings and tables, each as Markdown, and pictures, in the order of the page.
    """

    title: str
    parts: tuple[str | Picture, ...]

    @property
    def text(self) -> str:
        """The words of the page as Markdown, as a terminal can show them."""
        return "\n\n".join([f"# {self.title}", *(part for part in self.parts if isinstance(part, str))]) + "\n"

    def page(self, made: str) -> str:
        """The page as HTML, which loads nothing; equal text for equal reports.

        Args:
            made: what the report was made with: seeds and versions.
        """
        # Without HTML in it: what comes from elsewhere is shown, never obeyed.
        markdown = MarkdownIt("commonmark", {"html": False}).enable("table")
        parts = [
            markdown.render(part) if isinstance(part, str) else picture(vector_graphics(part.figure), part.caption)
            for part in self.parts
        ]
        return document(self.title, [*parts, paragraph(made)])

    def write(self, folder: Path, made: str) -> Path:
        """Writes the page into a folder, made if need be; returns its path.

        Raises:
            RecordingError: the folder cannot be written.
        """
        make_folder(folder)
        path = folder / PAGE
        with replacing(path) as temporary:
            temporary.write_text(self.page(made), encoding="utf-8")
        return path


def page(title: str, *parts: str | Picture) -> Report:
    """A report of these parts in this order."""
    return Report(title, parts)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as Markdown, with columns of numbers aligned at their right."""
    marks = ["---:" if _are_numbers([row[column] for row in rows]) else ":---" for column in range(len(header))]
    return "\n".join(f"| {' | '.join(line)} |" for line in [header, marks, *rows])


def _are_numbers(cells: Sequence[str]) -> bool:
    """Whether the cells begin with digits, but for those that say nothing."""
    said = [cell for cell in cells if cell not in ("", "-")]
    return bool(said) and all(re.match(r"[-+]?\d", cell) for cell in said)


def versions() -> str:
    """Versions of what numbers depend on."""
    libraries = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in _LIBRARIES)
    return f"dtwin {__version__}, Python {platform.python_version()}, {libraries}"


def make_folder(folder: Path) -> None:
    """Makes a folder and those above it where they are missing.

    Raises:
        RecordingError: it cannot be made.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be made: {error.strerror}") from None


def ensure_folder(folder: Path) -> None:
    """Checks that files can be made in a folder, or the folder itself, so that a long run does not fail at its end.

    Raises:
        RecordingError: what is there already is no folder, or is read-only.
    """
    there = next(path for path in (folder.absolute(), *folder.absolute().parents) if path.exists())
    if not there.is_dir():
        raise RecordingError(f"{folder}: expected a folder, {there} is a file")
    if not os.access(there, os.W_OK | os.X_OK):
        raise RecordingError(f"{folder}: cannot be written: {there} is read-only")
