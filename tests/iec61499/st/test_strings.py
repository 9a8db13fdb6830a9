"""A STRING is counted, cut and sent in bytes of UTF-8, as in 4diac FORTE; a WSTRING in characters."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.literals import format_literal, parse_literal
from iec61499.net.wire import Signature
from iec61499.types import STRING, WSTRING, bytes_of, text_of
from tests.support.iec61499.c_harness import needs_compiler, run_c
from tests.support.iec61499.st_harness import LUA, check, run_lua, run_python, scope_of

TYPES: dict[str, Any] = {"S": "STRING", "W": "WSTRING", "N": "INT"}
CHARACTER = 10
"""The fault of C code that a character is not there."""


@pytest.mark.parametrize(
    ("text", "name", "expected"),
    [
        ("N := LEN('Größe');", "N", 7),
        ("N := FIND('€uro', 'u');", "N", 4),
        ("S := RIGHT('10 €', 3);", "S", bytes_of("€")),
    ],
)
def test_strings_count_bytes(text: str, name: str, expected: Any) -> None:
    assert run_python(check(text, **TYPES), scope_of(TYPES), {})[name] == expected
    if name == "N":
        for interpreter in LUA:
            assert run_lua(check(text, **TYPES), scope_of(TYPES), {}, interpreter)[name] == expected


def test_wide_strings_count_characters_and_convert() -> None:
    state = run_python(
        check("""W := "Größe"; N := LEN(W); S := WSTRING_TO_STRING(W);""", **TYPES), scope_of(TYPES), {}
    )
    assert (state["N"], state["S"]) == (5, bytes_of("Größe"))
    state = run_python(check("S := '€'; W := STRING_TO_WSTRING(S);", **TYPES), scope_of(TYPES), {})
    assert (state["W"], text_of(state["S"])) == ("€", "€")


def test_strings_go_over_the_wire_as_utf_8() -> None:
    value = parse_literal("'1 €'", STRING)
    assert Signature([STRING]).encode([value]) == b"\x50\x00\x05" + "1 €".encode()
    assert Signature([STRING]).decode(b"\x50\x00\x05" + "1 €".encode()) == (value,)


@pytest.mark.parametrize("text", ["'Größe €'", "'$C3$28'", "'$E2$82'", "'a$N$00'"])
def test_literals_read_back(text: str) -> None:
    value = parse_literal(text, STRING)
    assert parse_literal(format_literal(value, STRING), STRING) == value
    assert format_literal(parse_literal("'Größe'", STRING), STRING) == "'Größe'"
    assert parse_literal('"Größe"', WSTRING) == "Größe"


@pytest.mark.parametrize(
    ("text", "kind", "value"),
    [
        ("12 mm", "INT", 12),
        (" -7", "INT", -7),
        ("16#FF", "INT", 255),
        ("16#FFFF", "INT", -1),
        ("2#101x", "USINT", 5),
        ("INT#5", "INT", 5),
        ("DINT#5", "INT", 0),
        ("40000", "INT", 0),
        ("-1", "UINT", 0),
        ("7#5", "INT", 0),
        ("x", "INT", 0),
        ("", "INT", 0),
        ("9" * 900, "INT", 0),
        ("true", "BOOL", True),
        ("TRUEx", "BOOL", True),
        ("BOOL#1", "BOOL", True),
        ("no", "BOOL", False),
    ],
)
def test_strings_become_numbers_as_in_forte(text: str, kind: str, value: Any) -> None:
    types: dict[str, Any] = {"S": "STRING", "N": kind}
    code = check(f"N := STRING_TO_{kind}(S);", **types)
    assert run_python(code, scope_of(types), {"S": text})["N"] == value
    for interpreter in LUA:
        assert run_lua(code, scope_of(types), {"S": text}, interpreter)["N"] == value


@pytest.mark.parametrize(("time", "text"), [("T#3s", "T#3000ms"), ("T#1500us", "T#1.500ms"), ("T#0s", "T#0ms")])
def test_times_become_milliseconds(time: str, text: str) -> None:
    assert run_python(check(f"S := TIME_TO_STRING({time});", **TYPES), scope_of(TYPES), {})["S"] == text


def test_characters_are_counted_from_one() -> None:
    text = "S := 'abc'; S[1] := 'x'; S[N + 2] := S[2]; IF S[3] = 'b' THEN B := S[1] = 'x'; END_IF; N := LEN(S);"
    types: dict[str, Any] = {**TYPES, "B": "BOOL"}
    state = run_python(check(text, **types), scope_of(types), {"N": 1})
    assert (state["S"], state["B"], state["N"]) == ("xbb", True, 3)
    for interpreter in LUA:
        other = run_lua(check(text, **types), scope_of(types), {"N": 1}, interpreter)
        assert (other["S"], other["B"], other["N"]) == ("xbb", True, 3)
    wide = run_python(check("""W := "Größe"; W[3] := W[4]; S := '';""", **TYPES), scope_of(TYPES), {})
    assert wide["W"] == "Grßße"


@pytest.mark.parametrize("place", [0, 4, -1, 32767])
@pytest.mark.parametrize("text", ["S[N] := 'x';", "IF S[N] = 'x' THEN S := ''; END_IF;"])
def test_a_character_that_is_not_there(text: str, place: int) -> None:
    values = {"S": "abc", "N": place}
    with pytest.raises(FunctionBlockError, match=f"character {place}: expected 1 to 3"):
        run_python(check(text, **TYPES), scope_of(TYPES), values)
    with pytest.raises(LUA["Lua 5.4"].LuaError, match=f"character {place}: expected 1 to 3"):
        run_lua(check(text, **TYPES), scope_of(TYPES), values, "Lua 5.4")


@needs_compiler
def test_characters_in_c(tmp_path: Path) -> None:
    scope = scope_of({**TYPES, "B": "BOOL"})
    del scope["W"]
    text = "S[2] := 'X'; S[N] := S[3]; B := S[1] = 'd'; S[4] := BYTE_TO_CHAR(BYTE#16#E4); S := CONCAT(S, S[1]);"
    programs = [(check(text, **scope), scope, {"S": "abcd", "N": place}) for place in (1, 0, 5)]
    good, *faults = run_c(programs, tmp_path)
    assert isinstance(good, dict)
    assert (good["S"], good["B"]) == ("cXc\xe4c", False)
    assert faults == [CHARACTER, CHARACTER]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("S[0] := 'x';", "character 0 of S: expected 1 for the first one"),
        ("S[1] := 'xy';", "STRING does not fit CHAR"),
        ("S[1].X := 'x';", "nothing follows a character of a text"),
        ("S['a'] := 'x';", "index is STRING: expected an integer"),
        ("N[1] := 1;", "N is a INT here and takes no index"),
    ],
)
def test_characters_are_checked(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError, match=re.escape(message)):
        check(text, **TYPES)


def test_a_constant_is_the_text_that_its_place_asks_for() -> None:
    text = """S := "10 €"; W := '10 €'; N := BOOL_TO_INT(S = "10 €" AND W = '10 €');"""
    state = run_python(check(text, **TYPES), scope_of(TYPES), {})
    assert (state["S"], state["W"], state["N"]) == (bytes_of("10 €"), "10 €", 1)
