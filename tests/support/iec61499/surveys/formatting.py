"""What `fb format` makes of the types of foreign projects: texts that parse to the same, and stay so then."""

from __future__ import annotations

import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import tyro

from iec61499.errors import FunctionBlockError
from iec61499.files.layout import formatted
from iec61499.files.rewriting import rewrite
from iec61499.files.xml import parse_xml
from iec61499.st.parser import parse_algorithm
from tests.support.iec61499.drawn_findings import types


@dataclass(frozen=True)
class Options:
    """Lay out the Structured Text of all types below folders, each type once, and count what came of them."""

    folders: tyro.conf.Positional[tuple[Path, ...]]
    """Folders with projects of 4diac IDE."""


def texts(data: bytes) -> list[str]:
    """The Structured Text in a file. Raises FunctionBlockError for a file that is no XML."""
    found = []

    def keep(text: str, line: int) -> str:
        found.append(text)
        return text

    rewrite(data, keep)
    return found


def laid_out(data: bytes) -> tuple[bytes, int]:
    """The file as it is laid out, and how many texts were left as they are."""
    left = 0

    def change(text: str, line: int) -> str:
        nonlocal left
        try:
            return formatted(text)
        except FunctionBlockError:
            left += 1
            return text

    return rewrite(data, change), left


def outcome(data: bytes) -> Counter[str]:
    """What came of one file. Raises FunctionBlockError for one that is no XML."""
    after, left = laid_out(data)
    counts = Counter({"types": 1, "changed": int(after != data), "texts left as they are": left})
    parse_xml(after, "")
    for before, now in zip(texts(data), texts(after), strict=True):
        counts["texts"] += 1
        if before != now:
            counts["texts changed"] += 1
            counts["texts that parse to something else"] += parse_algorithm(before) != parse_algorithm(now)
    counts["types that a second pass changes"] += laid_out(after)[0] != after
    return counts


def main() -> int:
    """Prints the counts; the exit status is 1 if a text means something else, or a second pass changes one."""
    options = tyro.cli(Options)
    total: Counter[str] = Counter()
    for file in types(options.folders):
        try:
            total += outcome(file.read_bytes())
        except FunctionBlockError:
            total["no XML"] += 1
    print(", ".join(f"{name}: {count}" for name, count in total.items()))
    wrong = total["texts that parse to something else"] + total["types that a second pass changes"]
    print(f"wrong: {wrong}")
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
