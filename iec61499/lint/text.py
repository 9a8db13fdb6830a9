"""Rules for Structured Text."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, Final

from iec61499 import model
from iec61499.lint.findings import Finding
from iec61499.lint.usage import Usage, statements
from iec61499.st import ast, typed
from iec61499.types import ElementaryType

Place = Callable[[ast.Position], tuple[str, int, int]]
"""File, line and column of a position in a text."""
_ARITHMETIC: Final = ("+", "-", "*")


def placed(algorithm: model.Algorithm, file: str) -> Place:
    """Where positions of an algorithm are in its file: text in an attribute has all its lines in one."""
    source = algorithm.source

    def place(at: ast.Position) -> tuple[str, int, int]:
        return (file, source.line + at.line - 1, at.column) if source.exact else (file, source.line, 0)

    return place


def parsed_findings(tree: ast.ParsedAlgorithm, name: str, place: Place) -> Iterator[Finding]:
    """What the text of an algorithm alone tells; positions count from line 1."""
    usage = Usage()
    for statement in tree.body:
        usage.add(statement)
    for declaration in tree.declarations:
        if declaration.initial is not None and isinstance(declaration.initial, ast.SyntaxNode):
            usage.add(declaration.initial)
    for declaration in tree.declarations:
        if declaration.name.upper() not in usage.reads | usage.writes:
            message = f"{name}: temporary variable {declaration.name} is never used"
            yield Finding(*place(declaration.at), "unused-variable", message)
    for body in statements(tree.body):
        for number, statement in enumerate(body):
            if isinstance(statement, ast.Return | ast.Exit | ast.Continue) and number + 1 < len(body):
                message = f"{name}: statements behind {type(statement).__name__.upper()} are never executed"
                yield Finding(*place(body[number + 1].at), "unreachable-code", message)
                break
            if isinstance(statement, ast.Assignment) and statement.target == statement.value:
                message = f"{name}: {statement.target.name} is assigned to itself"
                yield Finding(*place(statement.at), "no-effect", message)


def checked_findings(body: typed.Body, name: str, place: Place) -> Iterator[Finding]:
    """What the types of a checked algorithm or condition tell."""
    for node in _nodes(body):
        match node:
            case typed.Case(_, _, branches):
                yield from _labels(node, branches, name, place)
            case typed.Convert(at, wide, typed.Binary(_, narrow, operator)) if operator in _ARITHMETIC:
                if narrow.kind in ("signed", "unsigned") and narrow.bits < wide.bits and wide.kind != "real":
                    message = f"{name}: {operator} is computed as {narrow} and widened to {wide} afterwards"
                    yield Finding(*place(at), "narrow-arithmetic", message)
            case typed.Binary(at, _, "=" | "<>" as operator, left, right) if _is_real(left) and not (
                isinstance(left, typed.Const) or isinstance(right, typed.Const)
            ):
                yield Finding(*place(at), "real-equality", f"{name}: real numbers compared by {operator}")


def _is_real(expression: typed.Expression) -> bool:
    return isinstance(expression.type, ElementaryType) and expression.type.kind == "real"


def _labels(case: typed.Case, branches: tuple[typed.CaseBranch, ...], name: str, place: Place) -> Iterator[Finding]:
    taken: list[tuple[int, int]] = []
    for branch in branches:
        for low, high in branch.labels:
            if any(low <= other_high and other_low <= high for other_low, other_high in taken):
                label = str(low) if low == high else f"{low}..{high}"
                message = f"{name}: label {label} of CASE is taken by an earlier one"
                yield Finding(*place(case.at), "duplicate-case-label", message)
            taken.append((low, high))


def _nodes(node: Any) -> Iterator[Any]:
    """All nodes of a checked tree."""
    if isinstance(node, tuple):
        for child in node:
            yield from _nodes(child)
    elif is_dataclass(node) and type(node).__module__ == typed.__name__:
        yield node
        for each in fields(node):
            if each.name not in ("at", "type"):
                yield from _nodes(getattr(node, each.name))
