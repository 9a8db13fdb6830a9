"""Checked algorithms to C99 functions over the structure of their block.

A function works on copies of what it assigns and stores them at its end, so that one that finds a fault changes
nothing, as in the Python runtime.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from iec61499.errors import FunctionBlockError
from iec61499.st import typed
from iec61499.st.ast import Position
from iec61499.st.c.expressions import CExpressions, Places, refuse
from iec61499.st.c.names import c_name, c_type, check_supported, declaration, initialiser
from iec61499.st.dataflow import accesses
from iec61499.types import DataType, ElementaryType

_INDENT: Final = "    "
_RUN: Final = re.compile(r"\brun\b")


@dataclass(frozen=True, slots=True)
class CFunction:
    """A C function.

    Attributes:
        lines: its definition.
        can_fail: whether it can find a fault.
    """

    lines: tuple[str, ...]
    can_fail: bool


@dataclass(frozen=True, slots=True)
class CCondition:
    """A condition over `self`.

    Attributes:
        text: the C expression.
        locals: declarations that it needs above it.
        can_fail: whether it can find a fault.
    """

    text: str
    locals: tuple[str, ...]
    can_fail: bool


def c_function(checked: typed.CheckedAlgorithm, signature: str, places: Places) -> CFunction:
    """The definition of a function for an algorithm.

    Args:
        checked: the algorithm.
        signature: the head of the function, whose arguments are `self`, the block, and `run`.
        places: collects the places of faults.

    Raises:
        FunctionBlockError: the algorithm needs what C cannot do; names file, line and column.
    """
    try:
        return _CGenerator(checked, places).function(signature)
    except RecursionError:
        raise FunctionBlockError(f"algorithm {checked.name} is nested too deeply: split it") from None


def c_condition(checked: typed.Expression, places: Places) -> CCondition:
    """The condition of a transition. Raises as `c_function` does."""
    expressions = CExpressions(lambda name: f"self->{c_name(name)}", places)
    text = expressions.open(checked)
    return CCondition(text, tuple(expressions.locals), expressions.can_fail)


class _CGenerator:
    def __init__(self, checked: typed.CheckedAlgorithm, places: Places) -> None:
        self._checked = checked
        self._access = accesses(checked)
        self._places = places
        self._expressions = CExpressions(self._name, places)
        self._tables: list[str] = []
        self._names = 0
        self._returns = False

    def _name(self, name: str) -> str:
        own = name in self._checked.temporaries or name in self._access.writes
        return c_name(name) if own else f"self->{c_name(name)}"

    def function(self, signature: str) -> CFunction:
        checked, access = self._checked, self._access
        for data_type in (*checked.variables.values(), *checked.temporaries.values()):
            check_supported(data_type, _position(checked))
        body = self._body(checked.body)
        lines = [*self._tables, *(f"{text};" for text in self._expressions.locals)]
        for name, data_type in checked.temporaries.items():
            lines += [*_variable(name, data_type, None), f"(void){c_name(name)};"]
        for name in access.writes:
            source = f"self->{c_name(name)}" if name in access.reads else None
            lines += _variable(name, checked.variables[name], source)
        declarations, others = _sorted(lines)
        lines = [*declarations, *others, *body]
        if self._returns:
            lines.append("end:")
        if self._expressions.can_fail and access.writes:
            lines += ["if (!fb_fine(run)) {", f"{_INDENT}return;", "}"]
        for name in access.writes:
            lines += moved(f"self->{c_name(name)}", c_name(name), checked.variables[name])
        if self._returns and not access.writes:
            lines.append(";")
        if not any(_RUN.search(line) for line in lines):
            lines.insert(len(declarations), "(void)run;")
        if not any("self->" in line for line in lines):
            lines.insert(len(declarations), "(void)self;")
        return CFunction((signature, "{", *_indented(lines), "}"), self._expressions.can_fail)

    def _body(self, body: typed.Body) -> list[str]:
        return [line for statement in body for line in self._statement(statement)]

    def _block(self, body: typed.Body) -> list[str]:
        return _indented(self._body(body))

    def _statement(self, node: typed.Statement) -> list[str]:
        match node:
            case typed.Store():
                return self._store(node)
            case typed.If(branches=branches, otherwise=otherwise):
                conditions = [(self._expressions.open(branch.condition), branch.body) for branch in branches]
                return self._branches(conditions, otherwise)
            case typed.Case():
                return self._case(node)
            case typed.For():
                return self._for(node)
            case typed.While(at=at, condition=condition, body=body):
                test = [f"if (!fb_again(run, {self._expressions.place(at)})) {{", f"{_INDENT}break;", "}"]
                stop = [f"if (!({self._expressions.open(condition)})) {{", f"{_INDENT}break;", "}"]
                return ["for (;;) {", *_indented([*test, *stop]), *self._block(body), "}"]
            case typed.Repeat():
                return self._repeat(node)
            case typed.Exit():
                return ["break;"]
            case typed.Continue():
                return ["continue;"]
            case typed.Return():
                self._returns = True
                return ["goto end;"]
        refuse(node.at, type(node).__name__)

    def _store(self, node: typed.Store) -> list[str]:
        target = self._name(node.name) + self._expressions.subscripts(node.indices, node.arrays)
        if not isinstance(node.type, ElementaryType):
            return [f"memmove(&{target}, &{self._aggregate(node.value)}, sizeof {target});"]
        if node.type.kind == "string":
            return [f"fb_assign(&{target}, {self._expressions.open(node.value)});"]
        return [f"{target} = {self._expressions.open(node.value)};"]

    def _aggregate(self, node: typed.Expression) -> str:
        """The C lvalue of an array or structure."""
        match node:
            case typed.Load(name=name):
                return self._name(name)
            case typed.Element(name=name, indices=indices, arrays=arrays):
                return self._name(name) + self._expressions.subscripts(indices, arrays)
            case typed.Const(type=data_type, value=value):
                name = self._fresh("table")
                self._tables.append(f"static const {declaration(name, data_type)} = {initialiser(value, data_type)};")
                return name
        refuse(node.at, f"an expression of {node.type}")

    def _fresh(self, kind: str) -> str:
        self._names += 1
        return f"fb_{kind}_{self._names}"

    def _branches(self, branches: Iterable[tuple[str, typed.Body]], otherwise: typed.Body) -> list[str]:
        lines: list[str] = []
        for condition, body in branches:
            head = "} else if" if lines else "if"
            lines += [f"{head} ({condition}) {{", *self._block(body)]
        if not lines:
            return self._body(otherwise)
        if otherwise:
            lines += ["} else {", *self._block(otherwise)]
        return [*lines, "}"]

    def _case(self, node: typed.Case) -> list[str]:
        if isinstance(node.selector, typed.Load):
            selector, lines = self._expressions.open(node.selector), []
        else:
            selector = self._fresh("case")
            kind = c_type(node.selector.type)
            lines = [f"const {kind} {selector} = {self._expressions.open(node.selector)};"]
        branches = [(_matches(selector, branch.labels), branch.body) for branch in node.branches]
        lines += self._branches(branches, node.otherwise)
        return lines if len(lines) < 2 or not lines[0].startswith("const") else ["{", *_indented(lines), "}"]

    def _for(self, node: typed.For) -> list[str]:
        expressions, counter = self._expressions, self._name(node.name)
        place = expressions.place(node.at)
        kind, suffix = ("int64_t", "signed") if node.type.minimum < 0 else ("uint64_t", "unsigned")
        first, step, rounds, round_ = (self._fresh(name) for name in ("first", "step", "rounds", "round"))
        step_code = expressions.open(node.step)
        lines = [f"const {kind} {first} = {expressions.open(node.start)};", f"const {kind} {step} = {step_code};"]
        call = f"fb_rounds_{suffix}({first}, {expressions.open(node.stop)}, {step})"
        if isinstance(node.step, typed.Const):
            lines.append(f"const uint64_t {rounds} = {call};")
        else:
            lines.append(f"const uint64_t {rounds} = {step} == 0 ? 0 : {call};")
        lines.append(f"uint64_t {round_};")
        if not isinstance(node.step, typed.Const):
            lines += [f"if ({step} == 0) {{", f"{_INDENT}fb_fail(run, FB_NO_STEP, {place});", "}"]
        value = f"({c_type(node.type)})((uint64_t){first} + {round_} * (uint64_t){step})"
        lines += [
            f"for ({round_} = 0; {round_} < {rounds} && fb_again(run, {place}); ++{round_}) {{",
            f"{_INDENT}{counter} = {value};",
            *self._block(node.body),
            "}",
            f"if ({round_} >= {rounds} && fb_again(run, {place})) {{",
            f"{_INDENT}{counter} = {value};",
            "}",
        ]
        return ["{", *_indented(lines), "}"]

    def _repeat(self, node: typed.Repeat) -> list[str]:
        """CONTINUE goes on with the condition, which therefore opens every round but the first."""
        condition = self._expressions.open(node.condition)
        again, place = self._fresh("again"), self._expressions.place(node.at)
        lines = [
            f"bool {again} = false;",
            f"while (!({again} && ({condition})) && fb_again(run, {place})) {{",
            f"{_INDENT}{again} = true;",
            *self._block(node.body),
            "}",
        ]
        return ["{", *_indented(lines), "}"]


def _position(checked: typed.CheckedAlgorithm) -> Position:
    """Where the first statement stands."""
    return next((node.at for node in typed.walk(checked.body) if hasattr(node, "at")), Position("", 0, 0))


def _variable(name: str, data_type: DataType, source: str | None) -> list[str]:
    """The declaration of a local variable that starts with the value of another place, or with zeros."""
    local = c_name(name)
    if isinstance(data_type, ElementaryType) and data_type.kind != "string":
        return [f"{declaration(local, data_type)} = {source or '0'};"]
    if source is not None:
        return [f"{declaration(local, data_type)};", *moved(local, source, data_type)]
    if isinstance(data_type, ElementaryType):
        return [f"{declaration(local, data_type)};", f"{local}.length = 0;"]
    return [f"{declaration(local, data_type)};", f"memset(&{local}, 0, sizeof {local});"]


def moved(target: str, source: str, data_type: DataType) -> list[str]:
    """The assignment of one place to another one of the same type."""
    if not isinstance(data_type, ElementaryType):
        return [f"memcpy(&{target}, &{source}, sizeof {target});"]
    if data_type.kind == "string":
        return [f"fb_copy(&{target}, &{source});"]
    return [f"{target} = {source};"]


def _sorted(lines: list[str]) -> tuple[list[str], list[str]]:
    """Declarations, and the statements that go with them."""
    statements = [line for line in lines if line.startswith(("(void)", "mem", "fb_copy")) or ".length = " in line]
    return [line for line in lines if line not in statements], statements


def _matches(selector: str, labels: tuple[tuple[int, int], ...]) -> str:
    tests = [
        f"{selector} == {low}" if low == high else f"({low} <= {selector} && {selector} <= {high})"
        for low, high in labels
    ]
    return " || ".join(tests)


def _indented(lines: Iterable[str]) -> list[str]:
    return [_INDENT + line if line and line != "end:" else line for line in lines]
