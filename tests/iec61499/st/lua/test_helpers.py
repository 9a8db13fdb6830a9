"""Functions that generated Lua calls."""

from __future__ import annotations

import pytest

from iec61499.st.lua.helpers import HELPERS, lua_helpers
from tests.support.iec61499.st_harness import LUA


@pytest.mark.parametrize("interpreter", LUA)
def test_every_lua_helper_loads(interpreter: str) -> None:
    LUA[interpreter].LuaRuntime().execute(lua_helpers(HELPERS))


def test_helpers_come_after_those_they_need() -> None:
    text = lua_helpers({"_round", "_delete"})
    assert text.index("function _trunc") < text.index("function _round")
    assert text.index("function _replace") < text.index("function _delete")
