"""An assignment copies: variables are no references (IEC 61131-3, 7.3.3.1), also inside arrays and structures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from iec61499.st.check import check_algorithm
from iec61499.st.parser import parse_algorithm
from iec61499.st.typed import CheckedAlgorithm
from iec61499.types import DINT, INT, STRING, ArrayType, DataType, Member, StructType, elementary
from tests.support.iec61499.c_harness import needs_compiler, run_c
from tests.support.iec61499.st_harness import LUA, run_lua, run_python, scope_of

ROW = ArrayType(INT, 0, 2)
ITEM = StructType("ITEM", (Member("D", DINT, 0), Member("S", STRING, ""), Member("A", ROW, [0, 0, 0])))
NEST = StructType("NEST", (Member("IN", ITEM, ITEM.default), Member("N", DINT, 0)))
TYPES: dict[str, str | DataType] = {
    "ST": ITEM,
    "SU": ITEM,
    "SA": ArrayType(ITEM, 0, 2),
    "NE": NEST,
    "M": ArrayType(ROW, 0, 1),
    "A": ROW,
    "I": "DINT",
    "J": "DINT",
}
CASES: list[tuple[str, str, Any]] = [
    ("ST.D := 5; SA[2] := ST; ST.D := 7; I := SA[2].D;", "I", 5),
    ("ST.D := 5; SA[2] := ST; SA[2].D := 7; I := ST.D;", "I", 5),
    ("SA[0].D := 1; SA[1] := SA[0]; SA[0].D := 2; I := SA[1].D;", "I", 1),
    ("SA[0].D := 1; ST := SA[0]; SA[0].D := 2; I := ST.D;", "I", 1),
    ("ST.S := 'a'; SU := ST; ST.S[1] := 'b'; I := FIND(SU.S, 'a');", "I", 1),
    ("M[0, 1] := 3; M[1] := M[0]; M[0, 1] := 4; I := M[1, 1];", "I", 3),
    ("A[1] := 5; M[1] := A; A[1] := 7; I := M[1, 1];", "I", 5),
    ("A[1] := 5; ST.A := A; A[1] := 7; I := ST.A[1];", "I", 5),
    ("A[1] := 5; ST.A := A; ST.A[1] := 7; I := A[1];", "I", 5),
    ("ST.A[0] := 1; NE.IN := ST; ST.A[0] := 2; I := NE.IN.A[0];", "I", 1),
    ("NE.IN.A[0] := 1; SA[1] := NE.IN; SA[1].A[0] := 2; I := NE.IN.A[0];", "I", 1),
    ("SA[1].A := SA[0].A; SA[0].A[2] := 9; I := SA[1].A[2];", "I", 0),
    ("FOR J := 0 TO 2 DO ST.D := J; SA[J] := ST; END_FOR; I := SA[0].D;", "I", 0),
    ("M[0] := M[0]; M[0, 0] := 1; I := M[0, 0];", "I", 1),
    ("VAR T: ITEM := ST; U: ARRAY [0..1] OF ITEM; END_VAR U[0] := T; T.D := 3; ST.D := 4; I := U[0].D;", "I", 0),
    ("VAR T: ARRAY [0..2] OF INT := [1, 2, 3]; END_VAR A := T; T[0] := 9; A[1] := 8; I := A[0];", "I", 1),
]
IN_LUA = [case for case in CASES if "S" not in case[0] and "NE" not in case[0]]  # without structures


def checked(text: str) -> CheckedAlgorithm:
    scope = scope_of(TYPES)
    return check_algorithm(
        parse_algorithm(text),
        scope,
        scope.keys(),
        find_type=lambda name: ITEM if name == "ITEM" else elementary(name),
    )


@pytest.mark.parametrize(("text", "name", "expected"), CASES)
def test_in_python(text: str, name: str, expected: Any) -> None:
    assert run_python(checked(text), scope_of(TYPES), {})[name] == expected


def test_an_input_stays_as_its_source_has_it() -> None:
    given = {"ST": [5, "x", [1, 2, 3]], "SA": ArrayType(ITEM, 0, 2).default}
    kept = [5, "x", [1, 2, 3]]
    state = run_python(checked("SA[0] := ST; SA[0].D := 6; SA[0].A[0] := 7;"), scope_of(TYPES), given)
    assert given["ST"] == kept
    assert state["SA"][0] == [6, "x", [7, 2, 3]]


@needs_compiler
def test_in_c(tmp_path: Path) -> None:
    found = run_c([(checked(text), scope_of(TYPES), {}) for text, _, _ in CASES], tmp_path)
    assert [values if isinstance(values, int) else values["I"] for values in found] == [case[2] for case in CASES]


@pytest.mark.parametrize(("text", "name", "expected"), IN_LUA)
def test_in_lua(text: str, name: str, expected: Any) -> None:
    scope = {key: kind for key, kind in scope_of(TYPES).items() if "S" not in key and key != "NE"}
    for interpreter in LUA:
        assert run_lua(checked(text), scope, {}, interpreter)[name] == expected
