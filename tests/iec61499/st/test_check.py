"""Typing: what widens, what is refused and how the message reads."""

from __future__ import annotations

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.st.check import check_algorithm, check_expression
from iec61499.st.functions import conversion, widens
from iec61499.st.parser import parse_algorithm, parse_expression
from iec61499.types import BOOL, ELEMENTARY, LREAL, ArrayType, DataType
from tests.support.iec61499.st_harness import check, scope_of

TYPES: dict[str, str | DataType] = {
    **{name[0].lower() + name[1:].lower(): name for name in ELEMENTARY},
    "a": ArrayType(LREAL, 1, 3),
}

ERRORS = [
    ("lreal := missing;", "1:10: unknown variable missing: expected "),
    ("lreal := bool;", "1:10: BOOL does not fit LREAL: expected LREAL, or convert with BOOL_TO_LREAL"),
    ("int := lreal;", "1:8: LREAL does not fit INT: expected INT, or convert with LREAL_TO_INT"),
    ("bool := lreal;", "1:9: got LREAL, expected BOOL"),
    ("int := 70000;", "1:8: 70000 is out of range: expected INT -32768 to 32767"),
    ("usint := -1;", "1:10: -1 is out of range: expected USINT 0 to 255"),
    ("lreal := 99999999999999999999;", "is out of range"),
    ("dint := 1.5;", "1:9: LREAL does not fit DINT: expected DINT, or convert with LREAL_TO_DINT"),
    ("lreal := SINN(lreal);", "1:10: unknown function SINN: expected SIN or "),
    ("lreal := SIN(bool);", "1:14: SIN expects ANY_REAL, got BOOL"),
    ("lreal := SIN(lreal, lreal);", "1:10: SIN takes 1 argument, got 2"),
    ("lreal := MIN(lreal);", "1:10: MIN takes at least 2 arguments, got 1"),
    ("lreal := SUB(lreal, lreal, lreal);", "1:10: SUB takes 2 arguments, got 3"),
    ("word := SHL(dint, 1);", "1:13: SHL expects BYTE, WORD, DWORD or LWORD, got DINT"),
    ("bool := dint AND dint;", "1:9: AND expects ANY_BIT, got DINT"),
    ("word := word * word;", "1:9: * expects ANY_NUM, got WORD"),
    ("time := NOW_MONOTONIC(1);", "1:9: NOW_MONOTONIC takes 0 arguments, got 1"),
    ("lreal := lreal MOD lreal;", "1:10: MOD expects ANY_INT, got LREAL"),
    ("bool := bool < bool;", "1:14: < does not order BOOL: expected = or <>"),
    ("lreal := string + dint;", "1:17: + cannot combine STRING and DINT"),
    ("bool := lint = ulint;", "convert with LINT_TO_ULINT or ULINT_TO_LINT"),
    ("lreal := -bool;", "1:10: - needs a number or TIME, got BOOL"),
    ("time := 1 / time;", "1:11: / does not divide a number by TIME"),
    ("lreal := a;", "1:10: got ARRAY [1..3] OF LREAL, expected LREAL"),
    ("lreal := a + 1.0;", "1:10: ARRAY [1..3] OF LREAL cannot be computed with"),
    ("a[0] := 1.0;", "1:3: index 0 of a: expected 1 to 3"),
    ("a[lreal] := 1.0;", "1:3: index is LREAL: expected an integer"),
    ("lreal[1] := 1.0;", "1:7: lreal is a LREAL here and takes no index"),
    ("IF dint THEN ; END_IF;", "1:4: DINT does not fit BOOL: expected BOOL, or convert with DINT_TO_BOOL"),
    (
        "CASE lreal OF 1: ; END_CASE;",
        "1:6: CASE by LREAL is not supported: expected an integer, bit string or enumeration",
    ),
    ("CASE dint OF 5..1: ; END_CASE;", "1:14: range 5..1 is empty: expected low <= high"),
    ("CASE sint OF 300: ; END_CASE;", "1:14: 300 is out of range: expected SINT -128 to 127"),
    ("FOR lreal := 1 TO 2 DO ; END_FOR;", "1:5: FOR counts with LREAL"),
    ("FOR dint := 1 TO 2 BY 0 DO ; END_FOR;", "1:23: BY 0 never ends"),
    ("FOR dint := 1 TO 2 DO dint := 1; END_FOR;", "1:23: dint counts the FOR loop of line 1"),
    ("EXIT;", "1:1: EXIT stands outside of a loop: expected FOR, WHILE or REPEAT around it"),
    ("CONTINUE;", "1:1: CONTINUE stands outside of a loop"),
    ("VAR x : DATUM; END_VAR", "1:9: unknown type 'DATUM': expected BOOL, SINT"),
    ("VAR x : ARRAY [2..1] OF DINT; END_VAR", "1:9: array bounds 2..1: expected lower <= upper"),
    ("VAR x : ARRAY [1..2] OF INT := [1, 2, 3]; END_VAR", "more values than the 2 elements of ARRAY [1..2] OF INT"),
    ("VAR x : DINT := [1]; END_VAR", "x is a DINT"),
    ("VAR dint : DINT; END_VAR", "dint is declared already"),
    ("VAR CONSTANT c : DINT := 1; END_VAR c := 2;", "1:37: c cannot be assigned here: expected "),
    ("lreal := " + "-(" * 200 + "lreal" + ")" * 200 + ";", "nested deeper than"),
]


@pytest.mark.parametrize(("text", "message"), ERRORS)
def test_errors_name_position_and_choices(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        check(text, **TYPES)
    assert message in str(caught.value)
    assert str(caught.value).startswith("a.fbt:1:")
    assert "\n" not in str(caught.value)


def test_only_writable_variables_can_be_assigned() -> None:
    scope = scope_of({"IN": "LREAL", "OUT": "LREAL"})
    with pytest.raises(FunctionBlockError, match=r"f:1:1: IN cannot be assigned here: expected OUT"):
        check_algorithm(parse_algorithm("in := out;", "f"), scope, {"OUT"})


def test_names_resolve_without_case_to_the_declared_ones() -> None:
    scope = scope_of({"Speed": "LREAL"})
    checked = check_algorithm(parse_algorithm("SPEED := speed + 1;"), scope, {"Speed"})
    assert list(checked.variables) == ["Speed"]


def test_a_condition_must_be_boolean() -> None:
    scope = scope_of({"N": "DINT"})
    assert check_expression(parse_expression("N > 3"), scope).type == BOOL
    with pytest.raises(FunctionBlockError, match="expected BOOL"):
        check_expression(parse_expression("N", "f", 7), scope)


WIDENING = {
    "BOOL": "BYTE WORD DWORD LWORD",
    "SINT": "INT DINT LINT REAL LREAL",
    "INT": "DINT LINT REAL LREAL",
    "DINT": "LINT LREAL",
    "LINT": "",
    "USINT": "INT DINT LINT UINT UDINT ULINT REAL LREAL",
    "UINT": "DINT LINT UDINT ULINT REAL LREAL",
    "UDINT": "LINT ULINT LREAL",
    "ULINT": "",
    "BYTE": "WORD DWORD LWORD",
    "REAL": "LREAL",
    "LREAL": "",
    "STRING": "",
    "TIME": "LTIME",
}


@pytest.mark.parametrize("source", WIDENING)
def test_implicit_conversions_are_those_of_figure_12(source: str) -> None:
    targets = {name for name in ELEMENTARY if widens(ELEMENTARY[source], ELEMENTARY[name])}
    assert targets == set(WIDENING[source].split())


@pytest.mark.parametrize(
    ("expression", "type_name"),
    [
        ("int + dint", "DINT"), ("int + uint", "DINT"), ("dint + udint", "LINT"), ("int + real", "REAL"),
        ("dint + real", "LREAL"), ("int * 2", "INT"), ("int * 100000", "DINT"), ("int * 2.0", "LREAL"),
        ("real * 2", "REAL"), ("real * 0.1", "REAL"), ("real ** 2", "REAL"), ("int ** 2", "INT"),
        ("SQRT(int)", "LREAL"), ("SIN(real)", "REAL"), ("time * 2", "TIME"), ("2.5 * time", "TIME"),
        ("time - time", "TIME"), ("byte AND word", "WORD"), ("bool = TRUE", "BOOL"), ("LEN(string)", "INT"),
        ("TRUNC(lreal)", "LINT"), ("TRUNC(real)", "DINT"), ("LREAL_TRUNC_DINT(lreal)", "DINT"),
        ("MAX(int, dint, 3)", "DINT"), ("SEL(bool, 1, 2.5)", "LREAL"), ("MUX(usint, int, dint)", "DINT"),
        ("ADD(int, dint, real)", "LREAL"), ("GT(int, dint, 3)", "BOOL"), ("AND(bool, bool)", "BOOL"),
        ("TIME_IN_S_TO_LREAL(time)", "LREAL"), ("MOVE(sint)", "SINT"), ("LIMIT(0, int, 10)", "INT"),
    ],
)  # fmt: skip
def test_types_of_expressions(expression: str, type_name: str) -> None:
    scope = scope_of(TYPES)
    assert check_expression(parse_expression(expression), scope, ELEMENTARY[type_name]).type == ELEMENTARY[type_name]
    for other in ("SINT", "DINT", "LINT", "REAL", "LREAL", "TIME", "BOOL", "WORD"):
        if other != type_name and not widens(ELEMENTARY[type_name], ELEMENTARY[other]):
            with pytest.raises(FunctionBlockError):
                check_expression(parse_expression(expression), scope, ELEMENTARY[other])


@pytest.mark.parametrize(
    "name", ["LREAL_TO_LREAL", "LREAL_TO_BOOL", "TIME_TO_DINT", "DINT_TRUNC_INT", "X_TO_Y", "DINT_TO_DATE"]
)
def test_conversions_that_do_not_exist(name: str) -> None:
    assert conversion(name) is None


def test_calls_of_own_algorithms_are_refused_by_name() -> None:
    with pytest.raises(FunctionBlockError, match="by THIS are not supported"):
        check_algorithm(parse_algorithm("this.RST();"), {}, set())
