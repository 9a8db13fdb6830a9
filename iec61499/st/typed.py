"""The checked program: names resolved, every expression typed, every conversion explicit.

This is what the backends translate. Operands of a Binary have one common type, except `TIME * number`,
`TIME / number` and `**`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, Final, Literal, TypeAlias

from iec61499.st.ast import Position
from iec61499.types import Aggregate, DataType, ElementaryType

COMPARISONS: Final = frozenset({"<", ">", "<=", ">=", "=", "<>"})
"""Operators of a Binary that give BOOL, whatever the operands' type is."""
CastKind = Literal["to", "trunc", "s", "ms", "us", "ns", "to_bcd", "from_bcd"]


@dataclass(frozen=True, slots=True)
class Const:
    """A constant; an untyped one still takes the type its context asks for (only inside the checker)."""

    at: Position
    type: DataType
    value: Any
    untyped: bool = False


@dataclass(frozen=True, slots=True)
class Load:
    at: Position
    type: DataType
    name: str


@dataclass(frozen=True, slots=True)
class Element:
    """What is inside the array or structure `name`; `arrays` has the type that each index applies to.

    The index of a structure is the constant place of the member.
    """

    at: Position
    type: DataType
    name: str
    indices: tuple[Expression, ...]
    arrays: tuple[Aggregate, ...]


@dataclass(frozen=True, slots=True)
class Convert:
    """An implicit widening, which keeps the value."""

    at: Position
    type: ElementaryType
    operand: Expression


@dataclass(frozen=True, slots=True)
class Cast:
    """A conversion by function; `how` tells which.

    `to` and `trunc` are X_TO_Y and X_TRUNC_Y, `to_bcd` and `from_bcd` those of binary-coded decimals, a unit that of
    TIME_IN_<unit>_TO_Y.
    """

    at: Position
    type: ElementaryType
    operand: Expression
    how: CastKind


@dataclass(frozen=True, slots=True)
class Unary:
    """An operation on one operand; `operator` is `-` or `NOT`."""

    at: Position
    type: ElementaryType
    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary:
    at: Position
    type: ElementaryType
    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Call:
    """A function of the table in functions.py that is not an operator or conversion."""

    at: Position
    type: DataType
    function: str
    arguments: tuple[Expression, ...]


Expression: TypeAlias = Const | Load | Element | Convert | Cast | Unary | Binary | Call


@dataclass(frozen=True, slots=True)
class Store:
    """An assignment to a variable, or with indices to an element of an array; `type` is that of the target."""

    at: Position
    type: DataType
    name: str
    indices: tuple[Expression, ...]
    arrays: tuple[Aggregate, ...]
    value: Expression


@dataclass(frozen=True, slots=True)
class Branch:
    condition: Expression
    body: Body


@dataclass(frozen=True, slots=True)
class If:
    at: Position
    branches: tuple[Branch, ...]
    otherwise: Body


@dataclass(frozen=True, slots=True)
class CaseBranch:
    """One branch of CASE; its labels are pairs (low, high), both included."""

    labels: tuple[tuple[int, int], ...]
    body: Body


@dataclass(frozen=True, slots=True)
class Case:
    at: Position
    selector: Expression
    branches: tuple[CaseBranch, ...]
    otherwise: Body


@dataclass(frozen=True, slots=True)
class For:
    """Bounds and step are evaluated once; afterwards the variable holds the first value beyond the stop.

    `EXIT` leaves it as it is. Assigning it in the body is refused by the checker.
    """

    at: Position
    type: ElementaryType
    name: str
    start: Expression
    stop: Expression
    step: Expression
    body: Body


@dataclass(frozen=True, slots=True)
class While:
    at: Position
    condition: Expression
    body: Body


@dataclass(frozen=True, slots=True)
class Repeat:
    at: Position
    body: Body
    condition: Expression


@dataclass(frozen=True, slots=True)
class Exit:
    at: Position


@dataclass(frozen=True, slots=True)
class Continue:
    at: Position


@dataclass(frozen=True, slots=True)
class Return:
    at: Position


@dataclass(frozen=True, slots=True)
class Invoke:
    """The block inside this one called `name` reacts to an event.

    It reads and writes its own variables, which are variables of this block called `name.VARIABLE`; what it gets is
    stored to them before, what it gives is loaded from them afterwards.
    """

    at: Position
    name: str
    event: str


Statement: TypeAlias = Store | Invoke | If | Case | For | While | Repeat | Exit | Continue | Return
Body: TypeAlias = tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class CheckedAlgorithm:
    """What `check_algorithm` returns.

    Attributes:
        name: the algorithm's name, "" when the text had none.
        body: statements; the first ones initialise the temporaries that are read before they are assigned.
        variables: declared name and type of the block's variables that the body uses.
        temporaries: declared name and type of the algorithm's own variables.
    """

    name: str
    body: Body
    variables: Mapping[str, DataType]
    temporaries: Mapping[str, DataType]


def walk(node: Any) -> Iterator[Any]:
    """The node and everything below it, outermost first; of a tuple, that of all nodes in it."""
    pending = [node]
    while pending:
        node = pending.pop()
        if isinstance(node, tuple):
            pending.extend(reversed(node))
        else:
            yield node
            pending.extend(getattr(node, name) for name in _parts(node.__class__))


def invokes(body: Body) -> bool:
    """Whether blocks inside this one react to events on the way, which cannot be taken back."""
    return any(isinstance(node, Invoke) for node in walk(body))


@cache
def _parts(kind: type[Any]) -> tuple[str, ...]:
    """Names of the fields of a kind of node that hold nodes, the last first: those that are annotated so."""
    names = [field.name for field in fields(kind) if re.search(r"Expression|Body|Branch", str(field.type))]
    return tuple(reversed(names))


def continues(body: Body) -> bool:
    """Whether a CONTINUE of the loop with this body (not of a loop inside) is in it."""
    for node in body:
        match node:
            case Continue():
                return True
            case If(branches=branches, otherwise=otherwise):
                if any(continues(branch.body) for branch in branches) or continues(otherwise):
                    return True
            case Case(branches=cases, otherwise=otherwise):
                if any(continues(case.body) for case in cases) or continues(otherwise):
                    return True
    return False
