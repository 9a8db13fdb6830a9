"""Where the standard blocks of 4diac FORTE 2.0 depart from IEC 61131-3 and IEC 61499-1.

The table of docs/blocks.md is `table()`. Structured Text is not concerned: FORTE gets it as Lua, which computes as
the embedded runtime does.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

from iec61499 import model
from iec61499.departures import uses
from iec61499.departures.uses import Use
from iec61499.errors import FunctionBlockError
from iec61499.runtime.linking.generic_ports import variable_at
from iec61499.runtime.linking.netlist import Netlist, Terminal
from iec61499.types import DataType


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
        uses.integer_with_real,
    ),
    Departure(
        "F_DIV, F_MOD, F_ABS, F_GT, F_GE, F_LE, F_LT, F_MAX, F_MIN, F_LIMIT",
        "ULINT or LWORD from 2^63 on",
        "computed as unsigned numbers",
        "computed as LINT: such numbers are negative",
        _AS_STANDARD,
        "F_(DIV|MOD|ABS|GT|GE|LE|LT|MAX|MIN|LIMIT)",
        uses.has_large,
    ),
    Departure(
        "F_GT, F_GE, F_LE, F_LT, F_MAX, F_MIN, F_LIMIT",
        "STRING or WSTRING",
        "compared character by character",
        "OUT stays as it was; the log says that it is not supported",
        _AS_STANDARD,
        "F_(GT|GE|LE|LT|MAX|MIN|LIMIT)",
        uses.has_texts,
    ),
    Departure(
        "F_GT, F_GE, F_EQ, F_LE, F_LT, F_NE, F_MAX, F_MIN, F_SEL, F_LIMIT",
        "dates and times of day",
        "compared, or passed on",
        "both inputs count as 0",
        _AS_STANDARD,
        "F_(GT|GE|EQ|LE|LT|NE|MAX|MIN|SEL|LIMIT)",
        uses.has_dates,
    ),
    Departure(
        "F_LEN, F_LEFT, F_RIGHT, F_MID, F_INSERT, F_DELETE, F_REPLACE, F_FIND",
        "a WSTRING with characters beyond ASCII",
        "counted in characters",
        "counted in bytes of UTF-8",
        _AS_STANDARD,
        "F_(LEN|LEFT|RIGHT|MID|INSERT|DELETE|REPLACE|FIND)",
        uses.has_wide_texts,
    ),
    Departure(
        "F_MID",
        "P below 1 or behind the end, L below 0",
        "not defined",
        "the first L characters, or all from P on",
        "the text as it was, or none",
        "F_MID",
        uses.may_begin_outside,
    ),
    Departure(
        "F_DELETE, F_REPLACE",
        "P below 1, L below 0, or up to the last character",
        "the characters deleted or replaced; otherwise not defined",
        "the text as it was, or a part of it twice",
        "as the standard, otherwise the text as it was",
        "F_(DELETE|REPLACE)",
        uses.may_reach_an_end,
    ),
    Departure(
        "XOR_3 and larger",
        "BOOL",
        "TRUE for an odd number of TRUE",
        "TRUE for a single TRUE",
        _AS_STANDARD,
        r"XOR_([3-9]|[1-9]\d+)",
        uses.has_truths,
    ),
    Departure(
        "F_DIVTIME",
        "by 0",
        "an error",
        "the duration itself",
        "0, as for other integers",
        "F_DIVTIME",
        uses.divisor_may_be_zero,
    ),
    Departure(
        "F_DIV, F_MOD",
        "an integer by 0",
        "an error",
        "0",
        _AS_FORTE,
        "F_(DIV|MOD)",
        uses.divides_by_zero,
    ),
    Departure(
        "F_ADD_TOD_TIME, F_SUB_TOD_TIME",
        "beyond midnight",
        "not defined",
        "counted on: 24:00:01; before 0:00 what 2^64 ms less are",
        "goes on from midnight",
        "F_(ADD|SUB)_TOD_TIME",
        uses.always,
    ),
    Departure(
        "F_REAL_TO_INT and the other conversions of REAL to integers",
        "from 2^22 on",
        "exact",
        "until September 2024 one off for some, as 0.5 is added as a REAL",
        _AS_STANDARD,
        "F_REAL_TO_U?[SDL]?INT",
        uses.may_be_large,
    ),
    Departure(
        "F_MOVE",
        "texts, dates, arrays and structures",
        "copied",
        "OUT stays as it was",
        _AS_STANDARD,
        "F_MOVE",
        uses.is_not_copied,
    ),
    Departure(
        "F_SHL, F_SHR",
        "by 32 and more (LWORD: 64)",
        "0",
        "shifted by N modulo 32 (LWORD: 64) on x86",
        _AS_STANDARD,
        "F_SH[LR]",
        uses.may_shift_all,
    ),
    Departure(
        "F_ROL, F_ROR",
        "by more than the type has bits",
        "rotated by N modulo the bits",
        "bits are lost",
        _AS_STANDARD,
        "F_RO[LR]",
        uses.may_rotate_all,
    ),
    Departure(
        "F_MUX_2",
        "K below 0 or above 1",
        "not defined",
        "no CNF when K is signed; what is behind the inputs when it is not, which may end FORTE",
        "the first or the last input",
        "F_MUX_2",
        uses.may_miss,
    ),
    Departure(
        "F_MUX_3 and larger",
        "any",
        "input K",
        "another block: one event for each input, and no K",
        _AS_STANDARD,
        r"F_MUX_([3-9]|[1-9]\d+)",
        uses.always,
    ),
    Departure(
        "F_MULTIME, F_DIVTIME",
        "by REAL or LREAL",
        "the duration times or by the number",
        "the lowest 16 bits of the number's pattern are taken for an INT: times 2.0 is 0",
        _AS_STANDARD,
        "F_(MUL|DIV)TIME",
        uses.has_reals,
    ),
    Departure(
        "F_DIVTIME",
        "a duration below 0 by ULINT",
        "the duration by the number",
        "computed without signs",
        _AS_STANDARD,
        "F_DIVTIME",
        uses.has_large,
    ),
    Departure(
        "F_DIV, F_MOD",
        "the smallest LINT by -1",
        "not defined",
        "ends FORTE on x86",
        "the smallest LINT, remainder 0",
        "F_(DIV|MOD)",
        uses.may_overflow,
    ),
    Departure(
        "F_DIV",
        "a REAL or LREAL by 0",
        "an infinity or NaN (IEC 60559)",
        "0",
        _AS_STANDARD,
        "F_DIV",
        uses.may_divide_by_zero,
    ),
    Departure(
        "F_REAL_TO_INT and the other conversions of reals to integers",
        "halfway between two integers",
        "the even one (IEC 60559)",
        "until September 2024 the one further from 0, also for 0.49999999999999994",
        _AS_STANDARD,
        "F_L?REAL_TO_U?[SDL]?INT",
        uses.always,
    ),
    Departure(
        "F_TIME_TO_STRING, F_TIME_TO_WSTRING",
        "any duration",
        "a literal such as T#3s",
        "always ms: T#3000ms",
        _AS_FORTE,
        "F_TIME_TO_W?STRING",
        uses.always,
    ),
    Departure(
        "F_STRING_TO_INT and the other conversions of texts to integers",
        "a text that is no literal, or out of range",
        "an error",
        "the number that it begins with, 0 when that is out of range",
        _AS_FORTE,
        "F_W?STRING_TO_(U?[SDL]?INT|BYTE|[DL]?WORD)",
        uses.always,
    ),
    Departure(
        "E_RDELAY, E_RTimeOut",
        "START while it waits",
        "EO comes DT after the last START",
        "EO comes at once, within two ticks; other timers that wait may be lost",
        _AS_STANDARD,
        "E_R(DELAY|TimeOut)",
        uses.always,
    ),
    Departure(
        "FB_TP",
        "asked after PT",
        "Q is FALSE and ET stays at PT; an edge of IN after PT begins another pulse",
        "Q is TRUE and ET beyond PT until the REQ after that; an edge that comes before is lost",
        _AS_STANDARD,
        "FB_TP",
        uses.always,
    ),
    Departure(
        "FB_TON, FB_TOF, FB_TP",
        "PT is 0",
        "Q follows IN at once; no pulse",
        "Q changes with the REQ after the edge, for FB_TP with the next one, too",
        _AS_STANDARD,
        "FB_T(ON|OF|P)",
        uses.may_have_no_time,
    ),
    Departure(
        "E_TRAIN",
        "N is 0",
        "no event",
        "one event",
        _AS_STANDARD,
        "E_TRAIN",
        uses.may_have_none,
    ),
    Departure(
        "E_DELAY, E_RDELAY, E_CYCLE",
        "DT below 1 ms",
        "EO comes DT later",
        "EO comes with the next tick, 1 ms later",
        _AS_FORTE,
        "E_(R?DELAY|CYCLE)",
        uses.may_be_shorter_than_a_tick,
    ),
    Departure(
        "E_RESTART",
        "START of a resource after STOP, or after KILL and RESET",
        "WARM after STOP, COLD after RESET, and events are delivered again",
        "FORTE 2.0 answers OK, but delivers neither WARM, COLD nor any other event, and leaves a second STOP without "
        "an answer: end its process, or delete and build the resource anew",
        _AS_STANDARD,
        "E_RESTART",
        uses.never,
    ),
    Departure(
        "any block",
        "read after KILL or RESET of its resource",
        "not defined after KILL; initial values after RESET",
        "FORTE 2.0 keeps the last values of outputs and counters after both",
        "initial values after both",
        ".*",
        uses.never,
    ),
)
"""The table; a use may fall under several rows."""


def departures(netlist: Netlist) -> Iterator[FunctionBlockError]:
    """A warning for every block that may compute something else on FORTE, with the file and line that place it.

    Args:
        netlist: a network that lies flat, with types at its generic ports.
    """
    for number, node in netlist.nodes.items():
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
