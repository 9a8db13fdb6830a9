"""The names that Structured Text may use: variables, constants, and the places inside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from iec61499.errors import choices
from iec61499.st import ast, typed
from iec61499.st.ast import fail
from iec61499.types import DINT, ELEMENTARY, Aggregate, ArrayType, DataType, ElementaryType, StructType

_PARTS: Final = {"X": "BOOL", "B": "BYTE", "W": "WORD", "D": "DWORD"}


@dataclass(frozen=True, slots=True)
class Place:
    """Where a value is: a variable, an element or member of it, or a part of a bit string.

    Attributes:
        name: the variable, as declared.
        type: the type of the value, or of the bit string that it is a part of.
        indices: the indices, and places of members, on the way.
        aggregates: the array or structure that each of them applies to.
        part: the type of the part, None for the whole value.
        offset: the number of the part's lowest bit.
        character: for a part that is a character of a text its place, counted from 1.
    """

    name: str
    type: DataType
    indices: tuple[typed.Expression, ...] = ()
    aggregates: tuple[Aggregate, ...] = ()
    part: ElementaryType | None = None
    offset: int = 0
    character: typed.Expression | None = None

    def load(self, at: ast.Position) -> typed.Expression:
        """The value, without regard to the part."""
        if self.indices:
            return typed.Element(at, self.type, self.name, self.indices, self.aggregates)
        return typed.Load(at, self.type, self.name)


@dataclass(frozen=True, slots=True)
class InnerBlock:
    """A block inside the one whose text is checked; its variables are in the scope as `NAME.VARIABLE`.

    Attributes:
        name: its name, as declared.
        events: its event inputs; the first one is that of an invocation without a name.
        inputs, outputs: its data ports; what is both is a VAR_IN_OUT.
    """

    name: str
    events: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]


class Scope:
    """Variables and constants by name; names compare without case, as in the standard.

    Args:
        variables: the type of every variable, by its name as declared. Those of adapters are called `ADAPTER.NAME`,
            and those of blocks inside this one `BLOCK.NAME`.
        constants: type and value of what cannot be assigned and is known, by name.
        blocks: the blocks inside this one.
        absent: why there is no constant of a name.
    """

    def __init__(
        self,
        variables: Mapping[str, DataType],
        constants: Mapping[str, tuple[DataType, Any]] | None = None,
        blocks: Sequence[InnerBlock] = (),
        absent: Mapping[str, str] | None = None,
    ) -> None:
        self.blocks = {block.name.upper(): block for block in blocks}
        self._variables = {name.upper(): (name, data_type) for name, data_type in variables.items()}
        self._enumerations = {
            found.name.upper(): found for data_type in variables.values() for found in _enumerations(data_type)
        }
        self._absent = {name.upper(): reason for name, reason in (absent or {}).items()}
        self._constants = {name.upper(): value for name, value in (constants or {}).items()}

    def declare(self, at: ast.Position, name: str, data_type: DataType) -> None:
        """Adds a temporary variable."""
        if name.upper() in self._variables:
            fail(at, f"{name} is declared already")
        self._enumerations |= {found.name.upper(): found for found in _enumerations(data_type)}
        self._variables[name.upper()] = (name, data_type)

    def set_constant(self, name: str, data_type: DataType, value: Any) -> None:
        """Says what a variable that cannot be assigned holds."""
        self._constants[name.upper()] = data_type, value

    def constant(self, access: ast.VariableAccess) -> typed.Const | None:
        """The constant of an elementary type that the text names; None for anything else."""
        if access.name.upper() not in self._variables and not access.steps:
            kinds = [kind for kind in self._enumerations.values() if kind.place(access.name) is not None]
            if len(kinds) > 1:
                fail(access.at, f"{access.name}: expected {choices([f'{kind}#{access.name}' for kind in kinds])}")
            if kinds:
                return typed.Const(access.at, kinds[0], kinds[0].place(access.name))
        data_type, value = self._constants.get(access.name.upper(), (None, None))
        if not isinstance(data_type, ElementaryType) or access.steps:
            return None
        return typed.Const(access.at, data_type, value)

    def value(self, literal: ast.Literal) -> typed.Const:
        """The value of an enumeration, such as `COLOUR#RED`. Raises FunctionBlockError for an unknown one."""
        kind = self._enumerations.get(literal.type_name.rpartition("::")[2].upper())
        if kind is None:
            known = choices(sorted(map(str, self._enumerations.values()))) if self._enumerations else "none"
            fail(literal.at, f"unknown enumeration {literal.type_name}: expected that of a variable here: {known}")
        place = kind.place(str(literal.value))
        if place is None:
            fail(literal.at, f"{kind} has no value {literal.value}: expected {choices(kind.values)}")
        return typed.Const(literal.at, kind, place)

    def place(self, access: ast.VariableAccess, checked_index: Callable[[ast.Expression], typed.Expression]) -> Place:
        """What the text names.

        Args:
            access: the text.
            checked_index: checks an index; its type is an integer.

        Raises:
            FunctionBlockError: an unknown variable, member or part; names what would have been valid.
        """
        name, data_type, steps = self._variable(access)
        indices: list[typed.Expression] = []
        aggregates: list[Aggregate] = []
        for number, step in enumerate(steps):
            if isinstance(step, ast.Part):
                if number + 1 < len(steps):
                    fail(steps[number + 1].at, f"nothing follows a part such as %{step.size}{step.number}")
                part, offset = _part(step, data_type)
                return Place(name, data_type, tuple(indices), tuple(aggregates), part, offset)
            if isinstance(step, ast.Member):
                if not isinstance(data_type, StructType):
                    fail(step.at, f"{name} is a {data_type} here and has no member {step.name}")
                member = data_type.index(step.name)
                if member is None:
                    valid = choices([m.name for m in data_type.members])
                    fail(step.at, f"{data_type} has no member {step.name}: expected {valid}")
                indices.append(typed.Const(step.at, DINT, member))
                aggregates.append(data_type)
                data_type = data_type.members[member].type
                continue
            if isinstance(data_type, ElementaryType) and data_type.kind == "string":
                if number + 1 < len(steps):
                    fail(access.at, "nothing follows a character of a text")
                return _character(Place(name, data_type, tuple(indices), tuple(aggregates)), checked_index(step))
            if not isinstance(data_type, ArrayType):
                fail(step.at, f"{name} is a {data_type} here and takes no index")
            index = checked_index(step)
            if isinstance(index, typed.Const) and not data_type.lower <= index.value <= data_type.upper:
                fail(step.at, f"index {index.value} of {name}: expected {data_type.lower} to {data_type.upper}")
            indices.append(index)
            aggregates.append(data_type)
            data_type = data_type.element
        return Place(name, data_type, tuple(indices), tuple(aggregates))

    def reason(self, name: str) -> str:
        """Why nothing of that name can be called here; "" when nothing is known of it."""
        return self._absent.get(name.upper(), "")

    def _variable(
        self, access: ast.VariableAccess
    ) -> tuple[str, DataType, tuple[ast.Expression | ast.Member | ast.Part, ...]]:
        """Declared name and type of the variable, and the steps that lead on from it."""
        found = self._variables.get(access.name.upper())
        if found is not None:
            return (*found, access.steps)
        if access.steps and isinstance(access.steps[0], ast.Member):
            # a variable of an adapter
            found = self._variables.get(f"{access.name}.{access.steps[0].name}".upper())
            if found is not None:
                return (*found, access.steps[1:])
        if "::" in access.name or access.name.upper() in self._absent:
            reason = self._absent.get(access.name.upper(), "expected one of a file of constants (.gcf)")
            fail(access.at, f"unknown constant {access.name}: {reason}")
        known = choices(sorted(name for name, _ in self._variables.values())) if self._variables else "none"
        fail(access.at, f"unknown variable {access.name}: expected {known}, or a constant that is imported")


def _character(place: Place, index: typed.Expression) -> Place:
    """A character of the text at a place."""
    assert isinstance(place.type, ElementaryType)
    if isinstance(index, typed.Const) and index.value < 1:
        fail(index.at, f"character {index.value} of {place.name}: expected 1 for the first one")
    return replace(place, part=ELEMENTARY["CHAR" if place.type.name == "STRING" else "WCHAR"], character=index)


def _enumerations(data_type: DataType) -> Iterator[ElementaryType]:
    """The enumerations that a type consists of."""
    if isinstance(data_type, ArrayType):
        yield from _enumerations(data_type.element)
    elif isinstance(data_type, StructType):
        for member in data_type.members:
            yield from _enumerations(member.type)
    elif data_type.kind == "enum":
        yield data_type


def _part(step: ast.Part, data_type: DataType) -> tuple[ElementaryType, int]:
    """Type and lowest bit of a part of a bit string."""
    part = ELEMENTARY[_PARTS[step.size]]
    if not isinstance(data_type, ElementaryType) or data_type.kind != "bits" or part.bits >= data_type.bits:
        fail(step.at, f"%{step.size}{step.number} of {data_type}: expected a part of a longer bit string")
    count = data_type.bits // part.bits
    if step.number >= count:
        fail(step.at, f"%{step.size}{step.number} of {data_type}: expected %{step.size}0 to %{step.size}{count - 1}")
    return part, step.number * part.bits
