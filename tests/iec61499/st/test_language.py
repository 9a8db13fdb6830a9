"""Structured Text as 4diac IDE takes it: parts of bit strings, named arguments, comments, constants, dates."""

from __future__ import annotations

from typing import Any

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.types import INT, ArrayType
from tests.support.iec61499.st_harness import LUA, check, run_lua, run_python, scope_of

TYPES: dict[str, Any] = {
    "W": "WORD",
    "B": "BYTE",
    "D": "DWORD",
    "X": "BOOL",
    "I": "INT",
    "J": "DINT",
    "R": "LREAL",
    "S": "STRING",
    "T": "TIME",
    "A": ArrayType(ArrayType(INT, 0, 2), 0, 1),
    "N": "UINT",
}
IN_LUA = [
    ("W.%X3 := TRUE; X := W.%X3;", {"W": 8, "X": True}),
    ("W.3 := TRUE; X := W.%3;", {"W": 8, "X": True}),
    ("W := 16#FFFF; W.%X15 := FALSE;", {"W": 0x7FFF}),
    ("D := 16#12345678; B := D.%B1; W := D.%W1; D.%B0 := 16#AA;", {"B": 0x56, "W": 0x1234, "D": 0x123456AA}),
    ("W.%B1 := BYTE#16#7F; W.%X0 := W.%X8 AND NOT X;", {"W": 0x7F01}),
    ("J := LIMIT(MX := 5, IN := 9, MN := 1);", {"J": 5}),
    ("J := SEL(G := TRUE, IN1 := 2, IN0 := 1);", {"J": 2}),
    ("S := MID(P := 2, L := 3, IN := 'abcdef');", {"S": "bcd"}),
    ("J := MAX(IN1 := 3, IN2 := 4);", {"J": 4}),
    ("(* outer (* inner *) still *) I := 1; /* a */ {pragma 'x'} J := 2; // end (*", {"I": 1, "J": 2}),
    ("S := '(* no comment *) // {';", {"S": "(* no comment *) // {"}),
    ("VAR CONSTANT FIRST: INT := 4; END_VAR I := 4; CASE I OF FIRST: J := 1; ELSE J := 2; END_CASE;", {"J": 1}),
    ("VAR M: ARRAY [0..1, 0..2] OF INT := [1, 2, 3, 2(9)]; END_VAR A := M;", {"A": [[1, 2, 3], [9, 9, 0]]}),
    ("VAR M: ARRAY [0..1, 0..2] OF INT := [[1, 2], [3]]; END_VAR A := M;", {"A": [[1, 2, 0], [3, 0, 0]]}),
    ("VAR Q: STRING[3]; END_VAR Q := 'abcdef'; S := CONCAT(Q, 'x');", {"S": "abcx"}),
    ("R := TO_LREAL(INT#7); I := TO_INT(LREAL#2.5); J := TO_DINT(BYTE#16#FF);", {"R": 7.0, "I": 2, "J": 255}),
    ("IF X THEN I := 1; ELSE I := 2; END_IF", {"I": 2}),
    ("R := J := I := 4 + 1; I := 2;", {"R": 5.0, "J": 5, "I": 2}),
    ("D := 1; D := D - 2; W := 16#FFFF; W := W + 1;", {"D": 0xFFFFFFFF, "W": 0}),
]
IN_PYTHON = [
    ("I := 7; J := 3; I := I ** 2; J := J ** 5;", {"I": 49, "J": 243}),
    ("I := 200; I := I ** 3;", {"I": 200**3 % 65536}),
    ("I := -1; I := I ** -3; J := 2; J := J ** -1;", {"I": -1, "J": 0}),
    ("T := DIV_TIME(T#10s, 4); R := TIME_IN_S_TO_LREAL(T);", {"T": 2_500_000_000, "R": 2.5}),
    ("T := DT#2024-03-01-00:00:00 - DT#2024-02-28-12:00:00;", {"T": 36 * 3600 * 10**9}),
    ("X := D#2024-02-29 < D#2024-03-01;", {"X": True}),
    ("T := DT_TO_TOD(DT#2024-03-01-01:02:03.5) - TOD#01:02:03;", {"T": 500_000_000}),
    ("X := CONCAT_DATE_TOD(D#2024-03-01, TOD#12:00:00) = DT#2024-03-01-12:00:00;", {"X": True}),
    ("VAR C: CHAR; END_VAR C := 'q'; S := CHAR_TO_STRING(C); B := CHAR_TO_BYTE(C);", {"S": "q", "B": 113}),
    ("B := USINT_TO_BCD_BYTE(42); N := BYTE_BCD_TO_USINT(BYTE#16#99);", {"B": 0x42, "N": 99}),
    ("I := STRING_AS_INT('12'); S := INT_AS_STRING(INT#5);", {"I": 12, "S": "5"}),
]


@pytest.mark.parametrize(("text", "expected"), [*IN_LUA, *IN_PYTHON])
def test_python(text: str, expected: dict[str, Any]) -> None:
    state = run_python(check(text, **TYPES), scope_of(TYPES), {})
    assert {name: state[name] for name in expected} == expected


@pytest.mark.parametrize(("text", "expected"), IN_LUA)
def test_lua(text: str, expected: dict[str, Any]) -> None:
    for interpreter in LUA:
        scope = {name: kind for name, kind in scope_of(TYPES).items() if name != "T"}
        state = run_lua(check(text, **TYPES), scope, {}, interpreter)
        assert {name: state[name] for name in expected} == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("X := B.16#1;", "1:8: unexpected '16#1': expected a part such as %X0"),
        ("X := B.%X8;", "1:8: %X8 of BYTE: expected %X0 to %X7"),
        ("X := I.%X1;", "%X1 of INT: expected a part of a longer bit string"),
        ("B := B.%W0;", "%W0 of BYTE"),
        ("I := I.M;", "I is a INT here and has no member M"),
        ("I := LIMIT(MN := 1, IN := 2);", "LIMIT got the arguments MN, IN: expected MN, IN, MX"),
        ("I := MAX(IN1 := 1, 2);", "MAX got the arguments IN1, one without a name: expected IN1, IN2"),
        ("\n  (* (* *)", "2:3: comment is not closed: expected *)"),
        ("CASE J OF I: I := 1; END_CASE;", "expected a constant"),
        ("S := CHAR#'ab';", "is not a CHAR: expected one character"),
        ("X := DT#2024-02-30-00:00:00 = DT#2024-01-01-00:00:00;", "is not a DT"),
    ],
)
def test_errors(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        check(text, **TYPES)
    assert message in str(caught.value)
