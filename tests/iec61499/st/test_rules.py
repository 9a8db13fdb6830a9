"""Where IEC 61131-3 leaves a case open or calls it an error, Python, C and Lua do what the table says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dtwin.errors import FunctionBlockError
from dtwin.parameters import ROOT
from iec61499.departures.structured_text import RULES, table
from iec61499.st.lua.translate import lua_source
from iec61499.st.typed import CheckedAlgorithm
from tests.support.iec61499.c_harness import needs_compiler, run_c
from tests.support.iec61499.st_harness import LUA, check, run_lua, run_python, scope_of

EXAMPLES = [example for rule in RULES for example in rule.examples]
WIDE = re.compile(r"\b(T|TOD|D)#|\*\*")
"""What Lua has not: times, dates, powers of integers."""
SCOPE = scope_of({"B": "BOOL"})


def checked(example: str) -> CheckedAlgorithm:
    return check(f"B := {example};", B="BOOL")


@pytest.mark.parametrize("example", EXAMPLES)
def test_in_python(example: str) -> None:
    assert run_python(checked(example), SCOPE, {})["B"] is True


@pytest.mark.parametrize("example", [example for example in EXAMPLES if not WIDE.search(example)])
def test_in_lua(example: str) -> None:
    for interpreter in LUA:
        assert run_lua(checked(example), SCOPE, {}, interpreter)["B"] is True


@pytest.mark.parametrize("example", [example for example in EXAMPLES if WIDE.search(example)])
def test_lua_refuses_the_others(example: str) -> None:
    with pytest.raises(FunctionBlockError, match=r"not available in Lua|has 64 bit"):
        lua_source(checked(example), str)


@needs_compiler
def test_in_c(tmp_path: Path) -> None:
    results = run_c([(checked(example), SCOPE, {}) for example in EXAMPLES], tmp_path)
    assert [example for example, left in zip(EXAMPLES, results, strict=True) if left != {"B": True}] == []


def test_the_page_has_the_table() -> None:
    assert table() in (ROOT / "docs" / "blocks.md").read_text()
