"""Runs one algorithm on every backend."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from types import SimpleNamespace
from typing import Any

import lupa.lua51
import lupa.lua54
import lupa.luajit21

from iec61499.st.check import check_algorithm
from iec61499.st.lua.helpers import lua_helpers
from iec61499.st.lua.translate import lua_source
from iec61499.st.parser import parse_algorithm
from iec61499.st.python.translate import compile_algorithm, python_source
from iec61499.st.semantics import ITERATION_LIMIT
from iec61499.st.typed import CheckedAlgorithm
from iec61499.types import ArrayType, DataType, elementary

LUA = {"Lua 5.1": lupa.lua51, "Lua 5.4": lupa.lua54, "LuaJIT 2.1": lupa.luajit21}


def scope_of(types: Mapping[str, str | DataType]) -> dict[str, DataType]:
    return {name: elementary(t) if isinstance(t, str) else t for name, t in types.items()}


def check(text: str, **types: str | DataType) -> CheckedAlgorithm:
    scope = scope_of(types)
    return check_algorithm(parse_algorithm(text, "a.fbt"), scope, scope.keys())


def instance(scope: Mapping[str, DataType], values: Mapping[str, Any]) -> SimpleNamespace:
    variables = {name: values.get(name, t.default) for name, t in scope.items()}
    return SimpleNamespace(**variables, resource__=SimpleNamespace(iterations=iter(range(ITERATION_LIMIT))))


def variables_of(state: SimpleNamespace) -> dict[str, Any]:
    """What an algorithm has left in its variables."""
    return {name: value for name, value in vars(state).items() if name != "resource__"}


def run_python(checked: CheckedAlgorithm, scope: Mapping[str, DataType], values: Mapping[str, Any]) -> dict[str, Any]:
    state = instance(scope, values)
    compile_algorithm(checked, "ALGORITHM")(state)
    return variables_of(state)


def run_exact(checked: CheckedAlgorithm, scope: Mapping[str, DataType], values: Mapping[str, Any]) -> dict[str, Any]:
    """Runs the exact version alone, also where the fast one would have done."""
    code = python_source(checked)
    lines = code.exact_lines or code.lines
    loads = [f"{n} = s.{n}[:]" if isinstance(scope[n], ArrayType) else f"{n} = s.{n}" for n in code.reads]
    stores = [f"s.{n} = {n}" for n in code.writes]
    source = "\n".join(["def run(s):", *("    " + line for line in [*loads, *lines, *stores, "pass"])])
    namespace = dict(code.exact_globals if code.exact_lines else code.globals)
    exec(source, namespace)
    state = instance(scope, values)
    namespace["run"](state)
    return variables_of(state)


def run_lua(
    checked: CheckedAlgorithm, scope: Mapping[str, DataType], values: Mapping[str, Any], interpreter: str
) -> dict[str, Any]:
    source = lua_source(checked, lambda name: f"V.{name}")
    lua = LUA[interpreter].LuaRuntime()
    function = lua.execute(f"{lua_helpers(source.helpers)}return function(V)\n{source.body}return V\nend")
    start = vars(instance(scope, values))
    table = lua.table_from({name: _to_lua(value, lua) for name, value in start.items()})
    result = function(table)
    # reals as text, since lupa makes integers of whole numbers and loses the sign of zero
    digits = lua.eval('function(x, i) if i then x = x[i] end return string.format("%.17g", x) end')
    by_name = lua.eval("function(V, f, name, i) return f(V[name], i) end")
    return {name: _from_lua(result[name], partial(by_name, result, digits, name), t) for name, t in scope.items()}


def _to_lua(value: Any, lua: Any) -> Any:
    return lua.table_from([_to_lua(item, lua) for item in value]) if isinstance(value, list) else value


def _from_lua(value: Any, digits: Callable[..., str], data_type: DataType) -> Any:
    if isinstance(data_type, ArrayType):
        return [_from_lua(value[i], partial(digits, i), data_type.element) for i in range(1, data_type.length + 1)]
    if data_type.kind in ("signed", "unsigned", "bits"):
        assert int(value) == value
        return int(value)
    return float(digits()) if data_type.kind == "real" else value


def same(a: Any, b: Any) -> bool:
    """Bit equality, any NaN being equal to any other."""
    if isinstance(a, list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if type(a) is not type(b):
        return False
    if isinstance(a, float):
        return (math.isnan(a) and math.isnan(b)) or (a == b and math.copysign(1, a) == math.copysign(1, b))
    return bool(a == b)
