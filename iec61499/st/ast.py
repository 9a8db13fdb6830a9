"""Syntax tree of Structured Text (IEC 61131-3, clause 7.3): what was written, before types are known.

Two trees are equal when they say the same; positions do not count.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple, NoReturn, TypeAlias

from iec61499.errors import FunctionBlockError


class Position(NamedTuple):
    """Where something was written; line and column count from 1, 0 when unknown."""

    file: str = ""
    line: int = 0
    column: int = 0

    def __str__(self) -> str:
        return ":".join(str(part) for part in self if part)


def fail(at: Position, message: str) -> NoReturn:
    """Raises FunctionBlockError at a position."""
    raise FunctionBlockError(message, *at)


@dataclass(frozen=True, slots=True)
class SyntaxNode:
    at: Position = field(compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Literal(SyntaxNode):
    """A constant; type_name is "" for the untyped `5`, `1.5` and `TRUE`, otherwise the elementary type's name.

    The value of an enumeration, `COLOUR#RED`, is its name; type_name is that of the enumeration.
    """

    value: bool | int | float | str
    type_name: str

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Literal):
            return NotImplemented
        # 1, 1.0 and TRUE are equal in Python and differ here
        return (repr(self.value), self.type_name) == (repr(other.value), other.type_name)

    def __hash__(self) -> int:
        return hash((repr(self.value), self.type_name))


@dataclass(frozen=True, slots=True)
class Member(SyntaxNode):
    """`.NAME` behind a variable: a member of a structure, or a variable of an adapter."""

    name: str


@dataclass(frozen=True, slots=True)
class Part(SyntaxNode):
    """`.%X3`, `.%B0`, ... behind a variable: the bit, byte, word or double word of that number in a bit string."""

    size: str
    number: int


@dataclass(frozen=True, slots=True)
class VariableAccess(SyntaxNode):
    """A variable or what is inside it: `X`, `A[I]`, `M[I, J]` (the same as `M[I][J]`), `S.MEMBER`, `W.%X3`."""

    name: str
    steps: tuple[Expression | Member | Part, ...] = ()


@dataclass(frozen=True, slots=True)
class Unary(SyntaxNode):
    """An operation on one operand; `operator` is `-`, `+` or `NOT`."""

    operator: str
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary(SyntaxNode):
    """An operation on two operands; `operator` is one of `** * / MOD + - < > <= >= = <> AND XOR OR`."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Call(SyntaxNode):
    """A function call; `function` is its name in upper case, `names` has "" for arguments without a name."""

    function: str
    arguments: tuple[Expression, ...]
    names: tuple[str, ...] = ()


Expression: TypeAlias = Literal | VariableAccess | Unary | Binary | Call


@dataclass(frozen=True, slots=True)
class Assignment(SyntaxNode):
    target: VariableAccess
    value: Expression


@dataclass(frozen=True, slots=True)
class Branch(SyntaxNode):
    """One branch of IF: `IF condition THEN body` or `ELSIF condition THEN body`."""

    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class If(SyntaxNode):
    branches: tuple[Branch, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Range(SyntaxNode):
    """`low..high` of a CASE label."""

    low: Expression
    high: Expression


@dataclass(frozen=True, slots=True)
class CaseBranch(SyntaxNode):
    labels: tuple[Expression | Range, ...]
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Case(SyntaxNode):
    selector: Expression
    branches: tuple[CaseBranch, ...]
    otherwise: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class For(SyntaxNode):
    """`FOR variable := start TO stop BY step DO body`; step is None when BY is absent."""

    variable: VariableAccess
    start: Expression
    stop: Expression
    step: Expression | None
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class While(SyntaxNode):
    condition: Expression
    body: tuple[Statement, ...]


@dataclass(frozen=True, slots=True)
class Repeat(SyntaxNode):
    body: tuple[Statement, ...]
    condition: Expression


@dataclass(frozen=True, slots=True)
class Exit(SyntaxNode):
    pass


@dataclass(frozen=True, slots=True)
class Continue(SyntaxNode):
    pass


@dataclass(frozen=True, slots=True)
class Return(SyntaxNode):
    pass


@dataclass(frozen=True, slots=True)
class Argument(SyntaxNode):
    """`NAME := value` of an invocation, or `NAME => value`, where the value is a variable that takes an output."""

    name: str
    value: Expression
    is_output: bool


@dataclass(frozen=True, slots=True)
class Invocation(SyntaxNode):
    """`BLOCK.EVENT(...);`, or `BLOCK(...);` for its first event: a block inside reacts to an event."""

    block: VariableAccess
    arguments: tuple[Argument, ...]


Statement: TypeAlias = Assignment | Invocation | If | Case | For | While | Repeat | Exit | Continue | Return


@dataclass(frozen=True, slots=True)
class TypeName(SyntaxNode):
    """An elementary type, or with bounds an array of it (one pair a dimension)."""

    name: str
    bounds: tuple[Range, ...] = ()


@dataclass(frozen=True, slots=True)
class Repeated(SyntaxNode):
    """`count(value)` in an array's initial value."""

    count: int
    value: Expression


@dataclass(frozen=True, slots=True)
class Elements(SyntaxNode):
    """The elements of an array's initial value, which may be lists themselves."""

    items: tuple[Expression | Repeated | Elements, ...]


@dataclass(frozen=True, slots=True)
class Declaration(SyntaxNode):
    """A temporary variable of an algorithm; initial is None when the text gives none."""

    name: str
    type_name: TypeName
    initial: Expression | Elements | None
    constant: bool


@dataclass(frozen=True, slots=True)
class ParsedAlgorithm(SyntaxNode):
    """An algorithm; its name is "" when the text has no `ALGORITHM name ... END_ALGORITHM` around it."""

    name: str
    declarations: tuple[Declaration, ...]
    body: tuple[Statement, ...]
