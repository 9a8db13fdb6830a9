"""Checked algorithms to Lua that runs unchanged on Lua 5.1 to 5.4 and LuaJIT, for FORTE's Lua types.

Lua 5.1 has neither `goto` nor `continue`: a body that CONTINUE leaves stands in `repeat ... until true`, and
RETURN sets a flag that every loop around it looks at. So the code falls through at its end in any case, and whoever
embeds it can store outputs behind it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from iec61499.st import typed
from iec61499.st.ast import fail
from iec61499.st.fragment import Fragment
from iec61499.st.lua.expressions import ATOM, LuaExpressions, refuse, where
from iec61499.st.semantics import ITERATION_LIMIT
from iec61499.types import ArrayType


@dataclass(frozen=True, slots=True)
class LuaSource:
    """Generated Lua.

    Attributes:
        body: statements, or for a condition one expression.
        helpers: names to pass to `lua_helpers`, whose text must stand above.
    """

    body: str
    helpers: frozenset[str]


def lua_source(checked: typed.CheckedAlgorithm, rename: Callable[[str], str]) -> LuaSource:
    """The algorithm's statements.

    Args:
        checked: the algorithm.
        rename: gives the Lua expression that reads and assigns a variable of the block. An array must be a Lua
            variable holding a table counted from 1. Names that begin with `_` belong to this code.

    Raises:
        FunctionBlockError: the algorithm needs what Lua cannot do: 64-bit integers and TIME (numbers hold 53 bit), or
            conversions between reals and bit strings; names file, line and column.
    """
    generator = _LuaGenerator(checked, rename)
    return LuaSource(generator.algorithm(), frozenset(generator.expressions.used))


def lua_condition(checked: typed.Expression, rename: Callable[[str], str]) -> LuaSource:
    """The condition as a Lua expression. Raises as `lua_source` does."""
    expressions = LuaExpressions(rename)
    return LuaSource(expressions.text(checked), frozenset(expressions.used))


@dataclass(slots=True)
class _Loop:
    """A loop around the statement: its number, and whether its body stands in `repeat ... until true`."""

    number: int
    wrapped: bool


class _LuaGenerator:
    def __init__(self, checked: typed.CheckedAlgorithm, rename: Callable[[str], str]) -> None:
        self._checked = checked
        self._rename = rename
        self._loops: list[_Loop] = []
        self._count = 0
        self.expressions = LuaExpressions(self._name)

    def _name(self, name: str) -> str:
        return f"_v_{name}" if name in self._checked.temporaries else self._rename(name)

    def algorithm(self) -> str:
        nodes = list(typed.walk(self._checked.body))
        names = [self._name(name) for name in self._checked.temporaries]
        lines = [f"local {', '.join(names)}"] if names else []
        if any(isinstance(node, (typed.For, typed.While, typed.Repeat)) for node in nodes):
            lines.append("local _n = 0")
        if any(isinstance(node, typed.Return) for node in nodes):
            lines += ["local _r = false", "repeat", *self._body(self._checked.body), "until true"]
        else:
            lines += self._body(self._checked.body)
        return "".join(line + "\n" for line in lines)

    def _body(self, body: typed.Body) -> list[str]:
        return [line for statement in body for line in self._statement(statement)]

    def _statement(self, node: typed.Statement) -> list[str]:
        match node:
            case typed.Store():
                return [self._store(node)]
            case typed.Invoke(at=at, name=name):
                fail(at, f"block {name} inside a basic or simple block is not available in Lua: expected it beside")
            case typed.If(branches=branches, otherwise=otherwise):
                conditions = [(self.expressions.text(branch.condition), branch.body) for branch in branches]
                return self._branches(conditions, otherwise)
            case typed.Case(selector=selector, branches=cases, otherwise=otherwise):
                name = self._local("_s")
                conditions = [(_matches(name, case.labels), case.body) for case in cases]
                assign = f"local {name} = {self.expressions.text(selector)}"
                return ["do", assign, *self._branches(conditions, otherwise), "end"]
            case typed.For():
                return self._for(node)
            case typed.While(condition=condition, body=body):
                head = f"while {self.expressions.text(condition)} do"
                return self._loop(node, head, body, ["end"])
            case typed.Repeat(body=body, condition=condition):
                return self._loop(node, "repeat", body, [f"until {self.expressions.text(condition)}"])
            case typed.Exit():
                loop = self._loops[-1]
                return [*([f"_x{loop.number} = true"] if loop.wrapped else []), "do break end"]
            case typed.Continue():
                return ["do break end"]
            case typed.Return():
                return ["_r = true", "do break end"]

    def _local(self, prefix: str) -> str:
        self._count += 1
        return f"{prefix}{self._count}"

    def _store(self, node: typed.Store) -> str:
        refuse(node.type, node)
        value = self.expressions.text(node.value)
        if isinstance(node.type, ArrayType) and not isinstance(node.value, typed.Const):
            value = self.expressions.call("_copy", value)
        return f"{self._name(node.name)}{self.expressions.subscripts(node.indices, node.arrays)} = {value}"

    def _branches(self, branches: list[tuple[str, typed.Body]], otherwise: typed.Body) -> list[str]:
        if not branches:
            return self._body(otherwise)
        lines: list[str] = []
        for condition, body in branches:
            lines += [f"{'else' * bool(lines)}if {condition} then", *self._body(body)]
        if otherwise:
            lines += ["else", *self._body(otherwise)]
        return [*lines, "end"]

    def _for(self, node: typed.For) -> list[str]:
        refuse(node.type, node)
        expressions, variable = self.expressions, self._name(node.name)
        counter, stop, step = self._local("_k"), self._local("_e"), self._local("_d")
        lines = ["do", f"local {counter}, {stop} = {expressions.text(node.start)}, {expressions.text(node.stop)}"]
        if isinstance(node.step, typed.Const):
            step = str(node.step.value)
            going = f"{counter} {'<=' if node.step.value > 0 else '>='} {stop}"
        else:
            lines += [f"local {step} = {expressions.text(node.step)}"]
            lines += [f"if {step} == 0 then {expressions.call('_endless', where(node))} end"]
            going = f"{step} > 0 and {counter} <= {stop} or {step} < 0 and {counter} >= {stop}"
        advance = [f"{counter} = {counter} + {step}", f"{variable} = {self._after(node, counter)}", "end"]
        lines.append(f"{variable} = {counter}")
        return [*lines, *self._loop(node, f"while {going} do", node.body, advance), "end"]

    def _after(self, node: typed.For, counter: str) -> str:
        """The counter behind an iteration; beyond the stop it can leave the type's range."""
        stop, step = self.expressions.value(node.stop), self.expressions.value(node.step)
        return self.expressions.wrap(
            Fragment(counter, ATOM, stop.low + step.low, stop.high + step.high), node.type
        ).text

    def _loop(self, node: typed.Statement, head: str, body: typed.Body, tail: list[str]) -> list[str]:
        self._count += 1
        loop = _Loop(self._count, typed.continues(body))
        self._loops.append(loop)
        inner = self._body(body)
        self._loops.pop()
        endless = self.expressions.call("_endless", where(node))
        lines = [head, "_n = _n + 1", f"if _n > {ITERATION_LIMIT} then {endless} end"]
        returns = any(isinstance(part, typed.Return) for part in typed.walk(body))
        if loop.wrapped:
            leave = f"_x{loop.number} or _r" if returns else f"_x{loop.number}"
            inner = [f"local _x{loop.number} = false", "repeat", *inner, "until true", f"if {leave} then break end"]
        return [*lines, *inner, *tail, *(["if _r then break end"] if returns else [])]


def _matches(selector: str, labels: tuple[tuple[int, int], ...]) -> str:
    return " or ".join(
        f"{selector} == {low}" if low == high else f"{selector} >= {low} and {selector} <= {high}"
        for low, high in labels
    )
