"""Syntax tree to text: `parse_algorithm(print_algorithm(tree))` equals the tree."""

from __future__ import annotations

from typing import Final

from iec61499.literals import format_literal, format_real
from iec61499.st import ast
from iec61499.types import ELEMENTARY

_LEVELS: Final = {
    "OR": 0, "XOR": 1, "AND": 2, "=": 3, "<>": 3, "<": 4, ">": 4, "<=": 4, ">=": 4,
    "+": 5, "-": 5, "*": 6, "/": 6, "MOD": 6, "**": 7,
}  # fmt: skip
_UNARY: Final = 8
_SELF_TYPED: Final = ("TIME", "LTIME", "STRING", "WSTRING", "DATE", "LDATE", "TOD", "LTOD", "DT", "LDT")
"""Types whose literals say themselves what they are."""
_INDENT: Final = "  "


def print_algorithm(algorithm: ast.ParsedAlgorithm) -> str:
    """The algorithm as text, with `ALGORITHM name ... END_ALGORITHM` when it has a name."""
    lines = [line for declaration in algorithm.declarations for line in _declaration(declaration)]
    lines += _body(algorithm.body, "")
    if algorithm.name:
        lines = [f"ALGORITHM {algorithm.name}", *lines, "END_ALGORITHM"]
    return "".join(line + "\n" for line in lines)


def print_expression(expression: ast.Expression) -> str:
    """The expression as text, with no parentheses but the needed ones."""
    return _expression(expression, 0)


def _declaration(node: ast.Declaration) -> list[str]:
    bounds = ", ".join(f"{print_expression(b.low)}..{print_expression(b.high)}" for b in node.type_name.bounds)
    type_name = f"ARRAY [{bounds}] OF {node.type_name.name}" if bounds else node.type_name.name
    initial = ""
    if isinstance(node.initial, ast.Elements):
        initial = f" := {_element(node.initial)}"
    elif node.initial is not None:
        initial = f" := {print_expression(node.initial)}"
    keyword = "VAR CONSTANT" if node.constant else "VAR"
    return [keyword, f"{_INDENT}{node.name} : {type_name}{initial};", "END_VAR"]


def _element(item: ast.Expression | ast.Repeated | ast.Elements) -> str:
    match item:
        case ast.Elements(items=items):
            return f"[{', '.join(map(_element, items))}]"
        case ast.Repeated(count=count, value=value):
            return f"{count}({print_expression(value)})"
    return print_expression(item)


def _body(body: tuple[ast.Statement, ...], indent: str) -> list[str]:
    return [line for statement in body for line in _statement(statement, indent)]


def _statement(node: ast.Statement, indent: str) -> list[str]:
    deeper = indent + _INDENT
    match node:
        case ast.Assignment(target=target, value=value):
            return [f"{indent}{print_expression(target)} := {print_expression(value)};"]
        case ast.Invocation(block=block, arguments=arguments):
            given = ", ".join(
                f"{a.name} {'=>' if a.is_output else ':='} {print_expression(a.value)}" for a in arguments
            )
            return [f"{indent}{print_expression(block)}({given});"]
        case ast.If(branches=branches, otherwise=otherwise):
            lines = []
            for keyword, branch in zip(["IF"] + ["ELSIF"] * len(branches), branches, strict=False):
                lines += [f"{indent}{keyword} {print_expression(branch.condition)} THEN", *_body(branch.body, deeper)]
            return [*lines, *_otherwise(otherwise, indent), f"{indent}END_IF;"]
        case ast.Case(selector=selector, branches=cases, otherwise=otherwise):
            lines = [f"{indent}CASE {print_expression(selector)} OF"]
            for case in cases:
                lines += [f"{deeper}{', '.join(_label(label) for label in case.labels)}:"]
                lines += _body(case.body, deeper + _INDENT)
            return [*lines, *_otherwise(otherwise, indent), f"{indent}END_CASE;"]
        case ast.For(variable=variable, start=start, stop=stop, step=step, body=body):
            by = f" BY {print_expression(step)}" if step is not None else ""
            span = f"{print_expression(variable)} := {print_expression(start)} TO {print_expression(stop)}{by}"
            return [f"{indent}FOR {span} DO", *_body(body, deeper), f"{indent}END_FOR;"]
        case ast.While(condition=condition, body=body):
            return [f"{indent}WHILE {print_expression(condition)} DO", *_body(body, deeper), f"{indent}END_WHILE;"]
        case ast.Repeat(body=body, condition=condition):
            until = f"{indent}UNTIL {print_expression(condition)}"
            return [f"{indent}REPEAT", *_body(body, deeper), until, f"{indent}END_REPEAT;"]
        case ast.Exit():
            return [f"{indent}EXIT;"]
        case ast.Continue():
            return [f"{indent}CONTINUE;"]
        case ast.Return():
            return [f"{indent}RETURN;"]


def _otherwise(body: tuple[ast.Statement, ...], indent: str) -> list[str]:
    return [f"{indent}ELSE", *_body(body, indent + _INDENT)] if body else []


def _label(label: ast.Expression | ast.Range) -> str:
    if isinstance(label, ast.Range):
        return f"{print_expression(label.low)}..{print_expression(label.high)}"
    return print_expression(label)


def _expression(node: ast.Expression, minimum: int) -> str:
    """The text, in parentheses when its outermost operator binds less tightly than minimum."""
    match node:
        case ast.Literal():
            return _literal(node)
        case ast.VariableAccess(name=name, steps=steps):
            return name + "".join(map(_step, steps)).replace("][", ", ")
        case ast.Call(function=function, arguments=arguments, names=names):
            given = zip(names or [""] * len(arguments), arguments, strict=True)
            return f"{function}({', '.join(f'{n} := ' * bool(n) + _expression(a, 0) for n, a in given)})"
        case ast.Unary(operator=operator, operand=operand):
            space = " " if operator == "NOT" else ""
            text, level = f"{operator}{space}{_expression(operand, _UNARY)}", _UNARY
        case ast.Binary(operator=operator, left=left, right=right):
            level = _LEVELS[operator]
            # operators of one level associate to the left
            text = f"{_expression(left, level)} {operator} {_expression(right, level + 1)}"
    return text if level >= minimum else f"({text})"


def _step(step: ast.Expression | ast.Member | ast.Part) -> str:
    match step:
        case ast.Member(name=name):
            return f".{name}"
        case ast.Part(size=size, number=number):
            return f".%{size}{number}"
    return f"[{_expression(step, 0)}]"


def _literal(node: ast.Literal) -> str:
    value = node.value
    if not node.type_name:
        return (
            str(value).upper()
            if isinstance(value, bool)
            else format_real(value)
            if isinstance(value, float)
            else str(value)
        )
    if node.type_name not in ELEMENTARY:
        return f"{node.type_name}#{value}"
    text = format_literal(value, ELEMENTARY[node.type_name])
    return text if node.type_name in _SELF_TYPED else f"{node.type_name}#{text}"
