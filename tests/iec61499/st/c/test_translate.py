"""Structured Text as machine code has the results of the Python runtime, bit for bit."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499.st import ast
from iec61499.st.c.expressions import Places
from iec61499.st.c.translate import c_function
from iec61499.st.check import check_algorithm
from iec61499.st.printer import print_algorithm
from iec61499.types import BOOL, LREAL, STRING, ArrayType, DataType, Member, StructType
from tests.iec61499.st.test_semantics import EXPRESSIONS, LONG, STATEMENTS
from tests.support.iec61499.c_harness import Program, needs_compiler, run_c
from tests.support.iec61499.st_cases import TYPES, inf, nan
from tests.support.iec61499.st_harness import check, run_python, same, scope_of
from tests.support.iec61499.st_programs import SCOPE, programs, states

POINT = StructType("POINT", (Member("X", LREAL, 0.0), Member("NAME", STRING, ""), Member("SET", BOOL, False)))
MORE: dict[str, str | DataType] = {
    **TYPES,
    "CH": "CHAR",
    "CJ": "CHAR",
    "DA": "DT",
    "DB": "TOD",
    "DC": "DATE",
    "LW": "LWORD",
    "DW": "DWORD",
    "U": "UINT",
    "SH": "STRING[5]",
    "auto": "DINT",
    "self": "DINT",
    "NAN": "LREAL",
    "fb_x": "DINT",
    "UD": "UDINT",
    "PT": POINT,
    "PU": POINT,
    "PS": ArrayType(POINT, 1, 2),
    "NAMES": ArrayType(STRING, 0, 2),
}
CASES: list[tuple[str, dict[str, Any]]] = [
    ("auto := self + fb_x; NAN := NAN + 1;", {"self": 1, "fb_x": 2, "NAN": 0.5}),
    ("L := L - 1; UL := UL + 1; N := -N; L := -L;", {"L": -(2**63), "UL": 2**64 - 1, "N": -128}),
    ("L := L / -1; I := I / -1; J := J MOD -1; K := K MOD 0;", {"L": -(2**63), "I": -(2**31), "J": 7, "K": 3}),
    ("I := ABS(I); L := ABS(L); N := ABS(N); X := ABS(X);", {"I": -(2**31), "L": -(2**63), "N": -128, "X": -0.0}),
    ("I := I ** 3; J := J ** -1; K := K ** -2; L := L ** 63; UL := UL ** 5;", {"I": -7, "J": -1, "K": 1, "L": 3}),
    ("LW := ROL(LW, 70); DW := ROR(DW, -1); W := SHR(W, 20);", {"LW": 2**63 + 5, "DW": 9, "W": 77}),
    ("UL := UL ** I;", {"UL": 2**64 - 1, "I": -128}),
    ("UL := LREAL_TO_ULINT(X); I := LREAL_TO_DINT(Y); L := LREAL_TRUNC_LINT(Z);", {"X": -1.5, "Y": nan, "Z": -9e18}),
    ("P := LREAL_TO_USINT(X); N := LREAL_TO_SINT(Y);", {"X": 1e18, "Y": -300.5}),
    ("X := SQRT(X); Y := LN(Y); Z := EXP(Z);", {"X": -1.0, "Y": 0.0, "Z": 1e6}),
    ("X := X / Y; Z := Y / Y; Y := X ** 2;", {"X": -3.0, "Y": -0.0}),
    ("X := X ** Y; Y := Z ** Y;", {"X": -2.0, "Y": 0.5, "Z": -0.0}),
    ("X := X ** Y; Y := Z ** Y;", {"X": -1e200, "Y": 3.0, "Z": 1e-200}),
    ("X := SIN(X); Y := TAN(Y); Z := ACOS(Z);", {"X": inf, "Y": 1e300, "Z": 1.5}),
    ("R := R * R; X := R; R := LREAL_TO_REAL(Y);", {"R": 3e38, "Y": 0.1}),
    ("R := SIN(R) + R / 3.0; X := DINT_TO_REAL(I);", {"R": 0.7, "I": 16777217}),
    ("U := U * U; UD := UD * UD;", {"U": 65535, "UD": 2**32 - 1}),
    ("S := CONCAT(S, S); SH := S; I := LEN(SH);", {"S": "abcé"}),
    ("S := MID(S, I, J);", {"S": "abc", "I": 2**31 - 1, "J": 2}),
    ("S := REPLACE(S, 'x', 0, 2); SH := INSERT(S, S, 1);", {"S": "abc"}),
    ("S := REAL_TO_STRING(R); SH := LREAL_TO_STRING(X);", {"R": 0.5, "X": -1e-300}),
    ("S := LREAL_TO_STRING(X); NAMES[1] := LREAL_TO_STRING(-X);", {"X": inf}),
    ("S := TIME_TO_STRING(T); L := LEN(S);", {"T": -1_500_000}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S); L := STRING_TO_LINT(S);", {"S": " +12mm"}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S);", {"S": "08#7"}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S);", {"S": "DINT#+5#3"}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S);", {"S": "5 #1"}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S);", {"S": "-16#1"}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S);", {"S": "2##1"}),
    ("I := STRING_TO_DINT(S); P := STRING_TO_USINT(S);", {"S": "USINT#+7"}),
    ("I := STRING_TO_DINT(S); W := STRING_TO_WORD(S);", {"S": "DINT#-5"}),
    ("I := STRING_TO_DINT(S); W := STRING_TO_WORD(S);", {"S": "16#FfFF"}),
    ("L := STRING_TO_LINT(S); UL := STRING_TO_ULINT(S);", {"S": "-9223372036854775808"}),
    ("L := STRING_TO_LINT(S); UL := STRING_TO_ULINT(S);", {"S": "18446744073709551616"}),
    ("X := STRING_TO_LREAL(S);", {"S": "\x1c-.5e+2x"}),
    ("X := STRING_TO_LREAL(S); R := STRING_TO_REAL(S);", {"S": "1.e5e5"}),
    ("B := STRING_TO_BOOL(S); C := STRING_TO_BOOL('BOOL#1');", {"S": "tRuE1"}),
    ("B := S < 'abd' AND S >= ''; C := MAX(S, 'é') = 'é';", {"S": "abc\0"}),
    ("CH := STRING_TO_CHAR(S); S := CHAR_TO_STRING(CJ); B := CH < CJ;", {"S": "xy", "CJ": "b"}),
    ("DB := DT_TO_TOD(DA); DC := DT_TO_DATE(DA);", {"DA": -1}),
    ("DB := DT_TO_TOD(DA); DC := DT_TO_DATE(DA);", {"DA": -(2**63)}),
    ("T := DA - DA; DA := DA + T#1d;", {"DA": 5}),
    ("PT.X := 1.5; PT.NAME := 'a'; PU := PT; PS[2] := PU; X := PS[2].X; S := PS[2].NAME;", {}),
    ("FOR I := 0 TO 2 DO NAMES[I] := CONCAT(NAMES[I], DINT_TO_STRING(I)); END_FOR;", {"NAMES": ["a", "b", ""]}),
    ("UL := WORD_BCD_TO_UINT(W); W := UINT_TO_BCD_WORD(U);", {"W": 0x1234, "U": 4321}),
    ("I := MUX(J, 1, 2, 3); S := MUX(K, 'a', 'b'); B := MUX(2, TRUE, FALSE);", {"J": -5, "K": 9}),
    ("FOR UL := UL TO UL + 2 DO I := I + 1; END_FOR;", {"UL": 2**64 - 5}),
    ("FOR J := 100 TO -100 BY I DO K := K + J; END_FOR;", {"I": -50}),
    ("CASE I OF -2..2, 7: J := 2; ELSE J := 3; END_CASE;", {"I": 1}),
]


def compare(cases: list[Program], results: list[dict[str, Any] | int]) -> None:
    for (checked, scope, values), got in zip(cases, results, strict=True):
        expected = run_python(checked, scope, values)
        assert isinstance(got, dict), f"fault {got}: {checked.body}"
        wrong = {name: (expected[name], got[name]) for name in scope if not same(expected[name], got[name])}
        assert not wrong, f"{wrong}\n{values}\n{checked.body}"


@needs_compiler
def test_cases_have_the_results_of_python(tmp_path_factory: pytest.TempPathFactory) -> None:
    known: list[tuple[str, dict[str, Any]]] = [(text, {}) for text, _ in STATEMENTS]
    known += [(text, values) for text, _, values in (*EXPRESSIONS, *LONG) if "TO_TIME" not in text]
    cases: list[Program] = [(check(text, **TYPES), scope_of(TYPES), values) for text, values in known]
    cases += [(check(text, **MORE), scope_of(MORE), values) for text, values in CASES]
    compare(cases, run_c(cases, tmp_path_factory.mktemp("c")))


@needs_compiler
@settings(
    deadline=None,
    suppress_health_check=list(HealthCheck),
    max_examples=8,
    derandomize=True,
    phases=[Phase.generate],  # a smaller program would have to be compiled, too
)
@given(cases=st.lists(st.tuples(programs, states), min_size=5, max_size=5))
def test_generated_programs_have_the_results_of_python(
    cases: list[tuple[ast.ParsedAlgorithm, dict[str, Any]]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    made: list[Program] = [(check_algorithm(tree, SCOPE, SCOPE.keys()), SCOPE, state) for tree, state in cases]
    try:
        compare(made, run_c(made, tmp_path_factory.mktemp("c")))
    except AssertionError as error:
        raise AssertionError("\n".join([str(error), *(print_algorithm(tree) for tree, _ in cases)])) from None


@needs_compiler
def test_faults_leave_the_variables_alone(tmp_path_factory: pytest.TempPathFactory) -> None:
    texts = {
        "J := 1; A[I] := 2.0; X := 3.0;": 1,
        "WHILE TRUE DO J := J + 1; END_WHILE;": 2,
        "FOR I := 1 TO 3 BY K DO J := 1; END_FOR;": 3,
        "WHILE TRUE DO S := CONCAT(S, 'abc'); END_WHILE;": 4,
    }
    scope = scope_of(TYPES)
    cases: list[Program] = [(check(text, **TYPES), scope, {"I": 9}) for text in texts]
    assert run_c(cases, tmp_path_factory.mktemp("c")) == list(texts.values())


@pytest.mark.parametrize(
    ("text", "types", "what"),
    [
        ("\n T := STRING_TO_TIME(S);", {"T": "TIME", "S": "STRING"}, r"a.fbt:2:7: C: .*STRING to TIME"),
        ("V := V;", {"V": "WSTRING"}, "a.fbt:1:1: C: WSTRING is not supported"),
        ("V := '';", {"V": "STRING[300]"}, r"a.fbt:1:1: C: STRING\[300\]"),
        ("V[1] := 0;", {"V": ArrayType(LREAL, 0, 60_000)}, "a.fbt:1:1: C: .* more than 65536 bytes"),
    ],
)
def test_what_c_cannot_do_is_refused(text: str, types: dict[str, str | DataType], what: str) -> None:
    with pytest.raises(FunctionBlockError, match=what):
        c_function(check(text, **types), "void f(struct block *self, struct fb_run *run)", Places())
