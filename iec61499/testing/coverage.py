"""Which transitions and lines of blocks the tests have executed.

A block that is measured gets one hidden variable more, an array with an element for every statement and transition.
A statement is preceded by an assignment to its element, in the same line. A transition leads through a state of its
own, which sets its element and is left at once. So every runtime measures, and computes what it would compute.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Protocol

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.st import ast
from iec61499.st.parser import parse_algorithm
from iec61499.types import BOOL, ArrayType

COVERED: Final = "COVERED__"
"""The hidden variable; no identifier of a file has two underscores in a row."""


@dataclass(frozen=True)
class Point:
    """A statement or transition.

    Attributes:
        what: `line` or `transition`.
        name: the algorithm of a line; source, condition and destination of a transition.
        line: where it is in the file; for text in an attribute, of which only the first line is known, the line
            within the algorithm.
        destination: the state that a transition leads to.
    """

    what: str
    name: str
    line: int
    destination: str = ""


@dataclass
class Measured:
    """What was executed of a type.

    Attributes:
        block: the type as its file says.
        points: its statements and transitions.
        hits: for each of them whether a test has executed it.
    """

    block: model.BasicFBType | model.SimpleFBType
    points: tuple[Point, ...]
    hits: list[bool] = field(default_factory=list)

    def add(self, executed: Iterable[bool]) -> None:
        """Adds what one instance has executed."""
        before = self.hits or [False] * len(self.points)
        self.hits = [old or new for old, new in zip(before, executed, strict=True)]

    def of(self, what: str) -> dict[str, bool]:
        """Whether each state, transition or line was executed, by a text that names it."""
        hits = self.hits or [False] * len(self.points)
        pairs = list(zip(self.points, hits, strict=True))
        if what == "state":
            entered = {point.destination for point, hit in pairs if hit}
            states = self.block.states if isinstance(self.block, model.BasicFBType) else ()
            return {
                f"{state.line}: {state.name}": bool(self.hits and not number) or state.name in entered
                for number, state in enumerate(states)
            }
        found: dict[str, bool] = {}
        for point, hit in pairs:
            if point.what == what:
                name = f"{point.line}: {point.name}"
                found[name] = found.get(name, False) or hit
        return found


class Executed(Protocol):
    """A resource that has run."""

    def names(self) -> tuple[str, ...]: ...
    def block_type(self, name: str) -> model.FBType: ...
    def read(self, name: str) -> Any: ...


class CoveredLibrary(Library):
    """A library whose basic and simple types from files are measured.

    Attributes:
        measured: the types that were used, by their names.
    """

    def __init__(self, paths: Iterable[Path]) -> None:
        super().__init__(tuple(paths))
        self.measured: dict[str, Measured] = {}
        self._instrumented: dict[str, model.LibraryElement] = {}

    def find(self, name: str, file: str = "", line: int = 0) -> model.LibraryElement:
        found = super().find(name, file, line)
        if not isinstance(found, model.BasicFBType | model.SimpleFBType) or not found.header.file:
            return found
        known = found.header.name
        if known not in self._instrumented:
            self._instrumented[known], points = instrumented(found)
            self.measured[known] = Measured(found, points)
        return self._instrumented[known]

    def collect(self, resource: Executed) -> None:
        """Takes over what the blocks of a resource have executed."""
        for name in resource.names():
            measured = self.measured.get(resource.block_type(name).header.name)
            if measured is not None and measured.points:
                measured.add(resource.read(f"{name}.{COVERED}"))


def instrumented(
    block: model.BasicFBType | model.SimpleFBType,
) -> tuple[model.BasicFBType | model.SimpleFBType, tuple[Point, ...]]:
    """The type with the hidden variable, and what its elements stand for."""
    points: list[Point] = []
    algorithms = tuple(_algorithm(algorithm, block.header.file, points) for algorithm in block.algorithms)
    changed = replace(block, algorithms=algorithms)
    if isinstance(changed, model.BasicFBType):
        changed = _with_transitions(changed, points)
    if not points:
        return block, ()
    hidden = model.Variable(COVERED, ArrayType(BOOL, 0, len(points) - 1))
    return replace(changed, internals=(*changed.internals, hidden)), tuple(points)


def _algorithm(algorithm: model.Algorithm, file: str, points: list[Point]) -> model.Algorithm:
    source = algorithm.source
    try:
        body = parse_algorithm(source.text, file, 1, 1).body
    except FunctionBlockError:
        return algorithm  # the runtime says what is wrong
    lines = source.text.split("\n")
    first = source.line if source.exact else 1
    places = sorted({(at.line, at.column) for at in _statements(body)})
    marks = {}
    for line, column in places:
        marks[line, column] = len(points)
        points.append(Point("line", algorithm.name, first + line - 1))
    for (line, column), number in reversed(marks.items()):
        text = lines[line - 1]
        lines[line - 1] = f"{text[: column - 1]}{COVERED}[{number}] := TRUE; {text[column - 1 :]}"
    return replace(algorithm, source=replace(source, text="\n".join(lines)))


def _statements(body: tuple[ast.Statement, ...]) -> Iterator[ast.Position]:
    for statement in body:
        yield statement.at
        match statement:
            case ast.If(_, branches, otherwise) | ast.Case(_, _, branches, otherwise):
                for branch in branches:
                    yield from _statements(branch.body)
                yield from _statements(otherwise)
            case ast.For() | ast.While() | ast.Repeat():
                yield from _statements(statement.body)


def _with_transitions(block: model.BasicFBType, points: list[Point]) -> model.BasicFBType:
    states, algorithms, transitions = list(block.states), list(block.algorithms), []
    for transition in block.transitions:
        name = f"COVER__{len(points)}"
        condition = transition.event + (f"[{transition.guard}]" if transition.guard else "") or "1"
        title = f"{transition.source} -> {transition.destination} by {condition}"
        algorithms.append(model.Algorithm(name, model.Source(f"{COVERED}[{len(points)}] := TRUE;")))
        points.append(Point("transition", title, transition.line, transition.destination))
        states.append(model.ECState(name, (model.ECAction(name),)))
        transitions += [replace(transition, destination=name), model.ECTransition(name, transition.destination)]
    return replace(block, states=tuple(states), algorithms=tuple(algorithms), transitions=tuple(transitions))
