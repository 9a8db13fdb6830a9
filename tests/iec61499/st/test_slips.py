"""What beginners write, and people who know another language: refused with place and what is meant instead."""

from __future__ import annotations

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.types import INT, ArrayType, DataType
from tests.support.iec61499.st_harness import check

TYPES: dict[str, str | DataType] = {
    "X": "LREAL",
    "I": "INT",
    "U": "USINT",
    "B": "BOOL",
    "S": "STRING",
    "T": "TIME",
    "W": "WORD",
    "TD": "TOD",
    "A": ArrayType(INT, 0, 2),
    "C": ArrayType(INT, 1, 3),
}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("I = 5;", "1:3: unexpected '=': expected := to assign"),
        ("IF B THEN I = 5; END_IF;", "1:13: unexpected '=': expected := to assign"),
        ("IF I == 5 THEN I := 1; END_IF;", "1:7: unexpected '==': expected = to compare"),
        ("B := I != 5;", "1:8: unexpected '!=': expected <>"),
        ("B := B && B;", "unexpected '&&': expected AND"),
        ("B := B || B;", "unexpected '||': expected OR"),
        ("B := !B;", "1:6: unexpected '!': expected NOT"),
        ("I += 1;", "unexpected '+=': expected X := X + ..."),
        ("I++;", "unexpected '++': expected X := X + 1"),
        ("I := ROUND(X);", "1:6: unknown function ROUND: expected LREAL_TO_DINT or another conversion, which rounds"),
        ("X := POW(X, 2);", "unknown function POW: expected EXPT, or **"),
        ("X := LOG10(X);", "unknown function LOG10: expected LOG"),
        ("I := TIME_TO_INT(T);", "unknown function TIME_TO_INT: expected TIME_IN_S_TO_INT, or of MS, US or NS"),
        ("T := INT_TO_TIME(I);", "expected a product with a unit, such as T#1ms * N"),
        ("I := INT_TO_INT(I);", "expected the INT as it is"),
        ("B := 2;", "1:6: 2 is out of range: expected BOOL 0 to 1"),
        ("W := -1;", "1:6: -1 is out of range: expected WORD 0 to 65535"),
        ("W := 16#1FFFF;", "131071 is out of range: expected WORD 0 to 65535"),
        ("FOR U := 3 TO 0 BY -1 DO I := 1; END_FOR;", "1:20: -1 is out of range: expected USINT 0 to 255"),
        ("A := C;", "got ARRAY [1..3] OF INT, expected ARRAY [0..2] OF INT"),
        ("TD := TOD#24:00:00;", "1:7: 'TOD#24:00:00' is not a TOD: expected"),
        ("T := T / T;", "/ expects ANY_NUM, got TIME"),
        ("S := 'it's';", "1:10: unexpected 's'"),
    ],
)
def test_what_is_meant_is_said(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        check(text, **TYPES)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "text", ["B := I = 5;", "B := (I = 5) = B;", "IF B AND I = 5 THEN I := 6; END_IF;", "B := I >= 5;"]
)
def test_what_is_right_is_taken(text: str) -> None:
    check(text, **TYPES)
