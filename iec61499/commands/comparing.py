"""`fb diff`, of files and projects, and `fb outline`: what files say, in lines that can be read and compared."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from iec61499.errors import ToolError
from iec61499.files.outline import SUFFIXES, difference, outline
from iec61499.output import printable


@dataclass(frozen=True)
class FbOutline:
    """Print what function-block files say: ports, blocks, connections, parameters, charts and code, no coordinates.

    It is the text view of git: `git config diff.fb.textconv "fb outline"`, and `*.fbt diff=fb` in .gitattributes.
    """

    files: tyro.conf.Positional[tuple[Path, ...]]
    """Types (.fbt, .fct, .sub, .adp, .dtp, .gcf) and systems (.sys)."""

    def execute(self) -> int:
        for file in self.files:
            for item in outline(file):
                for line in item.lines():
                    print(printable(line.replace("\t", "    ")))
        return 0


def compare(before: Path, after: Path) -> int:
    """Prints what differs between two files or two folders of them; gives how many files do.

    Raises:
        ToolError: one is a folder and the other is not, or a file cannot be read.
    """
    if before.is_dir() != after.is_dir():
        raise ToolError(f"{before} and {after}: expected two files or two folders")
    if not before.is_dir():
        return _compare_files(before, after, "")
    old, new = _files(before), _files(after)
    differ = 0
    for name in sorted({*old, *new}):
        if name not in new:
            print(printable(f"- file {name}"))
            differ += 1
        elif name not in old:
            print(printable(f"+ file {name}"))
            differ += 1
        elif old[name].read_bytes() != new[name].read_bytes():
            differ += _compare_files(old[name], new[name], name)
    return differ


def _compare_files(before: Path, after: Path, title: str) -> int:
    lines = difference(outline(before), outline(after))
    if lines and title:
        print(printable(f"file {title}"))
    for line in lines:
        print(printable(line.replace("\t", "    ")))
    return int(bool(lines))


def _files(folder: Path) -> dict[str, Path]:
    found = (file for file in folder.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file())
    return {file.relative_to(folder).as_posix(): file for file in found}
