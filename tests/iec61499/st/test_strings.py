"""A STRING is counted, cut and sent in bytes of UTF-8, as in 4diac FORTE; a WSTRING in characters."""

from __future__ import annotations

from typing import Any

import pytest

from dtwin.iec61499.literals import format_literal, parse_literal
from dtwin.iec61499.net.wire import Signature
from dtwin.iec61499.types import STRING, WSTRING, bytes_of, text_of
from tests.support.iec61499.st_harness import LUA, check, run_lua, run_python, scope_of

TYPES: dict[str, Any] = {"S": "STRING", "W": "WSTRING", "N": "INT"}


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
