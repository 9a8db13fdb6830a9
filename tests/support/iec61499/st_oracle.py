"""What a program of Structured Text does by IEC 61131-3 and the rules of docs/blocks.md: a walk over its tree.

It shares nothing with the product but the parser's tree and the names of types. Every value knows its type; integers
and times are exact and wrap after each operation, and reals become integers through fractions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Final

from iec61499.st import ast
from iec61499.types import BOOL, CHAR, DINT, ELEMENTARY, ArrayType, DataType, ElementaryType, StructType
from tests.support.iec61499.st_oracle_functions import DAY, call, convert, integer_divide, real, real_divide, wrap

_PARTS: Final = {"X": 1, "B": 8, "W": 16, "D": 32}
_ORDER: Final[dict[str, Callable[[Any, Any], bool]]] = {
    "=": lambda a, b: a == b,
    "<>": lambda a, b: a != b,
    "<": lambda a, b: a < b,
    ">": lambda a, b: a > b,
    "<=": lambda a, b: a <= b,
    ">=": lambda a, b: a >= b,
}
_LOGIC: Final[dict[str, Callable[[int, int], int]]] = {
    "AND": lambda a, b: a & b,
    "OR": lambda a, b: a | b,
    "XOR": lambda a, b: a ^ b,
}


class Fault(Exception):
    """The program ends with an error and leaves its variables alone."""


class _Exit(Exception):
    pass


class _Continue(Exception):
    pass


class Return(Exception):
    """The program has ended early."""


@dataclass(frozen=True)
class Value:
    type: DataType
    data: Any

    @property
    def kind(self) -> str:
        return self.type.kind if isinstance(self.type, ElementaryType) else ""


@dataclass(frozen=True)
class _Place:
    """Where a value is: the steps from the variable's data, and what is meant of it."""

    name: str
    steps: tuple[int, ...]
    type: DataType
    character: int | None = None
    part: tuple[int, int] | None = None


def left_by(tree: ast.ParsedAlgorithm, types: Mapping[str, DataType], values: Mapping[str, Any]) -> dict[str, Any]:
    """What the program leaves in its variables. Raises Fault."""
    oracle = Oracle(types, values)
    with suppress(Return):
        oracle.body(tree.body)
    return {name: oracle.data[name] for name in types}


class Oracle:
    """Walks over the tree of a program."""

    def __init__(self, types: Mapping[str, DataType], values: Mapping[str, Any]) -> None:
        self.types = types
        self.data = {name: deepcopy(values.get(name, kind.default)) for name, kind in types.items()}

    # ---- statements ----

    def body(self, statements: tuple[ast.Statement, ...]) -> None:
        for statement in statements:
            self.statement(statement)

    def statement(self, node: ast.Statement) -> None:
        match node:
            case ast.Assignment(target=target, value=value):
                self.assign(target, self.value(value))
            case ast.If(branches=branches, otherwise=otherwise):
                taken = next((b.body for b in branches if self.value(b.condition).data), otherwise)
                self.body(taken)
            case ast.Case(selector=selector, branches=cases, otherwise=otherwise):
                number = self.value(selector).data
                found = next((c.body for c in cases if any(self.fits(number, x) for x in c.labels)), otherwise)
                self.body(found)
            case ast.For():
                self.count(node)
            case ast.While(condition=condition, body=body):
                while self.value(condition).data and self.round(body):
                    pass
            case ast.Repeat(body=body, condition=condition):
                while self.round(body) and not self.value(condition).data:
                    pass
            case ast.Exit():
                raise _Exit
            case ast.Continue():
                raise _Continue
            case ast.Return():
                raise Return
            case _:
                raise NotImplementedError(type(node).__name__)

    def round(self, body: tuple[ast.Statement, ...]) -> bool:
        """Goes round a loop once; whether it may go on."""
        try:
            self.body(body)
        except _Continue:
            return True
        except _Exit:
            return False
        return True

    def count(self, node: ast.For) -> None:
        kind = self.types[node.variable.name]
        assert isinstance(kind, ElementaryType)
        number, stop = self.value(node.start).data, self.value(node.stop).data
        step = self.value(node.step).data if node.step is not None else 1
        if step == 0:
            raise Fault("BY 0")
        while number <= stop if step > 0 else number >= stop:
            self.data[node.variable.name] = number
            if not self.round(node.body):
                return
            number += step
        self.data[node.variable.name] = wrap(number, kind)

    def fits(self, number: int, label: ast.Expression | ast.Range) -> bool:
        if isinstance(label, ast.Range):
            return bool(self.value(label.low).data <= number <= self.value(label.high).data)
        return bool(self.value(label).data == number)

    # ---- places ----

    def place(self, access: ast.VariableAccess) -> _Place:
        kind = self.types[access.name]
        steps: list[int] = []
        for step in access.steps:
            if isinstance(step, ast.Part):
                width = _PARTS[step.size]
                return _Place(access.name, tuple(steps), kind, part=(width, width * step.number))
            if isinstance(step, ast.Member):
                assert isinstance(kind, StructType)
                number = [member.name for member in kind.members].index(step.name)
                kind = kind.members[number].type
                steps.append(number)
                continue
            index = self.value(step).data
            if isinstance(kind, ElementaryType):
                if not 1 <= index <= len(self.inside(access.name, tuple(steps))):
                    raise Fault("character")
                return _Place(access.name, tuple(steps), kind, character=index)
            assert isinstance(kind, ArrayType)
            if not kind.lower <= index <= kind.upper:
                raise Fault("index")
            steps.append(index - kind.lower)
            kind = kind.element
        return _Place(access.name, tuple(steps), kind)

    def inside(self, name: str, steps: tuple[int, ...]) -> Any:
        found = self.data[name]
        for step in steps:
            found = found[step]
        return found

    def load(self, access: ast.VariableAccess) -> Value:
        place = self.place(access)
        found = deepcopy(self.inside(place.name, place.steps))
        if place.character is not None:
            return Value(CHAR, found[place.character - 1])
        if place.part is not None:
            width, lowest = place.part
            bits = found >> lowest & (1 << width) - 1
            kind = next(t for t in ELEMENTARY.values() if t.bits == width and t.kind in ("bits", "bool"))
            return Value(kind, bool(bits) if kind == BOOL else bits)
        return Value(place.type, found)

    def assign(self, target: ast.VariableAccess, value: Value) -> None:
        place = self.place(target)
        before = self.inside(place.name, place.steps)
        if place.character is not None:
            data = before[: place.character - 1] + value.data + before[place.character :]
        elif place.part is not None:
            width, lowest = place.part
            data = before & ~((1 << width) - 1 << lowest) | int(value.data) << lowest
        elif isinstance(place.type, ElementaryType):
            data = widened(value, place.type).data
        else:
            data = deepcopy(value.data)
        if not place.steps:
            self.data[place.name] = data
        else:
            self.inside(place.name, place.steps[:-1])[place.steps[-1]] = data

    # ---- expressions ----

    def value(self, node: ast.Expression) -> Value:
        match node:
            case ast.Literal(value=data, type_name=name):
                return Value(ELEMENTARY[name] if name else BOOL if isinstance(data, bool) else DINT, data)
            case ast.VariableAccess():
                return self.load(node)
            case ast.Unary(operator=operator, operand=operand):
                return self.unary(operator, self.value(operand))
            case ast.Binary(operator=operator, left=left, right=right):
                return self.binary(operator, self.value(left), right)
            case ast.Call(function=function, arguments=arguments):
                return self.call(function, arguments)

    def unary(self, operator: str, value: Value) -> Value:
        kind = value.type
        assert isinstance(kind, ElementaryType)
        if operator == "NOT":
            return Value(kind, not value.data if kind == BOOL else value.data ^ (1 << kind.bits) - 1)
        return Value(kind, -value.data if value.kind == "real" else wrap(-value.data, kind))

    def binary(self, operator: str, left: Value, node: ast.Expression) -> Value:
        if left.type == BOOL and operator in ("AND", "OR") and left.data == (operator == "OR"):
            return left  # the other one is not looked at
        right = self.value(node)
        if "time" in (left.kind, right.kind) and left.kind != right.kind and left.kind != "date":
            return self.scaled(operator, left, right)
        if left.kind == "date" and operator in "+-":
            return self.moved(operator, left, right)
        if operator == "**":
            return Value(left.type, power(left, right.data))
        kind = common(left, right)
        a, b = widened(left, kind).data, widened(right, kind).data
        if operator in _ORDER:
            return Value(BOOL, _ORDER[operator](a, b))
        if operator in _LOGIC:
            return Value(kind, bool(_LOGIC[operator](a, b)) if kind == BOOL else _LOGIC[operator](a, b))
        if kind.kind == "real":
            return Value(kind, real(real_divide(a, b) if operator == "/" else _sum(operator, a, b), kind))
        return Value(kind, wrap(_integers(operator, a, b), kind))

    def scaled(self, operator: str, left: Value, right: Value) -> Value:
        """TIME by a number."""
        time, number = (left, right) if left.kind == "time" else (right, left)
        kind = time.type
        assert isinstance(kind, ElementaryType)
        if number.kind != "real":
            return Value(kind, wrap(_integers(operator, time.data, number.data), kind))
        if operator == "/" and number.data == 0:
            return Value(kind, 0)
        result = float(time.data) * number.data if operator == "*" else float(time.data) / number.data
        return Value(kind, convert(Value(ELEMENTARY["LREAL"], result), ELEMENTARY["LINT"], "TRUNC").data)

    def moved(self, operator: str, left: Value, right: Value) -> Value:
        """Dates with durations, and the durations between them."""
        result = _sum(operator, left.data, right.data)
        if right.kind == "date":
            return Value(ELEMENTARY["TIME"], wrap(result, ELEMENTARY["TIME"]))
        result = wrap(result, ELEMENTARY["LINT"])
        name = str(left.type)
        return Value(
            left.type, result % DAY if name == "TOD" else result - result % DAY if name == "DATE" else result
        )

    def call(self, function: str, arguments: tuple[ast.Expression, ...]) -> Value:
        if function == "SEL":  # only what is selected is looked at
            choice, *others = arguments
            return self.value(others[int(self.value(choice).data)])
        values = [self.value(argument) for argument in arguments]
        if function in ("MIN", "MAX", "LIMIT", "MUX"):
            first = 1 if function == "MUX" else 0
            kind = values[first].type
            for value in values[first:]:
                kind = common(Value(kind, None), value)
            assert isinstance(kind, ElementaryType)
            values = [*values[:first], *(widened(value, kind) for value in values[first:])]
        return call(function, values)


def common(a: Value, b: Value) -> ElementaryType:
    """The type of which both are: here always that of one of them."""
    first, second = a.type, b.type
    assert isinstance(first, ElementaryType)
    assert isinstance(second, ElementaryType)
    if first.kind == second.kind:
        return max((first, second), key=lambda kind: kind.bits)
    ranks = ("char", "string", "bool", "bits", "unsigned", "signed", "real")
    return max((first, second), key=lambda kind: ranks.index(kind.kind))


def widened(value: Value, kind: ElementaryType) -> Value:
    """The value as one of a wider type."""
    if kind.kind == "real" and value.kind in ("signed", "unsigned"):
        return Value(kind, float(value.data))
    if kind.kind == "string":
        return Value(kind, value.data[: kind.limit] if kind.limit else value.data)
    return Value(kind, int(value.data) if kind.kind == "bits" else value.data)


def power(base: Value, exponent: int) -> int:
    """base to the power of an integer, in the type of the base."""
    assert isinstance(base.type, ElementaryType)
    if exponent >= 0:
        return wrap(pow(base.data, exponent), base.type)
    return wrap(integer_divide(1, pow(base.data, -exponent)), base.type)


def _integers(operator: str, a: int, b: int) -> int:
    if operator == "/":
        return integer_divide(a, b)
    if operator == "MOD":
        return 0 if b == 0 else a - b * integer_divide(a, b)
    return _sum(operator, a, b)


def _sum(operator: str, a: Any, b: Any) -> Any:
    return a + b if operator == "+" else a - b if operator == "-" else a * b


def equal(a: Any, b: Any) -> bool:
    """Equality to the last bit, any NaN being equal to any other."""
    if isinstance(a, list):
        return len(a) == len(b) and all(equal(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float) and isinstance(b, float):
        return (math.isnan(a) and math.isnan(b)) or (a == b and math.copysign(1, a) == math.copysign(1, b))
    return type(a) is type(b) and bool(a == b)
