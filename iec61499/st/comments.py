"""Comments of Structured Text, which may be nested, and pragmas."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from iec61499.errors import FunctionBlockError
from iec61499.st import ast

_OPENING: Final = re.compile(r"""'(?:\$.|[^'$\n])*'|"(?:\$.|[^"$\n])*"|//[^\n]*|\(\*|/\*|\{""")
_VISIBLE: Final = re.compile(r"[^\n]")
_CLOSINGS: Final = {"(*": "*)", "/*": "*/", "{": "}"}


def comment_spans(text: str, origin: ast.Position) -> Iterator[tuple[int, int]]:
    """Where comments, which may be nested, and pragmas begin and end. Raises FunctionBlockError for an open one."""
    at = 0
    while (found := _OPENING.search(text, at)) is not None:
        mark, at = found[0], found.end()
        if mark in _CLOSINGS:
            at = _comment_end(text, found.start(), mark, origin)
        if mark in _CLOSINGS or mark.startswith("//"):
            yield found.start(), at


def without_comments(text: str, origin: ast.Position) -> str:
    """The text with blanks for comments and pragmas; every other character keeps its place."""
    parts: list[str] = []
    at = 0
    for start, end in comment_spans(text, origin):
        parts += [text[at:start], _VISIBLE.sub(" ", text[start:end])]
        at = end
    return "".join((*parts, text[at:]))


def _comment_end(text: str, start: int, mark: str, origin: ast.Position) -> int:
    closing = _CLOSINGS[mark]
    depth, at = 0, start
    for found in re.finditer(f"{re.escape(mark)}|{re.escape(closing)}", text[start:]):
        depth += 1 if found[0] == mark else -1
        if not depth:
            return start + found.end()
    line = text.count("\n", 0, at) + 1
    raise FunctionBlockError(
        f"comment is not closed: expected {closing}", *shifted(origin, line, at - text.rfind("\n", 0, at))
    )


def shifted(origin: ast.Position, line: int, column: int) -> ast.Position:
    """The position of a line and column of a text that begins at `origin`."""
    if line == 1:
        return ast.Position(origin.file, origin.line, origin.column + column - 1)
    return ast.Position(origin.file, origin.line + line - 1, column)
