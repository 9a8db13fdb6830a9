"""The errors a user can meet. Every message is one line: what, where, what was expected, the valid choices."""

from __future__ import annotations

from collections.abc import Iterable


class ToolError(Exception):
    """Base of all errors raised on purpose; the command line prints it as one line and exits with 2."""


class FunctionBlockError(ToolError):
    """A function-block file, type, connection or algorithm is wrong; carries its position.

    Attributes:
        file: path or name of the source, "" when there is none.
        line: 1-based, 0 when unknown.
        column: 1-based, 0 when unknown.
    """

    def __init__(self, message: str, file: str = "", line: int = 0, column: int = 0) -> None:
        position = ":".join(str(part) for part in (file, line, column) if part)
        super().__init__(f"{position}: {message}" if position else message)
        self.message = message
        self.file = file
        self.line = line
        self.column = column


class NativeError(ToolError):
    """Machine code cannot be made or used here."""


class CommunicationError(ToolError):
    """A peer is unreachable, late, or speaks another protocol.

    Attributes:
        status: what a communication block says in STATUS; "" for what it says otherwise.
    """

    def __init__(self, message: str, status: str = "") -> None:
        super().__init__(message)
        self.status = status


def choices(names: Iterable[str]) -> str:
    """`a, b or c`: the end of a message that lists what would have been valid."""
    items = list(names)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} or {items[-1]}"
