"""Reports of experiments: a page of Markdown with its pictures in a folder."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dtwin.errors import RecordingError
from dtwin.files import replacing
from dtwin.pictures import save

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE: Final = "report.md"


@dataclass(frozen=True, slots=True, eq=False)
class Picture:
    """A picture of a report.

    Attributes:
        file: name of its PNG file in the folder of the report.
        caption: what it shows.
        figure: what is drawn.
    """

    file: str
    caption: str
    figure: Figure


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
        """The page as Markdown."""
        parts = (part if isinstance(part, str) else f"![{part.caption}]({part.file})" for part in self.parts)
        return "\n\n".join([f"# {self.title}", *parts]) + "\n"

    @property
    def words(self) -> Report:
        """The same page without its pictures, as a terminal can show it."""
        return Report(self.title, tuple(part for part in self.parts if isinstance(part, str)))

    def write(self, folder: Path) -> Path:
        """Writes the pictures and then the page into a folder, made if need be; returns the path of the page.

        Raises:
            RecordingError: the folder cannot be written.
        """
        make_folder(folder)
        for part in self.parts:
            if isinstance(part, Picture):
                save(part.figure, folder / part.file)
        path = folder / PAGE
        with replacing(path) as temporary:
            temporary.write_text(self.text, encoding="utf-8")
        return path


def page(title: str, *parts: str | Picture) -> Report:
    """A report of these parts in this order."""
    return Report(title, parts)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


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
