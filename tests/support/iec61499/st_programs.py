"""Hypothesis strategies for well-typed programs, as syntax trees."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

from hypothesis import strategies as st

from iec61499.st import ast
from iec61499.types import ArrayType, DataType, ElementaryType, elementary

AT = ast.Position()
SCOPE: dict[str, DataType] = {
    **dict.fromkeys(("X", "Y", "Z"), elementary("LREAL")),
    **dict.fromkeys(("R", "Q"), elementary("REAL")),
    **dict.fromkeys(("I", "J"), elementary("DINT")),
    **dict.fromkeys(("K", "M"), elementary("INT")),
    "U": elementary("UDINT"),
    "N": elementary("USINT"),
    **dict.fromkeys(("B", "C"), elementary("BOOL")),
    "W": elementary("WORD"),
    "D": elementary("DWORD"),
    "S": elementary("STRING"),
    "A": ArrayType(elementary("LREAL"), -1, 2),
    **dict.fromkeys(("F1", "F2", "F3"), elementary("DINT")),
}
VARIABLES = {
    "LREAL": ["X", "Y", "Z"], "REAL": ["R", "Q"], "DINT": ["I", "J"], "INT": ["K", "M"],
    "UDINT": ["U"], "USINT": ["N"], "BOOL": ["B", "C"], "WORD": ["W"], "DWORD": ["D"], "STRING": ["S"],
}  # fmt: skip
INTEGERS = ("DINT", "INT", "UDINT", "USINT")
WIDER = {
    "DINT": ("INT", "USINT"),
    "INT": ("USINT",),
    "UDINT": ("USINT",),
    "LREAL": ("REAL", "DINT", "UDINT"),
    "REAL": ("INT",),
}

reals = st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from(
    [0.0, 1.0, 0.5, 2.0, 3.0, 1e300, 1e-300, 0.1]
)


def literal(type_name: str) -> st.SearchStrategy[ast.Expression]:
    if type_name in ("LREAL", "REAL"):
        values = (
            reals.map(abs) if type_name == "LREAL" else st.floats(0, 2.0**127, width=32) | st.sampled_from([0.5, 3.0])
        )
        return values.map(lambda v: ast.Literal(AT, v, "" if type_name == "LREAL" else "REAL"))
    if type_name == "BOOL":
        return st.booleans().map(lambda v: ast.Literal(AT, v, ""))
    if type_name == "STRING":
        return st.text("ab1. -$'\n", max_size=4).map(lambda v: ast.Literal(AT, v, "STRING"))
    t = elementary(type_name)
    extremes = st.sampled_from([t.minimum, t.maximum, 0, 1, 2, 3, 7])
    return (extremes | st.integers(t.minimum, t.maximum)).map(lambda v: ast.Literal(AT, v, type_name))


def binary(operators: list[str], operand: st.SearchStrategy[Any]) -> st.SearchStrategy[ast.Expression]:
    return st.builds(lambda o, a, b: ast.Binary(AT, o, a, b), st.sampled_from(operators), operand, operand)


def call(names: list[str], *arguments: st.SearchStrategy[Any]) -> st.SearchStrategy[ast.Expression]:
    return st.builds(lambda n, *a: ast.Call(AT, n, tuple(a)), st.sampled_from(names), *arguments)


def unary(operator: str, operand: st.SearchStrategy[Any]) -> st.SearchStrategy[ast.Expression]:
    return operand.map(lambda a: ast.Unary(AT, operator, a))


def leaf(type_name: str) -> st.SearchStrategy[ast.Expression]:
    variables = st.sampled_from([ast.VariableAccess(AT, name) for name in VARIABLES[type_name]])
    return variables | variables | literal(type_name)


def choose(options: list[st.SearchStrategy[Any]]) -> st.SearchStrategy[Any]:
    """One of the options, each as likely as any other (`one_of` weighs by the leaves below)."""
    return st.sampled_from(options).flatmap(lambda option: option)


@cache
def expression(type_name: str, depth: int) -> st.SearchStrategy[ast.Expression]:
    if depth == 0:
        return leaf(type_name)
    own = st.deferred(lambda: expression(type_name, depth - 1))
    boolean = st.deferred(lambda: expression("BOOL", depth - 1))
    options = [leaf(type_name), call(["SEL"], boolean, own, own)]

    def other(name: str) -> st.SearchStrategy[ast.Expression]:
        return st.deferred(lambda: expression(name, depth - 1))

    for narrower in WIDER.get(type_name, ()):
        options.append(call(["MAX"], own, other(narrower)))
        if type_name == "LREAL":
            options.append(call(["ADD", "SUB", "MUL", "DIV"], own, other(narrower)))
    if type_name in ("LREAL", "REAL"):
        options += [
            binary(["+", "-", "*", "/"], own),
            unary("-", own),
            call(["MIN", "MAX"], own, own),
            call(["ABS"], own),
        ]
        options += [
            call([f"{n}_TO_{type_name}" for n in INTEGERS[:1]], other("DINT")),
            call(["LIMIT"], own, own, own),
        ]
    if type_name == "LREAL":
        options += [binary(["+", "-", "*", "/", "**"], own)] * 2
        options += [call(["SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN"], own)]
        options += [call(["ATAN2"], own, own), other("STRING").map(lambda a: ast.Call(AT, "STRING_TO_LREAL", (a,)))]
        indices = st.integers(-1, 2).map(lambda i: ast.Literal(AT, i, "") if i >= 0 else ast.Literal(AT, i, "DINT"))
        options += [indices.map(lambda i: ast.VariableAccess(AT, "A", (i,)))]
        options += [st.just(ast.Binary(AT, "**", ast.VariableAccess(AT, "X"), ast.Literal(AT, 2, "")))]
    if type_name == "REAL":
        options += [other("LREAL").map(lambda a: ast.Call(AT, "LREAL_TO_REAL", (a,)))]
    if type_name in INTEGERS:
        options += [binary(["+", "-", "*", "/", "MOD"], own)] * 2
        options += [call(["MIN", "MAX"], own, own), call(["ABS"], own), unary("-", own)]
        options += [call(["MUX"], other("USINT"), own, own, own)]
        options += [call([f"LREAL_TO_{type_name}", f"LREAL_TRUNC_{type_name}"], other("LREAL"))]
        options += [
            call([f"{n}_TO_{type_name}"], other(n))
            for n in ("DINT", "UDINT", "INT", "BOOL", "WORD")
            if n != type_name
        ]
        if type_name == "INT":
            options += [call(["LEN"], other("STRING")), call(["FIND"], other("STRING"), other("STRING"))]
    if type_name == "BOOL":
        options += [binary(["AND", "OR", "XOR", "=", "<>"], own), unary("NOT", own)]
        comparisons = ["<", ">", "<=", ">=", "=", "<>"]
        options += [binary(comparisons, other(n)) for n in ("LREAL", "DINT", "UDINT", "STRING", "WORD")]
        options += [binary(comparisons, other("INT") | other("USINT")), call(["DINT_TO_BOOL"], other("DINT"))]
    if type_name in ("WORD", "DWORD"):
        options += [binary(["AND", "OR", "XOR"], own), unary("NOT", own)]
        options += [call(["SHL", "SHR", "ROL", "ROR"], own, other("USINT") | literal("USINT"))]
        options += [call([f"DINT_TO_{type_name}"], other("DINT"))]
    if type_name == "STRING":
        options += [call(["CONCAT"], own, own), call(["LEFT", "RIGHT"], own, other("INT"))]
        options += [
            call(["MID", "DELETE"], own, other("INT"), other("USINT")),
            call(["INSERT"], own, own, other("USINT")),
        ]
        options += [call(["REPLACE"], own, own, other("USINT"), other("USINT"))]
        options += [call([f"{n}_TO_STRING"], other(n)) for n in ("DINT", "LREAL", "BOOL", "UDINT", "REAL")]
    return choose(options)


@cache
def assignment(depth: int) -> st.SearchStrategy[ast.Statement]:
    def assign(name: str, type_name: str) -> st.SearchStrategy[ast.Statement]:
        return expression(type_name, depth).map(lambda v: ast.Assignment(AT, ast.VariableAccess(AT, name), v))

    scalars = [assign(name, type_name) for type_name, names in VARIABLES.items() for name in names]
    element = st.builds(
        lambda i, v: ast.Assignment(AT, ast.VariableAccess(AT, "A", (ast.Literal(AT, i, ""),)), v),
        st.integers(0, 2),
        expression("LREAL", depth),
    )
    return choose([*scalars, element])


@cache
def body(depth: int, loops: int, inside: bool = False) -> st.SearchStrategy[tuple[ast.Statement, ...]]:
    return st.lists(statement(depth, loops, inside), max_size=3).map(tuple)


@cache
def statement(depth: int, loops: int, inside: bool) -> st.SearchStrategy[ast.Statement]:
    """loops counts the loops still allowed inside; inside tells whether EXIT and CONTINUE may stand here."""
    options: list[st.SearchStrategy[Any]] = [assignment(2)] * 3
    if inside:
        options += [st.just(ast.Exit(AT)), st.just(ast.Continue(AT))]
    if depth > 0:
        inner = st.deferred(lambda: body(depth - 1, loops, inside))
        branch = st.builds(lambda c, b: ast.Branch(AT, c, b), expression("BOOL", 2), inner)
        options += [
            st.builds(lambda bs, o: ast.If(AT, tuple(bs), o), st.lists(branch, min_size=1, max_size=3), inner)
        ]
        options += [case(inner), st.just(ast.Return(AT))]
        if loops > 0:
            looped = st.deferred(lambda: body(depth - 1, loops - 1, True))
            counter = f"F{loops}"
            options += [counted(counter, looped), st.builds(lambda b: bounded_while(counter, b), looped)]
            options += [st.builds(lambda b: bounded_repeat(counter, b), looped)]
    return choose(options)


def case(inner: st.SearchStrategy[Any]) -> st.SearchStrategy[ast.Statement]:
    number = st.integers(0, 9).map(lambda v: ast.Literal(AT, v, ""))
    label = (
        number
        | unary("-", number)
        | st.integers(0, 5).map(lambda v: ast.Range(AT, ast.Literal(AT, v, ""), ast.Literal(AT, v + 4, "")))
    )
    branch = st.builds(lambda ls, b: ast.CaseBranch(AT, tuple(ls), b), st.lists(label, min_size=1, max_size=3), inner)
    selector = expression("INT", 1)
    return st.builds(lambda s, bs, o: ast.Case(AT, s, tuple(bs), o), selector, st.lists(branch, max_size=3), inner)


def counted(counter: str, inner: st.SearchStrategy[Any]) -> st.SearchStrategy[ast.Statement]:
    bound = st.integers(0, 4).map(lambda v: ast.Literal(AT, v, "")) | st.just(ast.VariableAccess(AT, "N"))
    step = (
        st.none()
        | st.sampled_from([ast.Literal(AT, v, "") for v in (1, 2)])
        | st.just(ast.Unary(AT, "-", ast.Literal(AT, 1, "")))
    )
    return st.builds(
        lambda a, b, s, i: ast.For(AT, ast.VariableAccess(AT, counter), a, b, s, i), bound, bound, step, inner
    )


def _increment(counter: str) -> ast.Statement:
    variable = ast.VariableAccess(AT, counter)
    return ast.Assignment(AT, variable, ast.Binary(AT, "+", variable, ast.Literal(AT, 1, "")))


def bounded_while(counter: str, inner: tuple[ast.Statement, ...]) -> ast.Statement:
    condition = ast.Binary(AT, "<", ast.VariableAccess(AT, counter), ast.Literal(AT, 4, ""))
    return ast.While(AT, condition, (_increment(counter), *inner))


def bounded_repeat(counter: str, inner: tuple[ast.Statement, ...]) -> ast.Statement:
    condition = ast.Binary(AT, ">", ast.VariableAccess(AT, counter), ast.Literal(AT, 3, ""))
    return ast.Repeat(AT, (_increment(counter), *inner), condition)


programs = st.lists(statement(3, 2, False), min_size=1, max_size=5).map(
    lambda b: ast.ParsedAlgorithm(AT, "", (), tuple(b))
)


def value(name: str) -> st.SearchStrategy[Any]:
    t = SCOPE[name]
    if isinstance(t, ArrayType):
        return st.lists(reals, min_size=t.length, max_size=t.length)
    assert isinstance(t, ElementaryType)
    if t.kind == "real":
        return (reals | st.sampled_from([math.inf, -math.inf, math.nan, -0.0])).map(t.wrap)
    if t.kind == "bool":
        return st.booleans()
    if t.kind == "string":
        return st.text("ab12.5e", max_size=6)
    return (
        st.integers(-3, 5).map(t.wrap) | st.integers(t.minimum, t.maximum) | st.sampled_from([t.minimum, t.maximum])
    )


states = st.fixed_dictionaries({name: value(name) for name in SCOPE if name not in ("F1", "F2", "F3")})
