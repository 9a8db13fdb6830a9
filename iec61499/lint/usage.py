"""Which variables Structured Text reads and writes, by the names that it writes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields

from iec61499.st import ast


@dataclass
class Usage:
    """Names in upper case; what is inside an adapter or a block inside counts as `NAME.PORT` and as NAME."""

    reads: set[str] = field(default_factory=set)
    writes: set[str] = field(default_factory=set)

    def add(self, node: ast.SyntaxNode) -> None:
        """Adds what a statement or an expression reads and writes."""
        match node:
            case ast.Assignment(_, target, value):
                self._write(target)
                self.add(value)
            case ast.For(_, variable):
                self._write(variable)
                self._all(node, skipped=("variable",))
                self.reads |= _names(variable)
            case ast.Argument(_, _, value, is_output):
                if is_output and isinstance(value, ast.VariableAccess):
                    self._write(value)
                else:
                    self.add(value)
                    if isinstance(value, ast.VariableAccess):
                        self.writes |= _names(value)  # it may be a VAR_IN_OUT
            case ast.VariableAccess():
                self.reads |= _names(node)
                self._all(node)
            case ast.Literal(_, value, type_name) if isinstance(value, str) and type_name:
                pass
            case _:
                self._all(node)

    def _write(self, target: ast.VariableAccess) -> None:
        self.writes |= _names(target)
        if any(isinstance(step, ast.Part) for step in target.steps):
            self.reads |= _names(target)
        for step in target.steps:
            if not isinstance(step, ast.Member | ast.Part):
                self.add(step)

    def _all(self, node: ast.SyntaxNode, skipped: tuple[str, ...] = ()) -> None:
        for name in (each.name for each in fields(node) if each.name not in ("at", *skipped)):
            value = getattr(node, name)
            for child in value if isinstance(value, tuple) else (value,):
                if isinstance(child, ast.SyntaxNode):
                    self.add(child)


def _names(access: ast.VariableAccess) -> set[str]:
    names, path = {access.name.upper()}, access.name.upper()
    for step in access.steps:
        if not isinstance(step, ast.Member):
            break
        path = f"{path}.{step.name.upper()}"
        names.add(path)
    return names


def statements(body: tuple[ast.Statement, ...]) -> Iterator[tuple[ast.Statement, ...]]:
    """The body and all bodies inside it."""
    yield body
    for statement in body:
        match statement:
            case ast.If(_, branches, otherwise) | ast.Case(_, _, branches, otherwise):
                for branch in branches:
                    yield from statements(branch.body)
                yield from statements(otherwise)
            case ast.For() | ast.While() | ast.Repeat():
                yield from statements(statement.body)
