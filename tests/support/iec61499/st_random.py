"""Random programs of Structured Text, as texts: well-typed, and every one ends.

Those for Lua have what a FORTE takes as Lua: no integers of 64 bit, times, structures or arrays of arrays.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

from iec61499.literals import format_literal
from iec61499.types import ArrayType, DataType, ElementaryType, Member, StructType, elementary

SMALL: Final = ("SINT", "INT", "DINT", "USINT", "UINT", "UDINT", "BYTE", "WORD", "DWORD", "REAL", "LREAL", "BOOL")
LARGE: Final = ("LINT", "ULINT", "LWORD", "TIME", "TOD", "DATE", "DT")
WIDER: Final = {
    "INT": ("SINT", "USINT"),
    "DINT": ("INT", "UINT"),
    "LINT": ("DINT", "UDINT"),
    "UINT": ("USINT",),
    "UDINT": ("UINT",),
    "ULINT": ("UDINT",),
    "WORD": ("BYTE",),
    "DWORD": ("WORD",),
    "LWORD": ("DWORD",),
    "REAL": ("INT",),
    "LREAL": ("REAL", "DINT"),
}
"""What a value of a type may be written as, and becomes by itself."""
ROW: Final = ArrayType(elementary("INT"), 0, 2)
ITEM: Final = StructType(
    "ITEM",
    (
        Member("D", elementary("DINT"), 0),
        Member("S", elementary("STRING"), ""),
        Member("A", ROW, [0, 0, 0]),
        Member("T", elementary("TIME"), 0),
        Member("L", elementary("LINT"), 0),
    ),
)
NEST: Final = StructType("NEST", (Member("I", ITEM, ITEM.default), Member("W", elementary("WORD"), 0)))
_ARRAYS: Final[dict[str, DataType]] = {
    "AI": ArrayType(elementary("INT"), -1, 2),
    "AR": ArrayType(elementary("LREAL"), 0, 2),
    "AT": ArrayType(elementary("STRING"), 1, 2),
}
_DEEP: Final[dict[str, DataType]] = {
    "ROW1": ROW,
    "M": ArrayType(ROW, 0, 1),
    "IT": ITEM,
    "JT": ITEM,
    "SA": ArrayType(ITEM, -1, 1),
    "NE": NEST,
    "SB": elementary("STRING[5]"),
}
COUNTERS: Final = ("F1", "F2", "W1", "W2")


def variables(lua: bool) -> dict[str, DataType]:
    """The variables of the programs: two of each elementary type, arrays, and structures."""
    names = SMALL if lua else (*SMALL, *LARGE)
    scope: dict[str, DataType] = {f"{name}{n}": elementary(name) for name in (*names, "STRING") for n in (1, 2)}
    scope |= _ARRAYS if lua else {**_ARRAYS, **_DEEP}
    return scope | dict.fromkeys(COUNTERS, elementary("DINT"))


@dataclass(frozen=True)
class Program:
    """A program with the values that its variables start with."""

    text: str
    types: dict[str, DataType]
    values: dict[str, Any] = field(default_factory=dict)


def program(seed: int, lua: bool) -> Program:
    """The program of a seed."""
    return Maker(random.Random(seed), lua).program()


class Maker:
    """Makes a program; what it is made of is drawn by the methods that are called as the kinds of types.

    Attributes:
        ordered: kinds of types whose values are compared.
    """

    ordered: tuple[str, ...] = ("signed", "unsigned", "bits", "real", "time", "date")

    def __init__(self, rng: random.Random, lua: bool, types: dict[str, DataType] | None = None) -> None:
        self.rng = rng
        self.lua = lua
        self.types = types or variables(lua)
        self.loops = 0
        self.places: dict[str, list[tuple[str, tuple[tuple[int, int], ...]]]] = {}
        for name, kind in self.types.items():
            for place in _inside(name, kind, ()):
                self.places.setdefault(str(place[2]), []).append(place[:2])
        self.counters: list[str] = []

    def program(self) -> Program:
        text = "".join(self.statement(2) for _ in range(self.rng.randint(2, 6)))
        values = {n: self.initial(kind) for n, kind in self.types.items() if n not in COUNTERS}
        return Program(text, self.types, values)

    def initial(self, kind: DataType) -> Any:
        if isinstance(kind, ArrayType):
            return [self.initial(kind.element) for _ in range(kind.length)]
        if isinstance(kind, StructType):
            return [self.initial(member.type) for member in kind.members]
        return self.number(kind)

    def one(self, *options: Any) -> Any:
        return self.rng.choice(options)

    # ---- values ----

    def number(self, kind: ElementaryType) -> Any:
        rng, low, high = self.rng, kind.minimum, kind.maximum
        match kind.kind:
            case "bool":
                return rng.random() < 0.5
            case "real":
                halves = rng.randint(-9, 9) / 2
                edges = (
                    0.0,
                    1.0,
                    -1.5,
                    0.49999999999999994,
                    8388607.5,
                    2251799813685248.5,
                    2147483647.5,
                    1e30,
                    -1e300,
                )
                return kind.wrap(self.one(halves, rng.choice(edges), rng.uniform(-300, 300), rng.gauss(0, 1e10)))
            case "string":
                letters = rng.choice(("ab", "a1. -+", "TRUE1", "0123"))
                return "".join(rng.choice(letters) for _ in range(rng.randint(0, 5)))
            case "time":
                return self.one(0, rng.randint(-5000, 5000) * 10**6, rng.randint(-(10**9), 10**9))
            case "date":
                day = 24 * 3600 * 10**9
                days = 0 if kind.name == "TOD" else rng.randint(-40000, 60000) * day
                return days + (0 if kind.name == "DATE" else rng.randint(0, day - 1))
        return self.one(rng.randint(max(low, -4), 4), rng.randint(low, high), low, high)

    def literal(self, name: str) -> str:
        kind = elementary(name)
        value = self.number(kind)
        if name == "BOOL":
            return "TRUE" if value else "FALSE"
        if kind.kind == "real" and math.isinf(value):
            value = 2.5  # an infinity has no literal
        text = format_literal(value, kind)
        return text if kind.kind in ("string", "time", "date") else f"{name}#{text}"

    def place(self, name: str, depth: int) -> str:
        """A variable of the type, or an element or member that is."""
        template, bounds = self.rng.choice(self.places[name])
        return template.format(*(self.index(*pair, depth) for pair in bounds))

    def index(self, low: int, high: int, depth: int) -> str:
        if depth <= 0 or self.rng.random() < 0.6:
            return str(self.rng.randint(low, high))
        if self.rng.random() < 0.04:
            return str(self.one("INT1", "INT2"))
        return f"LIMIT(DINT#{low}, {self.value('DINT', depth - 1)}, DINT#{high})"

    def value(self, name: str, depth: int) -> str:
        """An expression of the type."""
        if depth <= 0 or self.rng.random() < 0.15:
            return self.place(name, depth) if self.rng.random() < 0.7 else self.literal(name)
        kind = elementary(name).kind
        if self.rng.random() < 0.12:
            return (
                f"SEL({self.value('BOOL', depth - 1)}, {self.value(name, depth - 1)}, {self.value(name, depth - 1)})"
            )
        return str(getattr(self, kind)(name, depth - 1))

    def operand(self, name: str, depth: int) -> str:
        """A value of the type, or of one that becomes it."""
        narrower = WIDER.get(name)
        return self.value(self.rng.choice(narrower) if narrower and self.rng.random() < 0.2 else name, depth)

    def other(self, *kinds: str) -> str:
        """The name of a type of these kinds."""
        names = [n for n in (SMALL if self.lua else (*SMALL, *LARGE)) if elementary(n).kind in kinds]
        return str(self.rng.choice(names))

    def signed(self, name: str, depth: int) -> str:
        value, operand = self.value, self.operand
        choice = self.rng.randrange(8)
        if choice < 3:
            return f"({value(name, depth)} {self.one('+', '-', '*', '/', 'MOD')} {operand(name, depth)})"
        if choice == 3:
            return f"{self.one('MIN', 'MAX')}({value(name, depth)}, {operand(name, depth)})"
        if choice == 4:
            return (
                self.one(f"ABS({value(name, depth)})", f"(-{value(name, depth)})")
                if name[0] != "U"
                else (f"MUX({value('INT', depth)}, {value(name, depth)}, {value(name, depth)})")
            )
        if choice == 5:
            source = self.other("real")
            return f"{source}_{self.one('TO', 'TO', 'TRUNC')}_{name}({value(source, depth)})"
        if choice == 6:
            return self.special(name, depth)
        source = self.other("signed", "unsigned", "bits", "bool")
        return value(name, depth) if source == name else f"{source}_TO_{name}({value(source, depth)})"

    unsigned = signed

    def draw(self, count: int, *edition_3: int) -> int:
        """One of so many choices, of which some came with the third edition of the standard."""
        return self.rng.randrange(count)

    def shift(self, name: str) -> str:
        """By how many bits a value is shifted."""
        return self.one(self.value("SINT", 0), f"SINT#{self.rng.randint(-2, 70)}")

    def special(self, name: str, depth: int) -> str:
        """What few integer types have."""
        value = self.value
        if name == "INT":
            return self.one(f"LEN({value('STRING', depth)})", f"FIND({value('STRING', depth)}, {value('STRING', 0)})")
        if self.lua:
            return f"STRING_TO_{name}({value('STRING', depth)})"
        if name == "LINT":
            return f"TIME_IN_{self.one('S', 'US')}_TO_LINT({value('TIME', depth)})"
        return self.one(
            f"STRING_TO_{name}({value('STRING', depth)})", f"({value(name, depth)} ** {value('SINT', 0)})"
        )

    def bits(self, name: str, depth: int) -> str:
        value = self.value
        choice = self.draw(5, 3)
        if choice == 0:
            return f"({value(name, depth)} {self.one('AND', 'OR', 'XOR')} {self.operand(name, depth)})"
        if choice == 1:
            return f"(NOT {value(name, depth)})"
        if choice == 2:
            by = self.shift(name)
            return f"{self.one('SHL', 'SHR', 'ROL', 'ROR')}({value(name, depth)}, {by})"
        if choice == 3 and name in ("BYTE", "WORD"):
            size, count = ("B", 4) if name == "BYTE" else ("W", 2)
            return f"{self.place('DWORD', 0)}.%{size}{self.rng.randrange(count)}"
        if choice == 3 and name == "LWORD":
            return f"LREAL_TO_LWORD({value('LREAL', depth)})"
        source = self.other("signed", "unsigned", "bits", "bool")
        return value(name, depth) if source == name else f"{source}_TO_{name}({value(source, depth)})"

    def bool(self, name: str, depth: int) -> str:
        value = self.value
        choice = self.draw(6, 2, 3)
        if choice == 0:
            return f"({value(name, depth)} {self.one('AND', 'OR', 'XOR', '=', '<>')} {value(name, depth)})"
        if choice == 1:
            return f"(NOT {value(name, depth)})"
        if choice == 2:
            return f"{self.place('WORD', 0)}.%X{self.rng.randrange(16)}"
        if choice == 3:
            return f"STRING_TO_BOOL({value('STRING', depth)})"
        compared = "STRING" if self.rng.random() < 0.2 else self.other(*self.ordered)
        sign = self.one("<", ">", "<=", ">=", "=", "<>")
        return f"({value(compared, depth)} {sign} {self.operand(compared, depth)})"

    def real(self, name: str, depth: int) -> str:
        value = self.value
        choice = self.draw(6, 4)
        if choice < 2:
            return f"({value(name, depth)} {self.one('+', '-', '*', '/')} {self.operand(name, depth)})"
        if choice == 2:
            return f"{self.one('MIN', 'MAX')}({value(name, depth)}, {self.operand(name, depth)})"
        if choice == 3:
            return self.one(f"ABS({value(name, depth)})", f"(-{value(name, depth)})", f"SQRT({value(name, depth)})")
        if choice == 4:
            return f"STRING_TO_{name}({value('STRING', depth)})"
        source = self.other("real", "signed", "unsigned")
        return value(name, depth) if source == name else f"{source}_TO_{name}({value(source, depth)})"

    def string(self, name: str, depth: int) -> str:
        text, count, place = self.value(name, depth), self.value("INT", 0), f"INT#{self.rng.randint(-1, 6)}"
        if self.rng.random() < 0.5:
            count = f"INT#{self.rng.randint(-1, 6)}"
        source = self.other("signed", "unsigned", "bits", "bool", "real", "time")
        return str(
            self.one(
                f"CONCAT({text}, {self.value(name, depth)})",
                f"{self.one('LEFT', 'RIGHT')}({text}, {count})",
                f"{self.one('MID', 'DELETE')}({text}, {count}, {place})",
                f"INSERT({text}, {self.value(name, 0)}, {place})",
                f"REPLACE({text}, {self.value(name, 0)}, {count}, {place})",
                f"{source}_TO_STRING({self.value(source, depth)})",
                f"{self.one('MIN', 'MAX')}({text}, {self.value(name, 0)})",
            )
        )

    def time(self, name: str, depth: int) -> str:
        value = self.value
        choice = self.rng.randrange(5)
        if choice == 0:
            return f"({value(name, depth)} {self.one('+', '-')} {value(name, depth)})"
        if choice < 3:
            number = self.value(self.other("signed", "unsigned", "real"), depth)
            return self.one(f"({value(name, depth)} {self.one('*', '/')} {number})", f"({number} * {value(name, 0)})")
        if choice == 3:
            return f"(-{value(name, depth)})"
        kind = self.one("DT", "TOD", "DATE")
        return f"({value(kind, depth)} - {value(kind, depth)})"

    def date(self, name: str, depth: int) -> str:
        value = self.value
        if self.rng.random() < 0.6:
            return f"({value(name, depth)} {self.one('+', '-')} {value('TIME', depth)})"
        if name == "DT":
            return f"CONCAT_DATE_TOD({value('DATE', depth)}, {value('TOD', depth)})"
        return f"DT_TO_{name}({value('DT', depth)})"

    # ---- statements ----

    def body(self, depth: int) -> str:
        return "".join(self.statement(depth) for _ in range(self.rng.randint(1, 2)))

    def statement(self, depth: int) -> str:
        choice = self.rng.random()
        if depth == 0 or choice < 0.6:
            return self.assignment()
        if choice < 0.75:
            middle = f"ELSIF {self.value('BOOL', 2)} THEN {self.body(depth - 1)}" if choice < 0.66 else ""
            rest = f"ELSE {self.body(depth - 1)}" if self.rng.random() < 0.5 else ""
            return f"IF {self.value('BOOL', 2)} THEN {self.body(depth - 1)}{middle}{rest}END_IF;\n"
        if choice < 0.82:
            cases = "".join(f"{self.label()}: {self.body(depth - 1)}" for _ in range(self.rng.randint(1, 3)))
            return f"CASE {self.value('INT', 2)} OF {cases}ELSE {self.body(depth - 1)}END_CASE;\n"
        if choice < 0.84:
            leaves = ("EXIT;\n", "CONTINUE;\n", "RETURN;\n") if self.loops else ("RETURN;\n",)
            return f"IF {self.value('BOOL', 1)} THEN {self.rng.choice(leaves)}END_IF;\n"
        return self.loop(depth) if self.loops < 2 else self.assignment()

    def label(self) -> str:
        number = self.rng.randint(-3, 9)
        return self.one(str(number), f"{number}..{number + 3}", f"{number}, {number + 11}")

    def loop(self, depth: int) -> str:
        self.loops += 1
        counter, turns = f"F{self.loops}", f"W{self.loops}"
        if self.rng.random() < 0.5:
            first, last = self.rng.randint(-2, 3), self.rng.randint(-2, 4)
            step = self.one("", " BY 2", " BY -1", f" BY {self.place('SINT', 0)}" if self.rng.random() < 0.1 else "")
            text = f"FOR {counter} := {first} TO {last}{step} DO {self.body(depth - 1)}END_FOR;\n"
        elif self.rng.random() < 0.5:
            inner = f"{turns} := {turns} + 1;\n{self.body(depth - 1)}"
            text = f"WHILE ({turns} < 4) AND {self.value('BOOL', 2)} DO {inner}END_WHILE;\n"
        else:
            inner = f"{turns} := {turns} + 1;\n{self.body(depth - 1)}"
            text = f"REPEAT {inner}UNTIL ({turns} > 3) OR {self.value('BOOL', 2)} END_REPEAT;\n"
        self.loops -= 1
        return text

    def assignment(self) -> str:
        choice = self.rng.random()
        if choice < 0.06:
            return f"{self.place('STRING', 0)}[{self.one('1', '2', 'INT1')}] := {self.character()};\n"
        if choice < 0.12:
            part = self.rng.randrange(16)
            return self.one(
                f"{self.place('WORD', 1)}.%X{part} := {self.value('BOOL', 2)};\n",
                f"{self.place('DWORD', 1)}.%B{part % 4} := {self.value('BYTE', 2)};\n",
            )
        if choice < (0.15 if self.lua else 0.35):
            whole = [name for name in self.places if not name.startswith(_SIMPLE)]
            name = self.rng.choice(whole)
            return f"{self.place(name, 1)} := {self.place(name, 1)};\n"
        names = [name for name in self.places if name.startswith(_SIMPLE) and name != "STRING[5]"]
        name = self.rng.choice(names)
        target = self.place(name, 2)
        if target in COUNTERS:
            return self.assignment()
        if name == "STRING" and not self.lua and self.rng.random() < 0.2:
            target = "SB"
        return f"{target} := {self.operand(name, 3)};\n"

    def character(self) -> str:
        return self.one("'x'", f"{self.place('STRING', 0)}[1]")


_SIMPLE: Final = (*SMALL, *LARGE, "STRING")


def _inside(
    name: str, kind: DataType, bounds: tuple[tuple[int, int], ...]
) -> Iterator[tuple[str, tuple[tuple[int, int], ...], DataType]]:
    """All places of a type in a variable: how they are written, and the bounds of their indices."""
    yield name, bounds, kind
    if isinstance(kind, ArrayType):
        yield from _inside(f"{name}[{{}}]", kind.element, (*bounds, (kind.lower, kind.upper)))
    elif isinstance(kind, StructType):
        for member in kind.members:
            yield from _inside(f"{name}.{member.name}", member.type, bounds)
