"""Where the standard blocks of 4diac FORTE 2.0 depart from IEC 61131-3 and IEC 61499-1.

The table of fb/README.md is `table()`. Structured Text is not concerned: FORTE gets it as Lua, which computes as the
embedded runtime does.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Final

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.literals import parse_duration
from dtwin.iec61499.runtime.generic_ports import variable_at
from dtwin.iec61499.runtime.netlist import Netlist, Terminal
from dtwin.iec61499.types import DataType, ElementaryType

_TICK: Final = 1_000_000
"""Shortest delay of FORTE's timers, ns."""


@dataclass(frozen=True, slots=True)
class Use:
    """A block in a network.

    Attributes:
        types: the type of what comes to every data input, by the input's name.
        literals: the literals at inputs that nothing is connected to.
    """

    type_name: str
    types: Mapping[str, DataType | model.GenericType]
    literals: Mapping[str, str]

    def has(self, *kinds: str) -> bool:
        """Whether something of these kinds comes to an input."""
        return any(_kind(data_type) in kinds for data_type in self.types.values())


@dataclass(frozen=True, slots=True)
class Departure:
    """A row of the table.

    Attributes:
        blocks: the names of the block types, for readers.
        case: when FORTE departs.
        standard: what the standard says.
        forte: what FORTE does.
        here: what the embedded runtime does.
        names: a regular expression for the names of the block types.
        applies: whether the case can occur with a use.
    """

    blocks: str
    case: str
    standard: str
    forte: str
    here: str
    names: str
    applies: Callable[[Use], bool]


def _kind(data_type: DataType | model.GenericType) -> str:
    return data_type.kind if isinstance(data_type, ElementaryType) else ""


def _always(use: Use) -> bool:
    return True


def _integer_with_real(use: Use) -> bool:
    first = use.types.get("IN0" if use.type_name == "F_SEL" else "IN" if use.type_name == "F_LIMIT" else "IN1")
    return first is not None and _kind(first) in ("signed", "unsigned") and use.has("real")


def _has_texts(use: Use) -> bool:
    return use.has("string")


def _has_dates(use: Use) -> bool:
    return use.has("date")


def _has_reals(use: Use) -> bool:
    return use.has("real")


def _has_large(use: Use) -> bool:
    return any(isinstance(found, ElementaryType) and found.name in ("ULINT", "LWORD") for found in use.types.values())


def _is_not_copied(use: Use) -> bool:
    return _kind(use.types["IN"]) not in ("bool", "signed", "unsigned", "bits", "real", "time")


def _may_shift_all(use: Use) -> bool:
    """Whether the count is a variable, or not below 32 (LWORD: 64)."""
    data_type = use.types["IN"]
    bits = 64 if isinstance(data_type, ElementaryType) and data_type.bits == 64 else 32
    return not 0 <= _number(use, "N") < bits


def _may_rotate_all(use: Use) -> bool:
    data_type = use.types["IN"]
    bits = data_type.bits if isinstance(data_type, ElementaryType) else 0
    return not 0 <= _number(use, "N") <= bits


def _may_divide_by_zero(use: Use) -> bool:
    literal = use.literals.get("IN2", "0").rpartition("#")[2]
    try:
        return use.has("real") and float(literal) == 0
    except ValueError:
        return use.has("real")


def _may_be_shorter_than_a_tick(use: Use) -> bool:
    literal = use.literals.get("DT")
    duration = parse_duration(literal.rpartition("#")[2]) if literal else None
    return duration is not None and duration < _TICK


def _number(use: Use, name: str) -> int:
    """The literal at an input, -1 if it has none that is a decimal number."""
    text = use.literals.get(name, "").rpartition("#")[2].strip()
    return int(text) if text.isdecimal() and len(text) < 10 else -1


_AS_STANDARD: Final = "as the standard"
_AS_FORTE: Final = "as FORTE"

DEPARTURES: Final = (
    Departure(
        "F_ADD, F_SUB, F_MUL, F_DIV, F_GT, F_GE, F_EQ, F_LE, F_LT, F_NE, F_MAX, F_MIN, F_SEL, F_LIMIT",
        "an integer at the first input (F_LIMIT: IN), a REAL or LREAL at another",
        "computed as real numbers",
        "the real is rounded to a LINT first: 1 + 1.6 is 3",
        _AS_STANDARD,
        "F_(ADD|SUB|MUL|DIV|GT|GE|EQ|LE|LT|NE|MAX|MIN|SEL|LIMIT)",
        _integer_with_real,
    ),
    Departure(
        "F_DIV, F_GT, F_GE, F_LE, F_LT, F_MAX, F_MIN, F_LIMIT",
        "ULINT or LWORD from 2^63 on",
        "computed as unsigned numbers",
        "computed as LINT: such numbers are negative",
        _AS_STANDARD,
        "F_(DIV|GT|GE|LE|LT|MAX|MIN|LIMIT)",
        _has_large,
    ),
    Departure(
        "F_GT, F_GE, F_LE, F_LT, F_MAX, F_MIN, F_LIMIT",
        "STRING or WSTRING",
        "compared character by character",
        "OUT stays as it was; the log says that it is not supported",
        _AS_STANDARD,
        "F_(GT|GE|LE|LT|MAX|MIN|LIMIT)",
        _has_texts,
    ),
    Departure(
        "F_GT, F_GE, F_EQ, F_LE, F_LT, F_NE, F_MAX, F_MIN, F_SEL, F_LIMIT",
        "dates and times of day",
        "compared, or passed on",
        "both inputs count as 0",
        _AS_STANDARD,
        "F_(GT|GE|EQ|LE|LT|NE|MAX|MIN|SEL|LIMIT)",
        _has_dates,
    ),
    Departure(
        "F_MOVE",
        "texts, dates, arrays and structures",
        "copied",
        "OUT stays as it was",
        _AS_STANDARD,
        "F_MOVE",
        _is_not_copied,
    ),
    Departure(
        "F_SHL, F_SHR",
        "by 32 and more (LWORD: 64)",
        "0",
        "shifted by N modulo 32 (LWORD: 64) on x86",
        _AS_STANDARD,
        "F_SH[LR]",
        _may_shift_all,
    ),
    Departure(
        "F_ROL, F_ROR",
        "by more than the type has bits",
        "rotated by N modulo the bits",
        "bits are lost",
        _AS_STANDARD,
        "F_RO[LR]",
        _may_rotate_all,
    ),
    Departure(
        "F_MULTIME, F_DIVTIME",
        "by REAL or LREAL",
        "the duration times or by the number",
        "the lowest 16 bits of the number's pattern are taken for an INT: times 2.0 is 0",
        _AS_STANDARD,
        "F_(MUL|DIV)TIME",
        _has_reals,
    ),
    Departure(
        "F_DIV",
        "a REAL or LREAL by 0",
        "an infinity or NaN (IEC 60559)",
        "0",
        _AS_STANDARD,
        "F_DIV",
        _may_divide_by_zero,
    ),
    Departure(
        "F_REAL_TO_INT and the other conversions of reals to integers",
        "halfway between two integers",
        "the even one (IEC 60559)",
        "the one further from 0",
        _AS_FORTE,
        "F_L?REAL_TO_U?[SDL]?INT",
        _always,
    ),
    Departure(
        "F_TIME_TO_STRING, F_TIME_TO_WSTRING",
        "any duration",
        "a literal such as T#3s",
        "always ms: T#3000ms",
        _AS_FORTE,
        "F_TIME_TO_W?STRING",
        _always,
    ),
    Departure(
        "F_STRING_TO_INT and the other conversions of texts to integers",
        "a text that is no literal, or out of range",
        "an error",
        "the number that it begins with, 0 when that is out of range",
        _AS_FORTE,
        "F_W?STRING_TO_(U?[SDL]?INT|BYTE|[DL]?WORD)",
        _always,
    ),
    Departure(
        "E_RDELAY, E_RTimeOut",
        "START while it waits",
        "EO comes DT after the last START",
        "EO comes at once, within two ticks; other timers that wait may be lost",
        _AS_STANDARD,
        "E_R(DELAY|TimeOut)",
        _always,
    ),
    Departure(
        "E_DELAY, E_RDELAY, E_CYCLE",
        "DT below 1 ms",
        "EO comes DT later",
        "EO comes with the next tick, 1 ms later",
        _AS_FORTE,
        "E_(R?DELAY|CYCLE)",
        _may_be_shorter_than_a_tick,
    ),
)
"""The table; a use may fall under several rows."""


def departures(netlist: Netlist) -> Iterator[FunctionBlockError]:
    """A warning for every block that may compute something else on FORTE, with the file and line that place it.

    Args:
        netlist: a network that lies flat, with types at its generic ports.
    """
    for number, node in enumerate(netlist.nodes):
        if node.type is None or not node.file:
            continue
        types: dict[str, DataType | model.GenericType] = {}
        for variable in node.interface.inputs:
            wire = netlist.data.get(Terminal(number, variable.name))
            source = wire and variable_at(netlist.nodes[wire.source.node], wire.source.name)
            types[variable.name] = source.type if source else variable.type
        literals = {name: parameter.value for name, parameter in node.parameters.items()}
        use = Use(node.type.header.name, types, literals)
        for row in DEPARTURES:
            if re.fullmatch(row.names, use.type_name) and row.applies(use):
                yield FunctionBlockError(
                    f"warning: {node.name} is a {use.type_name}: {row.case}: {row.forte}; "
                    f"expected by the standard: {row.standard}",
                    node.file,
                    node.line,
                )


def table() -> str:
    """The rows as a table in Markdown."""
    rows = [("block", "case", "standard", "4diac FORTE", "`fb run`"), ("---",) * 5]
    rows += [(row.blocks, row.case, row.standard, row.forte, row.here) for row in DEPARTURES]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
