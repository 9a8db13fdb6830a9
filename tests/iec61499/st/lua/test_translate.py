"""What cannot be said in Lua."""

from __future__ import annotations

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.st.lua.translate import lua_source
from tests.support.iec61499.st_cases import TYPES
from tests.support.iec61499.st_harness import check


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("L := 1;", "1:1: LINT has 64 bit and a number in Lua holds integers of 53 bit: expected DINT"),
        ("X := 1;\nIF T > T#1s THEN ; END_IF;", "2:4: TIME has 64 bit"),
        ("X := LINT_TO_LREAL(TRUNC(X));", "1:20: LINT has 64 bit"),
        ("R := DWORD_TO_REAL(16#0);", "1:6: DWORD_TO_REAL keeps the bits and is not available in Lua"),
        ("FOR L := 1 TO 2 DO ; END_FOR;", "1:1: LINT has 64 bit"),
    ],
)
def test_what_lua_cannot_do_is_an_error_at_its_position(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        lua_source(check(text, **TYPES), str)
    assert message in str(caught.value)
