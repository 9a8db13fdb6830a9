"""`fb format`: the Structured Text of types in one layout."""

from __future__ import annotations

import difflib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import tyro

from iec61499.errors import FunctionBlockError, ToolError
from iec61499.files.layout import formatted
from iec61499.files.rewriting import rewrite
from iec61499.output import printable, write_whole

SUFFIXES: Final = (".fbt", ".fct")
WIDEST: Final = 16
"""Most blanks of one level of indentation."""


@dataclass(frozen=True)
class FbFormat:
    """Lay out the Structured Text inside block types: indents, spaces, capitals, one statement a line.

    Comments and breaks inside statements stay where they are, and every other byte of the file. What a text says is
    the same before and after; one that is wrong is left as it is, and told. Formatting again changes nothing.
    """

    files: tyro.conf.Positional[tuple[Path, ...]] = (Path(),)
    """Types (.fbt, .fct), or folders of them."""
    check: bool = False
    """Change nothing; the exit status is 1 if a file would change."""
    diff: bool = False
    """Change nothing; print what would change."""
    indent: int = 0
    """Blanks of one level of indentation; 0 takes a tab."""

    def execute(self) -> int:
        if not 0 <= self.indent <= WIDEST:
            raise ToolError(f"--indent: expected 0 to {WIDEST}, got {self.indent}")
        files = [file for path in self.files for file in _files(path)]
        changed, problems = 0, 0
        for file in files:
            left: list[FunctionBlockError] = []
            try:
                before = file.read_bytes()
                after = self._formatted(before, file, left)
            except OSError as error:
                raise ToolError(f"{file}: cannot be read: {error.strerror}") from None
            except FunctionBlockError as error:
                left.append(error)
                after = before
            problems += len(left)
            for problem in left:
                print(printable(f"left as it is: {problem}"))
            if after != before:
                changed += 1
                self._tell(file, before, after)
        would = "would change" if self.check or self.diff else "changed"
        print(f"files: {len(files)}, {would}: {changed}, left as they are: {problems}")
        return int((self.check or self.diff) and changed > 0)

    def _formatted(self, data: bytes, file: Path, left: list[FunctionBlockError]) -> bytes:
        indent = " " * self.indent or "\t"

        def change(text: str, line: int) -> str:
            try:
                return formatted(text, indent)
            except FunctionBlockError as error:
                left.append(FunctionBlockError(error.message, str(file), line + max(error.line - 1, 0), error.column))
                return text

        return rewrite(data, change, str(file))

    def _tell(self, file: Path, before: bytes, after: bytes) -> None:
        if self.diff:
            old, new = (data.decode(errors="replace").splitlines() for data in (before, after))
            for line in difflib.unified_diff(old, new, str(file), str(file), lineterm=""):
                print(printable(line.replace("\t", "    ")))
            return
        if not self.check:
            write_whole(file, after)
        print(printable(str(file)))


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    return sorted(file for file in path.rglob("*") if file.suffix.lower() in SUFFIXES and file.is_file())
