"""Structured Text as Lua, for 4diac FORTE."""
