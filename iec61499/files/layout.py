"""Structured Text in one layout: the same tokens and comments, indented and spaced alike.

One statement a line, keywords in capitals, one level of indentation for each block, and none for ALGORITHM. Breaks
inside a statement and single blank lines between statements stay where they are.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from iec61499.errors import FunctionBlockError
from iec61499.st import ast
from iec61499.st.comments import comment_spans, without_comments
from iec61499.st.parser import lark_parser, parse_algorithm

_OPENED_BY: Final = {"THEN": "IF", "DO": "LOOP", "OF": "CASE"}
"""What ends the head of a block."""
_HEADS: Final = frozenset({"IF", "ELSIF", "FOR", "WHILE", "CASE"})
_ENDS: Final = frozenset({"END_IF", "END_FOR", "END_WHILE", "END_REPEAT", "END_CASE", "END_VAR", "END_ALGORITHM"})
_COMPOUND: Final = _HEADS | _ENDS | {"REPEAT", "ELSE", ";"}
_UNSPACED_BEFORE: Final = frozenset({";", ",", ":", ")", "]", ".", ".."})
_UNSPACED_AFTER: Final = frozenset({"(", "[", ".", ".."})
_KEYWORD: Final = re.compile(r"[A-Za-z_]+")
_VALUES: Final = frozenset({"NAME", "TYPED_LITERAL", "STRING_LITERAL", "DURATION", "DATE_LITERAL", "VALUE_LITERAL"})
"""Terminals whose letters are kept as they are."""
_LITERALS: Final = _VALUES | {"INTEGER", "REAL_NUMBER", "TRUTH", "BOUNDED_STRING", "PART"}


@dataclass(frozen=True, slots=True)
class _Piece:
    """A token or a comment; `breaks` are the line ends before it."""

    text: str
    kind: str
    breaks: int

    @property
    def is_comment(self) -> bool:
        return self.kind == "COMMENT"

    @property
    def is_operand(self) -> bool:
        """Whether an operator may stand behind it."""
        return self.kind in _LITERALS or self.text in (")", "]")


def formatted(text: str, indent: str = "\t") -> str:
    """The text in the layout of this module; formatted again it stays as it is.

    Args:
        text: an algorithm in Structured Text.
        indent: one level of indentation.

    Raises:
        FunctionBlockError: the text is not Structured Text.
    """
    tree = parse_algorithm(text)
    laid = _Layout(list(_pieces(text)), indent).lines()
    result = "\n".join(laid) + ("\n" if text.endswith("\n") and laid else "")
    if parse_algorithm(result) != tree:
        raise FunctionBlockError("cannot be laid out without a change of what it says")
    return result


def _pieces(text: str) -> Iterator[_Piece]:
    """Tokens and comments in their order."""
    origin = ast.Position()
    tokens = [(t.start_pos, t.end_pos, str(t.type)) for t in lark_parser().lex(without_comments(text, origin))]
    spans = [(start, end, "COMMENT") for start, end in comment_spans(text, origin)]
    before = 0
    for start, end, kind in sorted([*tokens, *spans]):
        piece = text[start:end].rstrip() if kind == "COMMENT" else text[start:end]
        if kind not in _VALUES and kind != "COMMENT" and _KEYWORD.fullmatch(piece):
            piece = piece.upper()
        yield _Piece(piece, kind, text.count("\n", before, start))
        before = end


class _Layout:
    """Writes pieces line by line.

    `_stack` holds the blocks around the next statement: IF, LOOP, CASE, LABEL (a branch of CASE), VAR, UNTIL.
    """

    def __init__(self, pieces: list[_Piece], indent: str) -> None:
        self._pieces = pieces
        self._indent = indent
        self._stack: list[str] = []
        self._lines: list[str] = []
        self._line: list[_Piece] = []
        self._level = 0
        self._broken = False
        self._head = ""
        self._opens = False

    def lines(self) -> list[str]:
        """The lines of the text."""
        for number, piece in enumerate(self._pieces):
            if piece.is_comment:
                self._comment(piece)
            elif not self._line and not self._broken:
                self._start_statement(number, piece)
            else:
                self._continue(number, piece)
        self._flush()
        while self._lines and not self._lines[-1]:
            self._lines.pop()
        return self._lines

    def _depth(self) -> int:
        return sum(block != "UNTIL" for block in self._stack)

    def _comment(self, piece: _Piece) -> None:
        if self._line or self._broken:
            if piece.breaks:
                self._break()
            self._line.append(piece)
        elif not piece.breaks and self._lines and self._lines[-1]:
            self._lines[-1] += f" {piece.text}"
        else:
            self._blank(piece)
            self._lines.append(self._indent * self._depth() + piece.text)
        self._opens = False

    def _blank(self, piece: _Piece) -> None:
        """Keeps one of the blank lines before a statement, unless it is the first of its block."""
        if piece.breaks > 1 and self._lines and self._lines[-1] and not self._opens:
            self._lines.append("")

    def _break(self) -> None:
        """Ends a line within a statement."""
        if self._line:
            self._write()
        self._broken = True

    def _write(self) -> None:
        text = ""
        previous: list[_Piece] = []
        for piece in self._line:
            declares = piece.text == ":" and self._stack[-1:] == ["VAR"]
            text += (" " if previous and (declares or _is_spaced(previous, piece)) else "") + piece.text
            previous.append(piece)
        self._lines.append(self._indent * (self._level + 2 * self._broken) + text)
        self._line = []

    def _flush(self) -> None:
        """Ends a statement or the head of a block."""
        if self._line:
            self._write()
        self._broken = False
        self._head = ""

    def _start_statement(self, number: int, piece: _Piece) -> None:
        """The first token of a statement."""
        text = piece.text
        closes = text in _ENDS or text in ("ELSE", "ELSIF", "UNTIL")
        if closes:
            while self._lines and not self._lines[-1]:
                self._lines.pop()
        else:
            self._blank(piece)
        self._opens = False
        if text in _ENDS:
            self._end(number, piece)
            return
        if text in ("ELSE", "ELSIF"):
            block = "IF" if self._stack[-1:] == ["IF"] else "LABEL"
            if self._stack[-1:] != ["CASE"]:
                self._stack.pop()
            self._put(piece, self._depth())
            if text == "ELSE" and block == "LABEL":
                self._open_branch(number)
            elif text == "ELSE":
                self._open(block)
            else:
                self._head = "IF"
        elif text == "UNTIL":
            self._stack.pop()
            self._put(piece, self._depth())
            self._stack.append("UNTIL")
        elif text == "REPEAT":
            self._put(piece, self._depth())
            self._open("LOOP")
        elif text in ("VAR", "VAR_TEMP") and piece.kind != "NAME":
            self._put(piece, self._depth())
            if not self._next_is(number, "CONSTANT"):
                self._open("VAR")
        elif text == "ALGORITHM" and piece.kind != "NAME":
            self._put(piece, self._depth())
            self._head = "ALGORITHM"
        elif self._stack[-1:] in (["CASE"], ["LABEL"]) and self._is_label(number):
            if self._stack[-1] == "LABEL":
                self._stack.pop()
            self._put(piece, self._depth())
            self._head = "LABEL"
        else:
            self._put(piece, self._depth())
            self._head = text if text in _HEADS else ""
            if text == ";":
                self._flush()

    def _continue(self, number: int, piece: _Piece) -> None:
        """Another token of a statement."""
        text = piece.text
        if text == "END_REPEAT":
            self._flush()
            self._end(number, piece)
            return
        if (piece.breaks and text not in (";", "THEN", "DO", "OF")) or (
            self._line and self._line[-1].is_comment and self._line[-1].text.startswith("//")
        ):
            self._break()
        self._line.append(piece)
        if text == ";":
            self._flush()
        elif self._head in _HEADS and text in _OPENED_BY and piece.kind not in _LITERALS:
            self._open(_OPENED_BY[text])
        elif self._head == "LABEL" and text == ":":
            self._open_branch(number)
        elif self._head == "ALGORITHM":
            self._flush()
            self._opens = True
        elif text == "CONSTANT" and self._line[0].text in ("VAR", "VAR_TEMP"):
            self._open("VAR")

    def _end(self, number: int, piece: _Piece) -> None:
        """The end of a block, with the semicolon that may follow."""
        if self._stack[-1:] == ["LABEL"]:
            self._stack.pop()
        if piece.text != "END_ALGORITHM":
            self._stack.pop()
        self._put(piece, self._depth())
        if not self._next_is(number, ";"):
            self._flush()

    def _put(self, piece: _Piece, level: int) -> None:
        self._level = level
        self._line.append(piece)

    def _open(self, block: str) -> None:
        self._flush()
        self._stack.append(block)
        self._opens = True

    def _open_branch(self, number: int) -> None:
        """Opens a branch of CASE; its statement stays in the line of the label if it is there, simple and alone."""
        following = self._pieces[number + 1 : number + 2]
        if (
            following
            and not following[0].breaks
            and following[0].text not in _COMPOUND
            and self._is_alone(number + 1)
        ):
            self._stack.append("LABEL")
            self._head = ""
        else:
            self._open("LABEL")

    def _is_alone(self, number: int) -> bool:
        """Whether the statement that begins here is the only one of its branch, and no comment."""
        if self._pieces[number].is_comment:
            return False
        end = next((n for n in range(number, len(self._pieces)) if self._pieces[n].text == ";"), len(self._pieces))
        rest = [n for n in range(end + 1, len(self._pieces)) if not self._pieces[n].is_comment]
        return bool(rest) and (self._pieces[rest[0]].text in ("END_CASE", "ELSE") or self._is_label(rest[0]))

    def _next_is(self, number: int, text: str) -> bool:
        following = self._pieces[number + 1 : number + 2]
        return bool(following) and following[0].text == text and not following[0].is_comment

    def _is_label(self, number: int) -> bool:
        """Whether a statement in CASE is a label: a colon comes before anything else that ends one."""
        for piece in self._pieces[number:]:
            if piece.text == ":":
                return True
            if piece.text in (";", ":=", "(") or piece.text in _HEADS | _ENDS:
                return False
        return False


def _is_spaced(before: list[_Piece], piece: _Piece) -> bool:
    """Whether a space stands between the tokens of a line and the next one."""
    last, text = before[-1], piece.text
    if piece.is_comment or last.is_comment:
        return True
    if text in _UNSPACED_BEFORE or last.text in _UNSPACED_AFTER:
        return False
    if text in ("(", "["):
        if text == "[" and last.text == "ARRAY":
            return True
        is_call = last.kind == "NAME" or last.text == "]"
        is_function = last.text in ("AND", "OR", "XOR", "MOD") and not _follows_operand(before[:-1])
        return not (is_call or is_function or (text == "[" and last.kind == "NAME"))
    if last.kind == "SIGN":
        return _follows_operand(before[:-1])
    return True


def _follows_operand(before: list[_Piece]) -> bool:
    tokens = [piece for piece in before if not piece.is_comment]
    return bool(tokens) and tokens[-1].is_operand
