"""Makes all parts, keeps what is done, and writes one page in HTML and the same in PDF."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec
import tyro
from rich.console import Console

from dtwin import __version__
from dtwin.campaign.spread import Progress
from dtwin.commands.frame import JsonOption, WorkforceOption, at_least, progress_bar
from dtwin.commissioning.html import document, heading, paragraph, picture, table
from dtwin.controller.runtime import RuntimeOption
from dtwin.files import replacing
from dtwin.pictures import new_figure, vector_graphics
from dtwin.terminal import print_json
from evidence.report import ensure_folder, make_folder, versions
from evidence.reproduce.chapter import Chapter, Part, Scope
from evidence.reproduce.fits import FITS
from evidence.reproduce.motions import ACCURACY, UPLOAD
from evidence.reproduce.parameters import FRICTION, MASS, NOISE
from evidence.reproduce.verification import VERIFICATION
from evidence.reproduce.watching import FAILURE, LIMITS

PARTS: Final = (VERIFICATION, NOISE, MASS, FRICTION, FITS, ACCURACY, UPLOAD, LIMITS, FAILURE)
"""The thesis's tests in its order."""
THESIS: Final = (
    "J. Lesage, Digital Twins for Distributed Control Systems in IEC 61499, thesis (its text gives no year)"
)
"""What is measured again: author and title, and why there is no year."""
PAGE: Final = "reproduction.html"
PRINT: Final = "reproduction.pdf"
NUMBERS: Final = "numbers"
"""Folder of the numbers of every part; those that depend on the machine are in files of their own."""
_WIDTH: Final = 118


def make(
    folder: Path,
    scope: Scope,
    parts: Sequence[Part] = PARTS,
    begin: Callable[[Part, bool], Progress] = lambda part, done: lambda done, of: None,
) -> dict[str, dict[str, Any]]:
    """Measures every part that the folder does not hold yet for the same scope, and keeps its numbers there.

    Args:
        folder: where they are kept; made if need be.
        scope: how much is measured.
        parts: what is measured.
        begin: told every part, and whether its numbers are there already; gives what is told its progress.

    Returns:
        The numbers by the names of the parts.

    Raises:
        RecordingError: the folder cannot be written.
        DtwinError: a test cannot be made.
    """
    make_folder(folder / NUMBERS)
    found = {}
    for part in parts:
        kept = _kept(folder, part, scope)
        progress = begin(part, kept is not None)
        found[part.name] = kept or _keep(folder, part, scope, part.measure(scope, progress))
    return found


def write(folder: Path, scope: Scope, numbers: Mapping[str, dict[str, Any]], parts: Sequence[Part] = PARTS) -> Path:
    """Writes the page and its print; returns the path of the page.

    Raises:
        RecordingError: the folder cannot be written.
    """
    chapters = [(part, part.tell(numbers[part.name])) for part in parts]
    made = _made(scope)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(_html(chapters, made), encoding="utf-8")
    with replacing(folder / PRINT) as temporary:
        _print(temporary, chapters, made)
    return folder / PAGE


def _files(folder: Path, part: Part) -> tuple[Path, Path]:
    """Where the numbers of a part are kept, and those that depend on the machine."""
    return folder / NUMBERS / f"{part.name}.json", folder / NUMBERS / f"{part.name}.machine.json"


def _key(scope: Scope) -> dict[str, Any]:
    return {"version": __version__, "quick": scope.quick, "seed": scope.seed}


def _kept(folder: Path, part: Part, scope: Scope) -> dict[str, Any] | None:
    """What is kept of a part that was made in the same scope; None for nothing."""
    found: dict[str, Any] = {}
    for path in _files(folder, part)[: 2 if part.machine else 1]:
        try:
            content = msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
        except (OSError, msgspec.MsgspecError):
            return None
        if content.get("key") != _key(scope):
            return None
        found |= content["numbers"]
    return found


def _keep(folder: Path, part: Part, scope: Scope, numbers: dict[str, Any]) -> dict[str, Any]:
    same = {name: value for name, value in numbers.items() if name not in part.machine}
    of_machine = {name: numbers[name] for name in part.machine}
    # The machine's numbers first, as the others tell that the part is done.
    for path, content in reversed(list(zip(_files(folder, part), (same, of_machine), strict=True))):
        if content:
            with replacing(path) as temporary:
                temporary.write_bytes(
                    msgspec.json.format(msgspec.json.encode({"key": _key(scope), "numbers": content}))
                )
    return msgspec.json.decode(msgspec.json.encode(numbers), type=dict[str, Any])


def _made(scope: Scope) -> str:
    runs = (
        "few runs (--quick): shares and largest errors are rough"
        if scope.quick
        else "as many runs as the thesis, or more"
    )
    return (
        f"The evaluation of {THESIS}. "
        f"Of its curves only numbers are known, which stand beside ours. Made with {runs}. "
        f"Seed {scope.seed}; equal seeds give equal numbers, but for times that are said to be "
        f"this machine's. {versions()}. Numbers are in the "
        f"folder {NUMBERS} beside this page."
    )


def _html(chapters: Sequence[tuple[Part, Chapter]], made: str) -> str:
    parts = [paragraph(made)]
    for part, chapter in chapters:
        rows = [[line.figure, line.what, line.thesis, line.ours] for line in chapter.lines]
        parts += [
            heading(part.title),
            paragraph(chapter.test),
            table(["figure", "what", "thesis", "here"], rows, "words"),
            paragraph(f"What differs, and why: {chapter.differs}"),
            paragraph(f"What is added: {chapter.adds}"),
            *(picture(vector_graphics(drawing.figure), drawing.caption) for drawing in chapter.drawings),
        ]
    return document("The thesis's evaluation, measured again", parts)


def _print(path: Path, chapters: Sequence[tuple[Part, Chapter]], made: str) -> None:
    """The same as pages of text and pictures; equal bytes for equal chapters."""
    from matplotlib.backends.backend_pdf import PdfPages

    with PdfPages(path, metadata={"CreationDate": None, "Producer": None, "Creator": None}) as pages:
        pages.savefig(_text("The thesis's evaluation, measured again", [made]))
        for part, chapter in chapters:
            told = [
                f"{line.figure}  {line.what}\n      thesis: {line.thesis}\n      here: {line.ours}"
                for line in chapter.lines
            ]
            words = [
                chapter.test,
                *told,
                f"What differs, and why: {chapter.differs}",
                f"What is added: {chapter.adds}",
            ]
            pages.savefig(_text(part.title, words))
            for drawing in chapter.drawings:
                # A caption of the figure itself: the print has no text around it.
                drawing.figure.suptitle("\n".join(textwrap.wrap(drawing.caption, 130)), fontsize=8)
                pages.savefig(drawing.figure)


def _text(title: str, paragraphs: Sequence[str]) -> Any:
    """A page of text on upright A4."""
    lines = []
    for words in paragraphs:
        for line in words.splitlines():
            lines += textwrap.wrap(line, _WIDTH, subsequent_indent="      " if line.startswith(" ") else "")
        lines.append("")
    figure = new_figure(8.27, 11.69)
    figure.text(0.07, 0.96, title, fontsize=13, weight="bold", va="top")
    figure.text(0.07, 0.93, "\n".join(lines), fontsize=6.5, va="top", family="monospace")
    return figure


@dataclass(frozen=True)
class Reproduce(JsonOption, RuntimeOption, WorkforceOption):
    """Measure the thesis's whole evaluation again: its tests, figures and numbers beside ours, in one page.

    What a folder holds already is not measured again, so that a reproduction goes on where it was interrupted.
    """

    out: Annotated[Path, tyro.conf.Positional] = Path("reproduction")
    """Folder for reproduction.html, reproduction.pdf and the numbers."""
    quick: bool = False
    """Few runs of each test: minutes in place of three quarters of an hour."""
    seed: int = 0
    """Number of the first random generators; equal numbers give equal figures."""

    def execute(self) -> int:
        at_least("--seed", self.seed, 0)
        scope = Scope(self.quick, self.seed, self.workforce())
        ensure_folder(self.out)
        began = time.perf_counter()
        with _teller() as begin:
            numbers = make(self.out, scope, begin=begin)
        page = write(self.out, scope, numbers)
        seconds = time.perf_counter() - began
        if self.json:
            print_json({"page": str(page), "seconds": seconds})
        else:
            print(f"{seconds:.0f} s; page {page}, print {page.with_suffix('.pdf')}")
        return 0


class _Teller:
    """Says which part is made, with a bar where there is a terminal."""

    def __init__(self, progress: Progress) -> None:
        self._progress = progress
        self._console = Console(stderr=True)
        self._number = 0

    def __call__(self, part: Part, done: bool) -> Progress:
        self._number += 1
        kept = ": kept from before" if done else ""
        self._console.print(f"{self._number} of {len(PARTS)}  {part.title}{kept}", highlight=False, soft_wrap=True)
        return self._progress


@contextmanager
def _teller() -> Iterator[_Teller]:
    with progress_bar("reproduce") as progress:
        yield _Teller(progress)
