"""Structured Text (IEC 61131-3): parser, checker, printer, and compilers to Python and Lua."""

from dtwin.iec61499.st.check import check_algorithm, check_expression
from dtwin.iec61499.st.lua.helpers import lua_helpers
from dtwin.iec61499.st.lua.translate import LuaSource, lua_condition, lua_source
from dtwin.iec61499.st.parser import parse_algorithm, parse_expression
from dtwin.iec61499.st.printer import print_algorithm, print_expression
from dtwin.iec61499.st.python.expressions import python_name
from dtwin.iec61499.st.python.translate import (
    CONDITION_GLOBALS,
    PythonCode,
    compile_algorithm,
    compile_condition,
    python_source,
)
from dtwin.iec61499.st.typed import CheckedAlgorithm

__all__ = [
    "CONDITION_GLOBALS",
    "CheckedAlgorithm",
    "LuaSource",
    "PythonCode",
    "check_algorithm",
    "check_expression",
    "compile_algorithm",
    "compile_condition",
    "lua_condition",
    "lua_helpers",
    "lua_source",
    "parse_algorithm",
    "parse_expression",
    "print_algorithm",
    "print_expression",
    "python_name",
    "python_source",
]
