"""What Structured Text does where IEC 61131-3 (edition 3) leaves a case open or calls it an error.

Python, C and Lua do the same, and so does a 4diac FORTE, which gets algorithms as Lua or C. The table of
docs/blocks.md is `table()`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True, slots=True)
class Rule:
    """A row of the table.

    Attributes:
        case: what a program does.
        standard: what the standard says, and where.
        here: what comes of it.
        examples: expressions that are TRUE.
    """

    case: str
    standard: str
    here: str
    examples: tuple[str, ...]


_STRINGS: Final = "an error (table 34)"
_SHIFTS: Final = "an error below 0 (table 30)"

RULES: Final = (
    Rule(
        "an integer or TIME divided by 0, or by a real 0",
        "an error (7.3.2)",
        "0",
        ("INT#7 / INT#0 = 0", "T#7ms / INT#0 = T#0s", "T#7ms / LREAL#0.0 = T#0s", "INT#0 ** INT#-1 = 0"),
    ),
    Rule(
        "MOD",
        "0 by 0, otherwise what truncating division leaves (table 29)",
        "as the standard: the sign of the first one",
        ("INT#7 MOD INT#0 = 0", "INT#-7 MOD INT#2 = -1", "INT#7 MOD INT#-2 = 1"),
    ),
    Rule(
        "a real divided by 0",
        "an infinity or NaN (IEC 60559)",
        "as the standard",
        ("LREAL#1.0 / LREAL#0.0 > LREAL#1.0E308", "NOT (LREAL#0.0 / LREAL#0.0 = LREAL#0.0)"),
    ),
    Rule(
        "integers, TIME and dates beyond their range",
        "an error (7.3.2)",
        "modulo 2^bits after every operation, also of a number beside a TIME",
        ("INT#32767 + INT#1 = -32768", "ABS(SINT#-128) = -128", "T#1us * (INT#32767 + INT#1) = T#-32768us"),
    ),
    Rule(
        "reals to integers",
        "the nearest one, of two the even one (table 22, IEC 60559); beyond the range an error",
        "as the standard; beyond 64 bit, and of NaN, -2^63; then modulo 2^bits",
        (
            "LREAL_TO_INT(2.5) = 2",
            "LREAL_TO_INT(-3.5) = -4",
            "LREAL_TO_INT(0.49999999999999994) = 0",
            "LREAL_TO_INT(1.0E30) = 0",
            "LREAL_TO_SINT(130.0) = -126",
        ),
    ),
    Rule(
        "SHL, SHR, ROL, ROR by less than 0",
        _SHIFTS,
        "0",
        ("SHL(BYTE#16#81, INT#-1) = BYTE#0", "SHR(BYTE#16#81, INT#-1) = BYTE#0", "ROL(BYTE#16#81, INT#-1) = BYTE#0"),
    ),
    Rule(
        "SHL, SHR by the bits or more; ROL, ROR by more",
        "zeros come in; bits go round (table 30)",
        "as the standard: 0; by N modulo the bits",
        (
            "SHL(BYTE#16#81, INT#8) = BYTE#0",
            "ROL(BYTE#16#81, INT#9) = BYTE#3",
            "ROR(BYTE#16#81, INT#17) = BYTE#16#C0",
        ),
    ),
    Rule(
        "LEFT, RIGHT of less than 0 characters, or of more than there are",
        _STRINGS,
        "the whole text",
        ("LEFT('abc', INT#-1) = 'abc'", "RIGHT('abc', INT#-1) = 'abc'", "RIGHT('abc', INT#9) = 'abc'"),
    ),
    Rule(
        "MID",
        _STRINGS,
        "the characters that are there; the whole text for less than 0 characters, or from before the first",
        ("MID('abc', INT#9, INT#2) = 'bc'", "MID('abc', INT#1, INT#4) = ''", "MID('abc', INT#1, INT#0) = 'abc'"),
    ),
    Rule(
        "INSERT, DELETE, REPLACE where characters are missing",
        _STRINGS,
        "the text as it was",
        (
            "INSERT('abc', 'x', INT#4) = 'abc'",
            "DELETE('abc', INT#2, INT#3) = 'abc'",
            "DELETE('abc', INT#1, INT#3) = 'ab'",
            "REPLACE('abc', 'x', INT#-1, INT#1) = 'abc'",
        ),
    ),
    Rule(
        "FIND of what is not there, or of nothing",
        "0 when it is not there (table 34)",
        "0; 1 for nothing",
        ("FIND('abc', 'x') = 0", "FIND('abc', '') = 1"),
    ),
    Rule(
        "TOD and a TIME beyond midnight",
        "not said (table 35)",
        "goes on from midnight",
        ("TOD#23:59:59 + T#2s = TOD#00:00:01", "TOD#00:00:01 - T#2s = TOD#23:59:59"),
    ),
    Rule(
        "TOD minus TOD, DATE plus TIME",
        "a TIME; not said (table 35)",
        "a TIME, which may be below 0; the day",
        ("TOD#00:00:01 - TOD#00:00:03 = T#-2s", "D#2024-02-28 + T#36h = D#2024-02-29"),
    ),
    Rule(
        "MUX beyond its inputs",
        "an error (table 32)",
        "the first or the last one",
        ("MUX(INT#-1, INT#4, INT#5) = 4", "MUX(INT#9, INT#4, INT#5) = 5"),
    ),
    Rule(
        "MIN, MAX, LIMIT of NaN",
        "not said (table 32)",
        "MIN(a, b) is b unless a is smaller, MAX(a, b) b unless a is greater; LIMIT is MIN(MAX(IN, MN), MX)",
        ("MIN(LREAL#0.0 / LREAL#0.0, LREAL#1.0) = 1.0", "LIMIT(INT#5, INT#3, INT#1) = 1"),
    ),
    Rule(
        "operands that AND, OR and SEL do not need",
        "may be left out in Boolean expressions (7.3.2)",
        "left out, so that they end nothing; MUX computes all",
        ("NOT (FALSE AND INT#1 / INT#0 = INT#1)",),
    ),
)
"""The table. An index or a character that is not there, BY 0 and a loop without end are errors in either."""


def table() -> str:
    """The rows as a table in Markdown."""
    rows = [("case", "standard", "Python, C, Lua, FORTE", "for example"), ("---",) * 4]
    rows += [
        (rule.case, rule.standard, rule.here, ", ".join(f"`{example}`" for example in rule.examples))
        for rule in RULES
    ]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in rows)
