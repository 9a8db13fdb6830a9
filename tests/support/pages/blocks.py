"""What the pages of the documentation show in blocks and inside sentences: commands, programs, files, output."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from dataclasses import dataclass

from dtwin.commands.table import COMMANDS
from dtwin.parameters import ROOT

PAGES = ("README.md", "fb/README.md", "examples/README.md", *sorted(f"docs/{p.name}" for p in ROOT.glob("docs/*.md")))
_FENCE = re.compile(r"^( *)```(\S*)[^\n]*\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
_CODE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")


@dataclass(frozen=True, slots=True)
class Block:
    """A block between fences.

    Attributes:
        page: path of its page from the root of the checkout.
        line: number of its first line there.
        language: the word behind the fence.
        text: what it holds, without indentation.
    """

    page: str
    line: int
    language: str
    text: str

    def __str__(self) -> str:
        return f"{self.page}:{self.line}"

    @property
    def lines(self) -> list[str]:
        """Its lines that are neither empty nor a comment."""
        return [line for line in self.text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


def blocks() -> Iterator[Block]:
    """All blocks of all pages, in order."""
    for page in PAGES:
        text = (ROOT / page).read_text()
        for found in _FENCE.finditer(text):
            content = "\n".join(line.removeprefix(found[1]) for line in found[3].splitlines())
            yield Block(page, text.count("\n", 0, found.start()) + 2, found[2], content + "\n")


def fences() -> dict[str, int]:
    """The number of lines that begin or end a block, by page."""
    return {page: len(re.findall(r"^ *```", (ROOT / page).read_text(), re.MULTILINE)) for page in PAGES}


def spoken(page: str) -> list[str]:
    """What a page shows as code inside its sentences."""
    return _CODE.findall(_FENCE.sub("", (ROOT / page).read_text()))


def words_of(line: str) -> list[str]:
    """The words of a command, `dtwin` first where the line calls it by any of its names."""
    words = shlex.split(line, comments=True)
    return ["dtwin", *words[1:]] if words[0] in ("scripts/dtwin", "dtwin") else words


def command_of(words: list[str]) -> str:
    """The name of the command that words after `dtwin` begin with, "" for none."""
    return next((name for n in (2, 1) if (name := " ".join(words[:n])) in COMMANDS), "")
