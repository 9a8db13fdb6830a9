"""Text to syntax tree."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, Final

from lark import Lark, Token, Transformer, Tree
from lark.exceptions import UnexpectedCharacters, UnexpectedEOF, UnexpectedInput, UnexpectedToken

from iec61499 import literals, types
from iec61499.errors import FunctionBlockError, choices
from iec61499.st import ast
from iec61499.st.comments import shifted, without_comments

GRAMMAR: Final = Path(__file__).with_name("grammar.lark")
"""Grammar of Structured Text."""
TABLES: Final = GRAMMAR.parent / "__pycache__" / "grammar.tables"
"""File of the parser's tables, which take longer to make than all algorithms of a cell to parse."""
MAXIMUM_LENGTH: Final = 200_000
"""Most characters of an algorithm or condition, which take a second or two to parse."""
_TERMINALS: Final = {
    "NAME": "a name",
    "INTEGER": "an integer",
    "REAL_NUMBER": "a number",
    "TRUTH": "TRUE or FALSE",
    "TYPED_LITERAL": "a typed literal",
    "STRING_LITERAL": "a string",
    "DURATION": "a duration",
    "DATE_LITERAL": "a date",
    "VALUE_LITERAL": "a value of an enumeration",
    "BOUNDED_STRING": "a string type",
    "PART": "a part such as %X0",
    "COMPARISON": "a comparison",
    "EQUALITY": "= or <>",
    "SIGN": "+ or -",
    "PRODUCT": "* or /",
    "POWER": "**",
    "AND": "AND",
    "$END": "the end",
}
_VALUE_STARTERS: Final = {
    "INTEGER",
    "REAL_NUMBER",
    "TRUTH",
    "TYPED_LITERAL",
    "STRING_LITERAL",
    "DURATION",
    "DATE_LITERAL",
    "VALUE_LITERAL",
    "LPAR",
    "NOT",
}
_FUNCTION_KEYWORDS: Final = {"AND", "OR", "XOR", "MOD"}
_OPERATORS: Final = {"OR", "XOR", "AND", "MOD", "EQUALITY", "COMPARISON", "SIGN", "PRODUCT", "POWER"}


@cache
def lark_parser() -> Lark:
    """The LALR(1) parser, built on first use. With the basic lexer keywords are reserved everywhere.

    Its tables are kept beside compiled Python, where that folder can be written, and built anew when the grammar or
    Lark has changed, or when the file cannot be read.
    """
    return Lark(
        GRAMMAR.read_text(encoding="utf-8"),
        parser="lalr",
        lexer="basic",
        start=["algorithm", "expression"],
        propagate_positions=True,
        cache=str(TABLES),
    )


@lru_cache(maxsize=1024)
def parse_algorithm(text: str, file: str = "", line: int = 1, column: int = 1) -> ast.ParsedAlgorithm:
    """Parses statements, optionally with `VAR ... END_VAR` and `ALGORITHM name ... END_ALGORITHM` around them.

    Args:
        text: the source.
        file, line, column: where the text starts, for the positions in the tree and in messages.

    Raises:
        FunctionBlockError: the text is not Structured Text; names the position, what was found and what fits there.
    """
    return _parse(text, "algorithm", ast.Position(file, line, column))


@lru_cache(maxsize=1024)
def parse_expression(text: str, file: str = "", line: int = 1, column: int = 1) -> ast.Expression:
    """Parses one expression, such as the condition of a transition. Raises as `parse_algorithm` does."""
    return _parse(text, "expression", ast.Position(file, line, column))


def _parse(text: str, start: str, origin: ast.Position) -> Any:
    if len(text) > MAXIMUM_LENGTH:
        raise FunctionBlockError(
            f"has {len(text)} characters: expected at most {MAXIMUM_LENGTH}; divide the algorithm", *origin
        )
    text = without_comments(text, origin)
    try:
        return TreeBuilder(origin).transform(lark_parser().parse(text, start=start))
    except UnexpectedInput as error:
        raise _syntax_error(error, text, origin) from None
    except RecursionError:
        raise FunctionBlockError("nested too deeply", *origin) from None


_SLIPS: Final = {
    "==": "= to compare, := to assign",
    "!=": "<>",
    "&&": "AND",
    "||": "OR",
    "+=": "X := X + ...",
    "-=": "X := X - ...",
    "++": "X := X + 1",
    "--": "X := X - 1",
    "!": "NOT",
    "^": "** or EXPT",
    "%": "MOD",
    "?": "SEL(B, X, Y) or IF",
    "\N{DEGREE SIGN}": "an angle in radians",
    "\N{SUPERSCRIPT TWO}": "** 2",
    "=": ":= to assign",
}
"""What is meant by signs of other languages and of paper."""
_ASSIGNED: Final = re.compile(r"(^|[;]|\b(THEN|ELSE|DO|REPEAT|OF))\s*[\w.\[\], ]+$", re.I)
"""A text that ends with what stands to the left of an assignment."""


def _syntax_error(error: UnexpectedInput, text: str, origin: ast.Position) -> FunctionBlockError:
    at = shifted(origin, max(error.line, 1), max(error.column, 1))
    slip = _slip(text, error.pos_in_stream)
    if slip is not None:
        return FunctionBlockError(f"unexpected {slip!r}: expected {_SLIPS[slip]}", *at)
    if isinstance(error, UnexpectedCharacters):
        return FunctionBlockError(f"unexpected character {text[error.pos_in_stream]!r}", *at)
    if isinstance(error, UnexpectedEOF) or (isinstance(error, UnexpectedToken) and error.token.type == "$END"):
        at = shifted(origin, text.count("\n") + 1, len(text) - text.rfind("\n"))
        found = "end of text"
    else:
        found = repr(str(error.token)) if isinstance(error, UnexpectedToken) else "text"
    expected = set(getattr(error, "accepts", None) or getattr(error, "expected", None) or ())
    return FunctionBlockError(f"unexpected {found}: expected {_describe(expected)}", *at)


def _slip(text: str, place: int | None) -> str | None:
    """The sign of another language that an error is about; None for another error."""
    if place is None or place < 0:
        return None
    before = text[max(place - 200, 0) : place].rstrip()
    around = (text[place - 1 : place + 1], text[place : place + 2], before[-2:], text[place : place + 1])
    if text[place : place + 1] == "=" and not re.search(r"[<>:=]$", before) and _ASSIGNED.search(before):
        return "="
    return next((part for part in around if part in _SLIPS and part != "="), None)


def _describe(terminals: set[str]) -> str:
    if {"INTEGER", "NAME", "LPAR"} <= terminals:
        # every expression can start in ten ways; one word for all of them
        terminals = terminals - _VALUE_STARTERS - _FUNCTION_KEYWORDS - {"NAME", "SIGN"}
        names = ["an expression"]
    elif "OR" in terminals:
        terminals = terminals - _OPERATORS
        names = ["an operator"]
    else:
        names = []
    patterns = {t.name: str(t.pattern.value) for t in lark_parser().terminals}
    names += sorted(_TERMINALS.get(name) or patterns[name].replace("\\", "") for name in terminals)
    return choices(names)


class TreeBuilder(Transformer):
    """One method a grammar rule (or alias); children arrive already built, tokens as they are."""

    def __init__(self, origin: ast.Position) -> None:
        super().__init__()
        self._origin = origin

    def _call_userfunc(self, tree: Tree, new_children: list[Any] | None = None) -> Any:
        # a rule starts where its first token stood, also when its children are nodes already
        self._at = shifted(self._origin, getattr(tree.meta, "line", 1), getattr(tree.meta, "column", 1))
        return getattr(self, tree.data)(new_children if new_children is not None else tree.children)

    def _position(self, token: Token) -> ast.Position:
        return shifted(self._origin, token.line or 1, token.column or 1)

    def named_algorithm(self, children: list[Any]) -> ast.ParsedAlgorithm:
        name, *blocks, body = children
        return ast.ParsedAlgorithm(self._at, str(name), tuple(d for block in blocks for d in block), body)

    def plain_algorithm(self, children: list[Any]) -> ast.ParsedAlgorithm:
        *blocks, body = children
        return ast.ParsedAlgorithm(self._at, "", tuple(d for block in blocks for d in block), body)

    def variables(self, children: list[Any]) -> list[ast.Declaration]:
        return [declaration for declarations in children for declaration in declarations]

    def constants(self, children: list[Any]) -> list[ast.Declaration]:
        return [replace(declaration, constant=True) for declarations in children for declaration in declarations]

    def declaration(self, children: list[Any]) -> list[ast.Declaration]:
        names, type_name, initial = children
        return [ast.Declaration(self._position(name), str(name), type_name, initial, False) for name in names]

    def names(self, children: list[Token]) -> list[Token]:
        return children

    def simple_type(self, children: list[Token]) -> ast.TypeName:
        return ast.TypeName(self._at, children[0].upper())

    def array_type(self, children: list[Any]) -> ast.TypeName:
        *bounds, name = children
        return ast.TypeName(self._at, name.upper(), tuple(bounds))

    def bounds(self, children: list[ast.Expression]) -> ast.Range:
        return ast.Range(self._at, *children)

    def array_initial(self, children: list[Any]) -> ast.Elements:
        return ast.Elements(self._at, tuple(children))

    def repeated(self, children: list[Any]) -> ast.Repeated:
        return ast.Repeated(self._at, self._value(children[0], literals.parse_integer), children[1])

    def statements(self, children: list[Any]) -> tuple[ast.Statement, ...]:
        groups = (child if isinstance(child, list) else [child] for child in children if child is not None)
        return tuple(statement for group in groups for statement in group)

    def assignments(self, children: list[Any]) -> list[ast.Assignment]:
        """`A := B := VALUE;` is `B := VALUE; A := B;`, as in 4diac IDE."""
        *targets, value = children
        made = []
        for target in reversed(targets):
            made.append(ast.Assignment(self._at, target, value))
            value = target
        return made

    def invocation(self, children: list[Any]) -> ast.Invocation:
        block, *arguments = children
        return ast.Invocation(self._at, block, tuple(argument for argument in arguments if argument is not None))

    def given(self, children: list[Any]) -> ast.Argument:
        return ast.Argument(self._at, str(children[0]), children[1], is_output=False)

    def taken(self, children: list[Any]) -> ast.Argument:
        return ast.Argument(self._at, str(children[0]), children[1], is_output=True)

    def empty(self, children: list[Any]) -> None:
        return None

    def branch(self, children: list[Any]) -> ast.Branch:
        return ast.Branch(self._at, *children)

    def if_statement(self, children: list[Any]) -> ast.If:
        *branches, otherwise = children
        return ast.If(self._at, tuple(branches), otherwise or ())

    def case_branch(self, children: list[Any]) -> ast.CaseBranch:
        *labels, body = children
        return ast.CaseBranch(self._at, tuple(labels), body)

    def signed_label(self, children: list[Any]) -> ast.Unary:
        return ast.Unary(self._at, str(children[0]), children[1])

    def label_range(self, children: list[Any]) -> ast.Range:
        return ast.Range(self._at, *children)

    def case_statement(self, children: list[Any]) -> ast.Case:
        selector, *branches, otherwise = children
        return ast.Case(self._at, selector, tuple(branches), otherwise or ())

    def for_statement(self, children: list[Any]) -> ast.For:
        return ast.For(self._at, *children)

    def while_statement(self, children: list[Any]) -> ast.While:
        return ast.While(self._at, *children)

    def repeat_statement(self, children: list[Any]) -> ast.Repeat:
        return ast.Repeat(self._at, *children)

    def exit_statement(self, children: list[Any]) -> ast.Exit:
        return ast.Exit(self._at)

    def continue_statement(self, children: list[Any]) -> ast.Continue:
        return ast.Continue(self._at)

    def return_statement(self, children: list[Any]) -> ast.Return:
        return ast.Return(self._at)

    def binary(self, children: list[Any]) -> ast.Binary:
        left, operator, right = children
        name = "AND" if operator == "&" else operator.upper()
        return ast.Binary(self._position(operator), name, left, right)

    def unary(self, children: list[Any]) -> ast.Unary:
        return ast.Unary(self._at, children[0].upper(), children[1])

    def call(self, children: list[Any]) -> ast.Call:
        name, *arguments = children
        pairs = [a if isinstance(a, tuple) else ("", a) for a in arguments if a is not None]
        names = tuple(name for name, _ in pairs)
        return ast.Call(self._at, name.upper(), tuple(value for _, value in pairs), names if any(names) else ())

    def named_argument(self, children: list[Any]) -> tuple[str, ast.Expression]:
        return str(children[0]).upper(), children[1]

    def variable(self, children: list[Any]) -> ast.VariableAccess:
        name, *steps = children
        return ast.VariableAccess(self._at, str(name), tuple(step for group in steps for step in group))

    def member(self, children: list[Token]) -> list[ast.Member]:
        return [ast.Member(self._position(children[0]), str(children[0]))]

    def part(self, children: list[Token]) -> list[ast.Part]:
        at = self._position(children[0])
        text = children[0].removeprefix("%").upper()
        size, number = (text[0], text[1:]) if text[0].isalpha() else ("X", text)
        if not number.isdecimal() or len(number) > 2:
            raise FunctionBlockError(f"unexpected {text!r}: expected a part such as %X0", *at)
        return [ast.Part(at, size, int(number))]

    def constant_label(self, children: list[Token]) -> ast.VariableAccess:
        return ast.VariableAccess(self._at, str(children[0]))

    def subscript(self, children: list[ast.Expression]) -> list[ast.Expression]:
        return children

    def integer(self, children: list[Token]) -> ast.Literal:
        return ast.Literal(self._at, self._value(children[0], literals.parse_integer), "")

    def real_number(self, children: list[Token]) -> ast.Literal:
        return ast.Literal(self._at, literals.parse_literal(children[0], types.LREAL, *self._at), "")

    def truth(self, children: list[Token]) -> ast.Literal:
        return ast.Literal(self._at, children[0].upper() == "TRUE", "")

    def string(self, children: list[Token]) -> ast.Literal:
        name = "STRING" if children[0][0] == "'" else "WSTRING"
        return ast.Literal(self._at, self._value(children[0], literals.parse_string), name)

    def typed(self, children: list[Token]) -> ast.Literal:
        data_type = types.elementary(children[0].partition("#")[0])
        if data_type.kind in ("string", "char"):
            text = children[0].partition("#")[2]
            quoted = literals.parse_literal(text.strip(), data_type, *self._at)
            return ast.Literal(self._at, quoted, data_type.name)
        return ast.Literal(self._at, literals.parse_literal(children[0], data_type, *self._at), data_type.name)

    def date(self, children: list[Token]) -> ast.Literal:
        data_type = literals.prefixed(children[0])
        return ast.Literal(self._at, literals.parse_literal(children[0], data_type, *self._at), data_type.name)

    def value(self, children: list[Token]) -> ast.Literal:
        type_name, _, name = children[0].partition("#")
        return ast.Literal(self._at, name, type_name)

    def duration(self, children: list[Token]) -> ast.Literal:
        data_type = types.LTIME if children[0][0] in "lL" else types.TIME
        return ast.Literal(self._at, literals.parse_literal(children[0], data_type, *self._at), data_type.name)

    def _value(self, token: Token, parse: Any) -> Any:
        try:
            return parse(token)
        except FunctionBlockError as error:
            raise FunctionBlockError(error.message, *self._at) from None
