"""What algorithms compute: each case on Python, its exact version, and three Lua interpreters."""

from __future__ import annotations

import math
import struct
from typing import Any

import pytest

from dtwin.errors import FunctionBlockError
from tests.support.iec61499.st_cases import TYPES, inf, nan, results
from tests.support.iec61499.st_harness import check, same

STATEMENTS = [
    ("X := 1; Y := X + 0.5;", {"X": 1.0, "Y": 1.5}),
    (";;;", {}),
    ("IF I > 0 THEN J := 1; ELSIF I = 0 THEN J := 2; ELSE J := 3; END_IF;", {"J": 2}),
    ("IF I > 0 THEN J := 1; END_IF;", {"J": 0}),
    ("I := 7; CASE I OF 1: J := 1; 5..8, 10: J := 2; ELSE J := 3; END_CASE;", {"J": 2}),
    ("I := -4; CASE I OF -4: J := 1; ELSE J := 3; END_CASE;", {"J": 1}),
    ("CASE I + 1 OF 2: J := 1; ELSE J := 3; END_CASE;", {"J": 3}),
    ("CASE I OF ELSE J := 3; END_CASE;", {"J": 3}),
    ("FOR I := 1 TO 4 DO J := J + I; END_FOR;", {"I": 5, "J": 10}),
    ("FOR I := 4 TO 1 BY -1 DO J := 10 * J + I; END_FOR;", {"I": 0, "J": 4321}),
    ("FOR I := 1 TO 6 BY 2 DO J := J + 1; END_FOR;", {"I": 7, "J": 3}),
    ("FOR I := 5 TO 1 DO J := 1; END_FOR;", {"I": 5, "J": 0}),
    ("K := -2; FOR I := 3 TO -3 BY K DO J := J + 1; END_FOR;", {"I": -5, "J": 4}),
    ("FOR N := 126 TO 127 DO J := J + 1; END_FOR;", {"N": -128, "J": 2}),
    ("FOR I := 1 TO 9 DO IF I = 3 THEN EXIT; END_IF; J := J + 1; END_FOR;", {"I": 3, "J": 2}),
    ("FOR I := 1 TO 4 DO IF I = 3 THEN CONTINUE; END_IF; J := J + I; END_FOR;", {"I": 5, "J": 7}),
    ("FOR I := 1 TO 3 DO FOR K := 1 TO I DO J := J + 1; END_FOR; END_FOR;", {"J": 6}),
    ("J := 3; FOR I := 1 TO J DO J := 0; END_FOR;", {"I": 4, "J": 0}),
    ("WHILE J < 5 DO J := J + 2; END_WHILE;", {"J": 6}),
    ("WHILE TRUE DO J := J + 1; IF J < 3 THEN CONTINUE; END_IF; EXIT; END_WHILE;", {"J": 3}),
    ("REPEAT J := J + 1; UNTIL J >= 3 END_REPEAT;", {"J": 3}),
    ("REPEAT J := J + 1; UNTIL TRUE END_REPEAT;", {"J": 1}),
    ("REPEAT J := J + 1; IF J < 9 THEN CONTINUE; END_IF; K := 1; UNTIL J > 4 END_REPEAT;", {"J": 5, "K": 0}),
    ("REPEAT J := J + 1; IF J = 2 THEN EXIT; ELSE CONTINUE; END_IF; UNTIL FALSE END_REPEAT;", {"J": 2}),
    ("J := 1; RETURN; J := 2;", {"J": 1}),
    ("FOR I := 1 TO 3 DO WHILE TRUE DO J := J + 1; IF J = 4 THEN RETURN; END_IF; EXIT; END_WHILE;"
     " IF I = 2 THEN RETURN; END_IF; END_FOR; J := 99;", {"I": 2, "J": 2}),
    ("WHILE TRUE DO J := J + 1; IF J = 2 THEN RETURN; END_IF; CONTINUE; END_WHILE; J := 9;", {"J": 2}),
    ("VAR v : DINT := 4; u : DINT; END_VAR u := u + 1; J := v + u;", {"J": 5}),
    ("VAR q : ARRAY [1..3] OF DINT := [7, 2(8)]; END_VAR J := q[1] + q[2] + q[3];", {"J": 23}),
    ("VAR end : DINT; nil : DINT; END_VAR end := 1; nil := end; J := nil;", {"J": 1}),
    ("A[-1] := 5; I := 2; A[I] := A[-1] + 1; X := A[2];", {"A": [5.0, 0.0, 0.0, 6.0], "X": 6.0}),
    ("FOR I := -1 TO 2 DO A[I] := I; END_FOR;", {"A": [-1.0, 0.0, 1.0, 2.0]}),
    ("M[1, 2] := 3; M[0][1] := M[1][2]; J := M[0, 1];", {"M": [[3, 0], [0, 3]], "J": 3}),
    ("VAR q : ARRAY [-1..2] OF LREAL; END_VAR A[0] := 1; q := A; q[0] := 2; X := A[0]; Y := q[0];",
     {"X": 1.0, "Y": 2.0}),
]  # fmt: skip


@pytest.mark.parametrize(("text", "expected"), STATEMENTS)
def test_statements(text: str, expected: dict[str, Any]) -> None:
    state = results(text, everywhere=True)
    assert {name: state[name] for name in expected} == expected


EXPRESSIONS: list[tuple[str, Any, dict[str, Any]]] = [
    # integers: truncation toward zero, sign of the dividend, wrapping, zero divisors as in FORTE
    ("J := I / K;", -3, {"I": -7, "K": 2}),
    ("J := I / K;", -3, {"I": 7, "K": -2}),
    ("J := I / 2;", -3, {"I": -7}),
    ("J := I MOD K;", -1, {"I": -7, "K": 2}),
    ("J := I MOD K;", 1, {"I": 7, "K": -2}),
    ("J := I / K;", 0, {"I": 5}),
    ("J := I MOD K;", 0, {"I": 5}),
    ("J := I / K;", -(2**31), {"I": -(2**31), "K": -1}),
    ("J := I + 1;", -(2**31), {"I": 2**31 - 1}),
    ("J := -I;", -(2**31), {"I": -(2**31)}),
    ("J := ABS(I);", -(2**31), {"I": -(2**31)}),
    ("J := I * I;", 1, {"I": 2**31 - 1}),
    ("J := (I + 1) / 2;", -(2**30), {"I": 2**31 - 1}),
    ("B := I + 1 > I;", False, {"I": 2**31 - 1}),
    ("X := I + 1;", -(2.0**31), {"I": 2**31 - 1}),
    ("P := P - 1;", 255, {}),
    ("N := N * 2;", -56, {"N": 100}),
    ("J := 1 / 2;", 0, {}),
    ("X := 1 / 2;", 0.0, {}),
    ("X := 1.0 / 2;", 0.5, {}),
    ("J := P + N;", 255 - 128, {"P": 255, "N": -128}),
    # reals
    ("X := Y / Z;", inf, {"Y": 1.0}),
    ("X := Y / Z;", -inf, {"Y": 1.0, "Z": -0.0}),
    ("X := Y / Z;", nan, {}),
    ("X := SQRT(Y);", nan, {"Y": -1.0}),
    ("X := LN(Y);", -inf, {}),
    ("X := LN(Y);", nan, {"Y": -1.0}),
    ("X := LOG(Y);", 3.0, {"Y": 1000.0}),
    ("X := EXP(Y);", inf, {"Y": 1000.0}),
    ("X := SIN(Y);", nan, {"Y": inf}),
    ("X := COS(Y) + TAN(Y);", nan, {"Y": -inf}),
    ("X := ASIN(Y);", nan, {"Y": 1.5}),
    ("X := ACOS(Y);", nan, {"Y": -1.5}),
    ("X := ATAN2(Y, Z);", math.pi, {"Y": 0.0, "Z": -1.0}),
    ("X := Y * Y;", inf, {"Y": 1e200}),
    ("X := Y ** 3;", inf, {"Y": 1e200}),
    ("X := Y ** 3;", -inf, {"Y": -1e200}),
    ("X := Y ** 0.5;", nan, {"Y": -1.0}),
    ("X := Y ** Z;", inf, {"Y": 0.0, "Z": -2.0}),
    ("X := Y ** Z;", -inf, {"Y": -0.0, "Z": -3.0}),
    ("X := EXPT(Y, 2);", 9.0, {"Y": -3.0}),
    ("X := -Y ** 2;", 9.0, {"Y": 3.0}),
    ("X := 2 ** 3 ** 2;", 64.0, {}),
    ("B := X = X;", False, {"X": nan}),
    ("X := -Y;", -0.0, {}),
    ("R := LREAL_TO_REAL(X);", inf, {"X": 1e39}),
    ("R := LREAL_TO_REAL(X);", 0.10000000149011612, {"X": 0.1}),
    ("R := R + REAL#0.1;", 0.20000000298023224, {"R": 0.10000000149011612}),
    # BOOL and bit strings
    ("B := NOT (TRUE AND FALSE) XOR TRUE;", False, {}),
    ("B := I <> 0 AND K / I > 0;", False, {"K": 1}),
    ("W := NOT W;", 0xFFFF, {}),
    ("W := W AND 16#0FF0 OR 16#1 XOR 16#3;", 0x0232, {"W": 0x1230}),
    ("W := SHL(W, 4);", 0x2340, {"W": 0x1234}),
    ("W := SHR(W, 4);", 0x0123, {"W": 0x1234}),
    ("W := ROL(W, I);", 0x2341, {"W": 0x1234, "I": 20}),
    ("W := ROR(W, 4);", 0x4123, {"W": 0x1234}),
    ("W := SHL(W, I);", 0, {"W": 1, "I": 16}),
    ("W := ROL(W, I);", 0, {"W": 1, "I": -1}),
    # selection
    ("J := SEL(B, 1, 2);", 2, {"B": True}),
    ("X := SEL(I < 3, 9.0, A[I]);", 9.0, {"I": 7}),
    ("B := SEL(I < 3, FALSE, A[I] > 1.0);", False, {"I": 7}),
    ("B := SEL(C, TRUE, FALSE);", False, {"C": True}),
    ("J := MUX(I, 10, 20, 30);", 30, {"I": 9}),
    ("J := MUX(I, 10, 20, 30);", 10, {"I": -1}),
    ("J := LIMIT(-5, I, 5);", 5, {"I": 9}),
    ("X := LIMIT(-8.0, Y, 8.0);", -8.0, {"Y": -9.0}),
    ("J := MAX(I, 3, K);", 4, {"K": 4}),
    ("X := MIN(Y, Z);", 1.0, {"Y": nan, "Z": 1.0}),
    ("J := ADD(1, 2, I);", 3, {}),
    ("B := GT(3, 2, I);", True, {}),
    ("J := MOVE(I);", 6, {"I": 6}),
    # conversions: of two integers as near the even one, TRUNC toward zero, then wrapped
    ("J := LREAL_TO_DINT(X);", 2, {"X": 2.5}),
    ("J := LREAL_TO_DINT(X);", -2, {"X": -2.5}),
    ("J := LREAL_TO_DINT(X);", 4, {"X": 3.5}),
    ("J := LREAL_TO_DINT(X);", 0, {"X": 0.49999999999999994}),
    ("J := LREAL_TO_DINT(X);", 0, {"X": -0.49999999999999994}),
    ("J := LREAL_TO_DINT(X);", 0, {"X": -0.5}),
    ("J := LREAL_TO_DINT(X);", -(2**31), {"X": 2147483647.5}),
    ("J := LREAL_TO_DINT(X);", 2**30 + 2048, {"X": 2.0**62 + 2.0**30 + 2048}),
    ("J := LREAL_TRUNC_DINT(X);", -1024, {"X": 2.0**63 - 1024}),
    ("J := LREAL_TRUNC_DINT(X);", 0, {"X": -(2.0**63) - 2048}),
    ("J := REAL_TO_DINT(R);", 8388608, {"R": 8388607.5}),
    ("J := REAL_TO_DINT(R);", 4194304, {"R": 4194304.5}),
    ("J := LREAL_TRUNC_DINT(X);", -2, {"X": -2.9}),
    ("J := TRUNC(R);", 2, {"R": 2.75}),
    ("J := LREAL_TO_DINT(X);", 0, {"X": nan}),
    ("J := LREAL_TO_DINT(X);", 0, {"X": inf}),
    ("J := LREAL_TO_DINT(X);", -1, {"X": 4294967295.0}),
    ("N := LREAL_TO_SINT(X);", -126, {"X": 130.0}),
    ("P := DINT_TO_USINT(I);", 255, {"I": -1}),
    ("J := BOOL_TO_DINT(B);", 1, {"B": True}),
    ("B := DINT_TO_BOOL(I);", True, {"I": -2}),
    ("X := BOOL_TO_LREAL(B);", 1.0, {"B": True}),
    ("S := LREAL_TO_STRING(X);", "0.1", {"X": 0.1}),
    ("S := LREAL_TO_STRING(X);", "1e+300", {"X": 1e300}),
    ("S := LREAL_TO_STRING(X);", "-inf", {"X": -inf}),
    ("S := CONCAT(DINT_TO_STRING(I), ',', BOOL_TO_STRING(B));", "-5,FALSE", {"I": -5}),
    ("J := STRING_TO_DINT(S);", -12, {"S": " -12abc"}),
    ("J := STRING_TO_DINT(S);", 0, {"S": "abc"}),
    ("X := STRING_TO_LREAL(S);", -1.5e3, {"S": "-1.5e3x"}),
    ("B := STRING_TO_BOOL(S);", True, {"S": "true"}),
    # strings
    ("J := LEN(S);", 3, {"S": "abc"}),
    ("S := LEFT(S, 2);", "ab", {"S": "abc"}),
    ("S := LEFT(S, 9);", "abc", {"S": "abc"}),
    ("S := RIGHT(S, 2);", "bc", {"S": "abc"}),
    ("S := RIGHT(S, 0);", "", {"S": "abc"}),
    ("S := MID(S, 2, 2);", "bc", {"S": "abcd"}),
    ("S := INSERT(S, 'X', 1);", "aXbc", {"S": "abc"}),
    ("S := DELETE(S, 2, 2);", "ad", {"S": "abcd"}),
    ("S := DELETE(S, 1, 4);", "abc", {"S": "abcd"}),
    ("S := DELETE(S, 2, 4);", "abcd", {"S": "abcd"}),
    ("S := REPLACE(S, 'XYZ', 2, 2);", "aXYZd", {"S": "abcd"}),
    ("J := FIND(S, 'c');", 3, {"S": "abcabc"}),
    ("J := FIND(S, '.');", 0, {"S": "abc"}),
    ("B := S < 'abd';", True, {"S": "abc"}),
    ("S := 'it$'s$N\"';", "it's\n\"", {}),
]


@pytest.mark.parametrize(("text", "expected", "values"), EXPRESSIONS)
def test_expressions(text: str, expected: Any, values: dict[str, Any]) -> None:
    result = results(text, everywhere=True, **values)[text.split()[0]]
    assert same(result, expected), result


LONG: list[tuple[str, Any, dict[str, Any]]] = [
    ("T := T + T#1ms;", 1_001_000_000, {"T": 1_000_000_000}),
    ("T := -T / 3;", -333_333_333, {"T": 1_000_000_000}),
    ("T := T * 2.5;", 2_500_000_000, {"T": 1_000_000_000}),
    ("T := T / 0.4;", 2_500_000_000, {"T": 1_000_000_000}),
    ("T := 3 * T;", 3, {"T": 1}),
    ("B := T > T#1s;", False, {}),
    ("T := T * X;", -(2**63), {"T": 1, "X": inf}),
    ("X := TIME_IN_S_TO_LREAL(T);", 1.5, {"T": 1_500_000_000}),
    ("X := TIME_IN_MS_TO_LREAL(T);", 1500.0, {"T": 1_500_000_000}),
    ("J := TIME_IN_S_TO_DINT(T);", -1, {"T": -1_999_999_999}),
    ("S := TIME_TO_STRING(T);", "T#60500ms", {"T": 60_500_000_000}),
    ("T := STRING_TO_TIME(S);", 1_500_000_000, {"S": "T#1.5s"}),
    ("T := STRING_TO_TIME(S);", 0, {"S": "1.5s"}),
    ("L := L * L;", 1, {"L": 2**63 - 1}),
    ("L := LREAL_TO_LINT(X);", -(2**63), {"X": 1e30}),
    ("L := LREAL_TO_LINT(X);", 2251799813685248, {"X": 2251799813685248.5}),
    ("L := LREAL_TO_LINT(X);", -2251799813685250, {"X": -2251799813685249.5}),
    ("T := T#1us * (N + SINT#1);", -128_000, {"N": 127}),
    ("T := (I + 1) * T#1us;", -2147483648_000, {"I": 2**31 - 1}),
    ("T := T#1us * (P * P);", 1000, {"P": 255}),
    ("T := T#1us * -N;", -128_000, {"N": -128}),
    ("T := T / I;", 0, {"T": 5}),
    ("T := T / X;", 0, {"T": 5}),
    ("T := T / UL;", 0, {"T": 5}),
    ("UL := LREAL_TO_ULINT(X);", 2**63 + 2**62, {"X": 2.0**63 + 2.0**62}),
    ("UL := LWORD_TO_ULINT(LREAL_TO_LWORD(X));", struct.unpack("<Q", struct.pack("<d", -1.5))[0], {"X": -1.5}),
    ("R := DWORD_TO_REAL(16#3F800000);", 1.0, {}),
    ("X := LINT_TO_LREAL(TRUNC(Y));", -2.0, {"Y": -2.7}),
]


@pytest.mark.parametrize(("text", "expected", "values"), LONG)
def test_64_bit_values_in_python(text: str, expected: Any, values: dict[str, Any]) -> None:
    result = results(text, everywhere=False, **values)[text.split()[0]]
    assert same(result, expected), result


def test_a_constant_does_not_fit_real_but_a_variable_needs_a_conversion() -> None:
    with pytest.raises(FunctionBlockError, match="LREAL_TO_REAL"):
        check("R := X;", **TYPES)
