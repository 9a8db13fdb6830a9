"""Random uses of the standard blocks: what a 4diac FORTE answers, and what the embedded runtime does."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from iec61499 import model
from iec61499.departures.table import DEPARTURES
from iec61499.departures.uses import Use
from iec61499.library import Library
from iec61499.literals import format_date, format_typed
from iec61499.management.client import ManagementClient
from iec61499.runtime.resource import Resource
from iec61499.standard.catalogue import find_standard
from iec61499.types import ELEMENTARY, STRING, ElementaryType, bytes_of
from tests.support.waiting import until

REPEATS: Final = 5
"""Cases that are drawn of one block and the same types."""
COUNTER: Final = "COUNTER"
"""The E_CTU that tells when a block has answered; no block that is compared has the name."""
_TYPES: Final = [t for t in ELEMENTARY.values() if t.name not in ("LTIME", "LDATE", "LTOD", "LDT", "CHAR", "WCHAR")]
_CONVERTED: Final = [
    t.name for t in _TYPES if t.kind in ("bool", "signed", "unsigned", "bits", "real") or t == STRING
]
_CONVERSIONS: Final = [
    f"F_{source}_TO_{target}"
    for source in [*_CONVERTED, "TIME"]
    for target in _CONVERTED
    if find_standard(f"F_{source}_TO_{target}") is not None
]
_NAMES: Final = (
    *("F_ADD", "F_SUB", "F_MUL", "F_DIV", "F_MOD", "F_EXPT", "F_MIN", "F_MAX", "F_MOVE", "F_NOT", "F_ABS", "F_SQRT"),
    *("F_LN", "F_LOG", "F_EXP", "F_SIN", "F_COS", "F_TAN", "F_ASIN", "F_ACOS", "F_ATAN", "F_GT", "F_GE", "F_EQ"),
    *("F_LE", "F_LT", "F_NE", "F_SHL", "F_SHR", "F_ROL", "F_ROR", "F_SEL", "F_LIMIT", "F_MULTIME", "F_DIVTIME"),
    *("F_TRUNC", "F_LEN", "F_FIND", "F_LEFT", "F_RIGHT", "F_MID", "F_INSERT", "F_DELETE", "F_REPLACE", "F_CONCAT"),
    *("F_AND", "F_OR", "F_XOR", "ADD_3", "AND_4", "OR_2", "XOR_3", "F_MUX_2"),
)


_NO_TRUTH: Final = ("F_SHL", "F_SHR", "F_ROL", "F_ROR", "F_MIN", "F_MAX", "F_LIMIT", "F_GT", "F_GE", "F_LE", "F_LT")
"""Blocks that take no BOOL here."""
_SINKS: Final = {
    "LINT": ("F_LINT_TO_ULINT", "IN"),
    "ULINT": ("F_ULINT_TO_LINT", "IN"),
    "LWORD": ("F_LWORD_TO_ULINT", "IN"),
    "DATE": ("F_CONCAT_DATE_TOD", "IN1"),
    "TOD": ("F_ADD_TOD_TIME", "IN1"),
    "DT": ("F_DT_TO_DATE", "IN"),
}
"""Block and input of a type that have it where there is no block such as INT2INT."""


@dataclass(frozen=True, slots=True)
class Case:
    """A block with literals at its inputs, by their names, each with the prefix of its type."""

    type_name: str
    types: dict[str, ElementaryType]
    literals: dict[str, str]

    def departs(self) -> bool:
        """Whether the table of departures says that FORTE computes another value here."""
        use = Use(self.type_name, self.types, self.literals)
        rows = (row for row in DEPARTURES if row.here != "as FORTE" and re.fullmatch(row.names, self.type_name))
        return any(row.applies(use) for row in rows)

    def __str__(self) -> str:
        return f"{self.type_name}({', '.join(f'{name} := {text}' for name, text in self.literals.items())})"


@dataclass(frozen=True, slots=True)
class Group:
    """Cases of one block and the same types, what is expected of OUT after each, and its type."""

    cases: tuple[Case, ...]
    expected: tuple[str, ...]
    kind: ElementaryType


def function_groups(rng: random.Random, count: int, known: Collection[str]) -> Iterator[Group]:
    """Cases of the F_ blocks that do not depart, `count` in all.

    Args:
        rng: draws blocks, types and literals.
        count: how many cases.
        known: the names of FORTE's types without those whose names carry a size.
    """
    names = [name for name in _NAMES if name in known or not name.startswith("F_")]
    conversions = [name for name in _CONVERSIONS if name in known]
    while count > 0:
        name = rng.choice(conversions if rng.random() < 0.3 else names)
        types = _types(rng, name)
        drawn = (Case(name, types, _literals(rng, types)) for _ in range(REPEATS))
        cases = [case for case in drawn if not case.departs()][:count]
        count -= len(cases)
        if cases:
            yield computed(cases)


def _types(rng: random.Random, name: str) -> dict[str, ElementaryType]:
    """The type of every input; inputs of one generic type get one type."""
    block = find_standard(name)
    assert block is not None
    chosen: dict[str, ElementaryType] = {}
    types = {}
    for variable in block.interface.inputs:
        kind = variable.type
        if isinstance(kind, model.GenericType):
            candidates = [t for t in _TYPES if kind.admits(t) and (t.kind != "bool" or name not in _NO_TRUTH)]
            kind = chosen.setdefault(kind.name, rng.choice(candidates))
        assert isinstance(kind, ElementaryType)
        types[variable.name] = kind
    return types


def _literals(rng: random.Random, types: Mapping[str, ElementaryType]) -> dict[str, str]:
    literals = {}
    for name, kind in types.items():
        small = name in ("N", "L", "P", "K")
        literals[name] = format_typed(_value(rng, kind, small), kind)
    return literals


def _value(rng: random.Random, kind: ElementaryType, small: bool) -> object:
    match kind.kind:
        case "bool":
            return rng.random() < 0.5
        case "real":
            choices = (0.0, 0.5, -0.5, 1.5, 2.5, -2.5, 1.0, -1.0, rng.uniform(-2, 2), rng.uniform(-1e6, 1e6))
            return kind.wrap(rng.choice((*choices, rng.uniform(-1, 1) * 10.0 ** rng.randint(-12, 12))))
        case "string":
            letters = rng.choice(("ab", "0123456789", "xyz ÄöüßEuro€", "-+.#16TRUE"))
            text = "".join(rng.choice(letters) for _ in range(rng.randint(0, 8)))
            return bytes_of(text) if kind.name == "STRING" else text
        case "time":
            return rng.choice((0, rng.randint(-10_000, 10_000) * 1_000_000, rng.randint(-(10**9), 10**9) * 1000))
        case "date":
            day = 86_400_000_000_000
            days = 0 if kind.name == "TOD" else rng.randint(0, 30_000) * day
            return days + (0 if kind.name == "DATE" else rng.randint(0, 86_399_999) * 1_000_000)
    if small:
        return max(kind.minimum, rng.choice((0, 1, 2, 3, 4, 7, -1, rng.randint(0, 40))))
    edges = (
        kind.minimum,
        kind.maximum,
        kind.maximum - 1,
        0,
        1,
        2,
        3,
        10,
        max(-1, kind.minimum),
        max(-7, kind.minimum),
    )
    return rng.choice((*edges, rng.randint(kind.minimum, kind.maximum), rng.randint(0, 127)))


class Questioner:
    """Puts cases to a device.

    Args:
        client: a session with the device.
        resource: the name of a new resource there.
    """

    def __init__(self, client: ManagementClient, resource: str) -> None:
        self._client = client
        self._resource = resource

    def outputs(self, groups: Sequence[Group]) -> list[str]:
        """What FORTE prints of every case's result, where it has arrived at an input of its type."""
        client, resource = self._client, self._resource
        client.create_block("", resource, "EMB_RES")
        client.create_block(resource, COUNTER, "E_CTU")
        ends = []
        for number, group in enumerate(groups):
            sink, port = _SINKS.get(group.kind.name, (f"{group.kind.name}2{group.kind.name}", "IN"))
            client.create_block(resource, f"B{number}", group.cases[0].type_name)
            client.create_block(resource, f"S{number}", sink)
            client.connect(resource, f"B{number}.CNF", f"S{number}.REQ")
            client.connect(resource, f"S{number}.CNF", f"{COUNTER}.CU")
            client.connect(resource, f"B{number}.OUT", f"S{number}.{port}")
            self._give(number, group.cases[0])
            ends.append(f"S{number}.{port}")
        client.start(resource)
        answers, count = [], 0
        for number, group in enumerate(groups):
            for case in group.cases:
                self._give(number, case)
                client.trigger(resource, f"B{number}.REQ")
                count += 1
                until(self._counted(count), f"{case} is answered")
                answers.append(client.read(resource, ends[number]))
        client.stop(resource)
        return answers

    def _give(self, number: int, case: Case) -> None:
        for name, literal in case.literals.items():
            self._client.write(self._resource, f"B{number}.{name}", literal)

    def _counted(self, count: int) -> Callable[[], bool]:
        return lambda: int(self._client.read(self._resource, f"{COUNTER}.CV")) >= count


def computed(cases: Sequence[Case]) -> Group:
    """Cases of one block and the same types with what the embedded runtime computes."""
    types = tuple(cases[0].types.items())
    block = model.Block("B", cases[0].type_name, types=types)
    resource = Resource(model.FBNetwork((block,)), Library())
    kind = resource.variable_type("B.OUT")
    assert isinstance(kind, ElementaryType)
    expected = []
    for case in cases:
        for name, given in types:
            resource.write(f"B.{name}", model.literal(case.literals[name], given))
        resource.trigger("B.REQ")
        resource.run_until_idle()
        expected.append(printed(resource.read("B.OUT"), kind))
    return Group(tuple(cases), tuple(expected), kind)


def printed(value: Any, kind: ElementaryType) -> str:
    """A value as FORTE prints it when it is read: bytes of a STRING as characters of Latin-1."""
    match kind.kind:
        case "bool":
            return "TRUE" if value else "FALSE"
        case "real":
            return format(value, ".15g" if kind.bits == 64 else "g")
        case "string":
            return str(value)
        case "time":
            whole, part = divmod(abs(value) // 1000, 1000)
            sign = "-" if value < 0 and whole + part else ""
            return f"T#{sign}{whole}{f'.{part:03d}' if part else ''}ms"
        case "date":
            whole, _, part = format_date(value, kind.name).partition(".")
            return whole if kind.name == "DATE" else f"{whole}.{part:0<3}"
    return str(value)


def same(printed_by_forte: str, expected: str) -> bool:
    """Whether FORTE has printed the value; it gives a NaN a sign, and parts of a ms below 0 another form."""
    if printed_by_forte == expected or printed_by_forte.lstrip("-") == expected == "nan":
        return True
    plain, parts = re.subn(r"\.0*-(\d+)", lambda part: f".{part[1]:0>3}", printed_by_forte)
    return parts > 0 and plain.replace("-", "") == expected.replace("-", "")
