"""Algorithms as Python: what is loaded and stored, conditions, and errors while it runs."""

from __future__ import annotations

import math

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.st.check import check_expression
from iec61499.st.lua.translate import lua_condition
from iec61499.st.parser import parse_expression
from iec61499.st.python.expressions import python_name
from iec61499.st.python.translate import CONDITION_GLOBALS, compile_algorithm, compile_condition, python_source
from iec61499.st.semantics import ITERATION_LIMIT
from tests.support.iec61499.st_cases import SCOPE, TYPES, inf, results
from tests.support.iec61499.st_harness import LUA, check, instance, run_lua, run_python, scope_of


@pytest.mark.parametrize(
    "text",
    [
        "I := 1;\nWHILE TRUE DO I := I + 1; END_WHILE;",
        "I := 1;\nREPEAT ; UNTIL I = 0 END_REPEAT;",
        "I := 1;\nFOR J := 0 TO 2000000000 DO ; END_FOR;",
    ],
)
def test_an_endless_loop_is_named_and_nothing_is_stored(text: str) -> None:
    state = instance(SCOPE, {})
    with pytest.raises(FunctionBlockError, match=f"a.fbt:2:1: loop did not end within {ITERATION_LIMIT} iterations"):
        compile_algorithm(check(text, **TYPES), "ALG")(state)
    assert state.I == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("FOR I := 1 TO 2 BY K DO ; END_FOR;", "a.fbt:1:1: BY 0 never ends"),
        ("I := 3; A[I] := 1;", "a.fbt:1:11: index 3: expected -1 to 2"),
        ("I := -2; X := A[I];", "a.fbt:1:17: index -2: expected -1 to 2"),
    ],
)
def test_runtime_errors_name_the_position(text: str, message: str) -> None:
    checked = check(text, **TYPES)
    with pytest.raises(FunctionBlockError, match=message):
        run_python(checked, SCOPE, {})
    for interpreter in LUA:
        with pytest.raises(Exception, match=r"1:1"):
            run_lua(checked, SCOPE, {}, interpreter)


def test_arrays_are_replaced_never_changed_in_place() -> None:
    state = instance(SCOPE, {})
    before = state.A
    compile_algorithm(check("A[0] := 1 / X;", **TYPES), "ALG")(state)
    assert before == [0.0] * 4
    assert [0.0, math.inf, 0.0, 0.0] == state.A


def test_the_exact_version_starts_from_the_same_values() -> None:
    state = results("X := X + 1; A[0] := A[0] + 1; Y := X / Z;", everywhere=True)
    assert (state["X"], state["A"][1], state["Y"]) == (1.0, 1.0, inf)


@pytest.mark.parametrize(
    ("text", "reads", "writes"),
    [
        ("X := Y; Z := X;", {"Y"}, {"X", "Z"}),
        ("IF B THEN X := 1; END_IF;", {"B", "X"}, {"X"}),
        ("IF B THEN X := 1; ELSE X := 2; END_IF; Y := X;", {"B"}, {"X", "Y"}),
        ("IF B THEN RETURN; END_IF; X := 1;", {"B", "X"}, {"X"}),
        ("X := 1; IF B THEN RETURN; END_IF;", {"B"}, {"X"}),
        ("WHILE B DO X := 1; B := FALSE; END_WHILE; Y := X;", {"B", "X"}, {"B", "X", "Y"}),
        ("REPEAT X := 1; UNTIL X > 0 END_REPEAT; Y := X;", set(), {"X", "Y"}),
        ("REPEAT IF B THEN EXIT; END_IF; X := 1; UNTIL X > 0 END_REPEAT;", {"B", "X"}, {"X"}),
        ("FOR I := 1 TO 2 DO J := I; END_FOR;", {"J"}, {"I", "J"}),
        ("CASE I OF 1: X := 1; ELSE X := 2; END_CASE;", {"I"}, {"X"}),
        ("CASE I OF 1: X := 1; END_CASE;", {"I", "X"}, {"X"}),
        ("A[0] := 1;", {"A"}, {"A"}),
        ("VAR v : LREAL; END_VAR v := X; Y := v;", {"X"}, {"Y"}),
    ],
)
def test_only_what_matters_is_loaded(text: str, reads: set[str], writes: set[str]) -> None:
    code = python_source(check(text, **TYPES))
    assert (set(code.reads), set(code.writes)) == (reads, writes)


def test_temporaries_are_initialised_only_where_it_shows() -> None:
    text = "VAR a1, b1 : LREAL; c1 : LREAL := 2; d1 : LREAL := c1; END_VAR a1 := X; b1 := b1 + a1 + d1; Y := b1;"
    lines = python_source(check(text, **TYPES)).lines
    assert [line.split(" = ")[0] for line in lines] == ["b1", "c1", "d1", "a1", "b1", "Y"]


def test_real_arithmetic_is_bare_python() -> None:
    code = python_source(check("X := (X + 2 * Y) / Z - Y ** 2;", **TYPES))
    assert code.lines == ("X = (X + 2.0 * Y) / Z - Y * Y",)
    assert code.globals == {}
    assert code.exact_lines is not None


def test_variables_named_like_python_keywords() -> None:
    scope = scope_of({"in": "LREAL", "_s": "LREAL", "lambda_": "LREAL"})
    checked = check("in := _s + lambda_;", **{"in": "LREAL", "_s": "LREAL", "lambda_": "LREAL"})
    names = {name: python_name(name) for name in scope}
    state = instance(
        {names[name]: data_type for name, data_type in scope.items()}, {names["_s"]: 1.0, names["lambda_"]: 2.0}
    )
    compile_algorithm(checked, "class")(state)
    assert getattr(state, names["in"]) == 3.0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("I > 2 AND NOT B", True),
        ("X / Y > 5.0", True),
        ("I MOD 2 = 1", True),
        ("SQRT(-X) > 0", False),
        ("TRUE", True),
    ],
)
def test_conditions(text: str, expected: bool) -> None:
    checked = check_expression(parse_expression(text), SCOPE)
    state = instance(SCOPE, {"I": 3, "X": 1.0})
    assert eval(compile_condition(checked), dict(CONDITION_GLOBALS), {"s": state}) is expected
    assert lua_condition(checked, lambda name: f"V.{name}").body
