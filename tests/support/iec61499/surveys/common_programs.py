"""Random programs of what IEC 61131-3 has had since its second edition, and whether the standard says what they do.

Other compilers are older than the third edition: nothing widens by itself here, and there are no parts of words, no
characters of texts and no conversions of texts.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from iec61499.st import ast
from iec61499.st.parser import parse_algorithm
from iec61499.types import ArrayType, DataType, ElementaryType, elementary
from tests.support.iec61499.st_oracle import Oracle, Return, Value
from tests.support.iec61499.st_oracle_functions import wrap
from tests.support.iec61499.st_random import COUNTERS, SMALL, Maker, Program

_TYPES: Final = (*SMALL, "LINT", "ULINT", "LWORD", "STRING")
VARIABLES: Final[dict[str, DataType]] = {
    **{f"{name}{n}": elementary(name) for name in _TYPES for n in (1, 2)},
    "AI": ArrayType(elementary("INT"), -1, 2),
    "AR": ArrayType(elementary("LREAL"), 0, 2),
    **dict.fromkeys(COUNTERS, elementary("DINT")),
}


class Undefined(Exception):
    """The program does what the standard calls an error, or leaves to whoever implements it."""


def common_program(seed: int) -> Program:
    """The program of a seed."""
    return _CommonMaker(random.Random(seed), True, VARIABLES).program()


class _CommonMaker(Maker):
    ordered = ("signed", "unsigned", "bits", "real")

    def program(self) -> Program:
        made = super().program()
        text = made.text.replace("_TRUNC_", "_TO_").replace("CONTINUE;", "EXIT;")
        return Program(text, made.types, made.values)

    def number(self, kind: ElementaryType) -> Any:
        """Small ones mostly, so that few sums leave the range of their type."""
        if kind.kind in ("signed", "unsigned", "bits") and self.rng.random() < 0.8:
            return self.rng.randint(max(kind.minimum, -9), 9)
        return super().number(kind)

    def operand(self, name: str, depth: int) -> str:
        return self.value(name, depth)

    def special(self, name: str, depth: int) -> str:
        value = self.value
        if name != "INT":
            return value(name, depth)
        return str(
            self.one(f"LEN({value('STRING', depth)})", f"FIND({value('STRING', depth)}, {value('STRING', 0)})")
        )

    def draw(self, count: int, *edition_3: int) -> int:
        return self.rng.choice([choice for choice in range(count) if choice not in edition_3])

    def shift(self, name: str) -> str:
        return f"SINT#{self.rng.randint(0, elementary(name).bits)}"

    def string(self, name: str, depth: int) -> str:
        text, count, place = self.value(name, depth), f"INT#{self.rng.randint(0, 4)}", f"INT#{self.rng.randint(1, 4)}"
        return str(
            self.one(
                f"CONCAT({text}, {self.value(name, depth)})",
                f"{self.one('LEFT', 'RIGHT')}({text}, {count})",
                f"{self.one('MID', 'DELETE')}({text}, {count}, {place})",
                f"INSERT({text}, {self.value(name, 0)}, {place})",
                f"REPLACE({text}, {self.value(name, 0)}, {count}, {place})",
            )
        )

    def assignment(self) -> str:
        names = [name for name in self.places if name in _TYPES]
        name = self.rng.choice(names)
        target = self.place(name, 2)
        return self.assignment() if target in COUNTERS else f"{target} := {self.value(name, 3)};\n"


@dataclass(frozen=True)
class Defined:
    """What a program does by the standard alone.

    Attributes:
        left: what it leaves in its variables; None where the standard does not say.
        rare: what it does on the way that matiec is known to do otherwise.
    """

    left: dict[str, Any]
    rare: frozenset[str]


def defined_by(of: Program) -> Defined:
    """What the program does by the standard alone. Raises Undefined, and what the oracle raises."""
    oracle = _Strict(of.types, of.values)
    with suppress(Return):
        oracle.body(parse_algorithm(of.text).body)
    return Defined({name: oracle.data[name] for name in of.types}, frozenset(oracle.rare))


class _Strict(Oracle):
    """The oracle without its table: what IEC 61131-3 calls an error, or does not say, ends the program."""

    def __init__(self, types: Mapping[str, DataType], values: Mapping[str, Any]) -> None:
        super().__init__(types, values)
        self.rare: set[str] = set()

    def unary(self, operator: str, value: Value) -> Value:
        if operator == "-" and value.kind != "real":
            _within(-value.data, value.type)
        if operator == "NOT" and value.kind == "bits" and _bits(value.type) < 32:
            self.rare.add("NOT of a BYTE or WORD, which C widens")
        return super().unary(operator, value)

    def binary(self, operator: str, left: Value, node: ast.Expression) -> Value:
        right = self.value(node)  # also what AND and OR may leave out
        kind = left.kind
        if kind in ("signed", "unsigned") and operator in ("+", "-", "*", "/", "MOD"):
            if operator in ("/", "MOD") and right.data == 0:
                raise Undefined(f"{operator} by 0")
            exact = {"+": left.data + right.data, "-": left.data - right.data, "*": left.data * right.data}
            quotient = abs(left.data) // abs(right.data) if right.data else 0
            signed = quotient if (left.data < 0) == (right.data < 0) else -quotient
            _within(exact.get(operator, signed), left.type)
        return super().binary(operator, left, node)

    def call(self, function: str, arguments: tuple[ast.Expression, ...]) -> Value:
        values = [self.value(argument) for argument in arguments]  # also what SEL may leave out
        _look(function, values)
        data = [value.data for value in values]
        if function == "REPLACE" and len(data[1]) > data[2]:
            self.rare.add("REPLACE by a longer text")
        if function == "FIND" and data[0].find(data[1]) > 0:
            self.rare.add("FIND behind the first place")
        return super().call(function, arguments)

    def statement(self, node: ast.Statement) -> None:
        if isinstance(node, ast.Case) and any(name in str(node.selector) for name in ("'LEN'", "'FIND'")):
            self.rare.add("CASE of LEN or FIND, whose labels matiec compares without signs")
        super().statement(node)

    def count(self, node: ast.For) -> None:
        start, stop = self.value(node.start).data, self.value(node.stop).data
        step = self.value(node.step).data if node.step is not None else 1
        if (start <= stop if step > 0 else start >= stop) and (
            start + step > stop if step > 0 else start + step < stop
        ):
            self.rare.add("FOR with one round")
        super().count(node)
        # what the variable holds after the loop is left to whoever implements it (IEC 61131-3, 7.3.3.4.2)
        self.data[node.variable.name] = None

    def load(self, access: ast.VariableAccess) -> Value:
        found = super().load(access)
        if found.data is None:
            raise Undefined("the variable of a loop that has ended")
        return found


def _look(function: str, values: list[Value]) -> None:
    """Raises Undefined where a function gets what the standard does not define."""
    data = [value.data for value in values]
    first = values[0]
    target = function.partition("_TO_")[2]
    if target:
        _look_at_conversion(first, elementary(target))
        return
    match function:
        case "ABS" if first.kind != "real":
            _within(abs(data[0]), first.type)
        case "ABS" if data[0] == 0 and math.copysign(1, data[0]) < 0:
            raise Undefined("ABS of -0.0")
        case "MIN" | "MAX" if first.kind == "real":
            if any(map(math.isnan, data)) or (data[0] == data[1] and str(data[0]) != str(data[1])):
                raise Undefined("MIN or MAX of NaN or zeros of both signs")
        case "LIMIT" if data[0] > data[2]:
            raise Undefined("LIMIT of no range")
        case "MUX" if not 0 <= data[0] < len(data) - 1:
            raise Undefined("MUX beyond its inputs")
        case "SHL" | "SHR" | "ROL" | "ROR" if not 0 < data[1] < _bits(first.type):
            raise Undefined("a shift by no bit, or by all")
        case "SQRT" if data[0] < 0:
            raise Undefined("the root of a negative number")
        case "FIND" if not data[1] or not data[0]:
            raise Undefined("FIND of nothing")
        case "LEFT" | "RIGHT" if not 0 <= data[1] <= len(data[0]):
            raise Undefined("more characters than there are")
        case "MID" | "DELETE" if not (data[2] >= 1 and data[2] - 1 + data[1] <= len(data[0])):
            raise Undefined("characters that are not there")
        case "REPLACE" if not (data[3] >= 1 and data[3] - 1 + data[2] <= len(data[0])):
            raise Undefined("characters that are not there")
        case "INSERT" if not 0 <= data[2] <= len(data[0]):
            raise Undefined("a place that is not there")


def _look_at_conversion(value: Value, target: ElementaryType) -> None:
    if value.kind == "real" and target.kind in ("signed", "unsigned"):
        if not math.isfinite(value.data):
            raise Undefined("no integer")
        _within(round(value.data), target)
    elif value.kind in ("signed", "unsigned") and target.kind in ("signed", "unsigned"):
        _within(value.data, target)


def _within(number: int, kind: DataType) -> None:
    assert isinstance(kind, ElementaryType)
    if wrap(number, kind) != number:
        raise Undefined(f"{number} is no {kind}")


def _bits(kind: DataType) -> int:
    assert isinstance(kind, ElementaryType)
    return kind.bits
