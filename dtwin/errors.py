"""The errors a user can meet. Every message is one line: what, where, what was expected, the valid choices."""

from __future__ import annotations

from collections.abc import Iterable


class DtwinError(Exception):
    """Base of all errors raised on purpose; the command line prints it as one line and exits with 2."""


class ParameterError(DtwinError, ValueError):
    """A physical parameter, setting or option is out of its range."""


class ModelError(DtwinError):
    """A model file (MJCF or identified model) cannot be used."""


class DivergenceError(DtwinError):
    """A simulation left the finite numbers."""

    def __init__(self, where: str, time: float, state: Iterable[float]) -> None:
        values = ", ".join(f"{x:.6g}" for x in state)
        super().__init__(f"{where} diverged at t = {time:.4f} s, last state ({values})")
        self.time = time


class IdentificationError(DtwinError):
    """Data are too poor to identify a model from, or an estimate cannot be made."""


class UnreachableError(DtwinError, ValueError):
    """A point lies outside the arm's reach."""


class FaultError(ParameterError):
    """A fault description cannot be read."""


class FunctionBlockError(DtwinError):
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


class NativeError(DtwinError):
    """Machine code cannot be made or used here."""


class RecordingError(DtwinError):
    """A log or recording cannot be read or written."""


class NoSpaceError(RecordingError):
    """A log or recording cannot be written because the disk, or the part of it that one may use, is full."""


class TaskError(DtwinError):
    """A task of a campaign failed."""


class CommunicationError(DtwinError):
    """A peer is unreachable, late, or speaks another protocol."""


class UnansweredError(CommunicationError):
    """Nobody answers a query: the service that should is not there, or may not be asked."""


def choices(names: Iterable[str]) -> str:
    """`a, b or c`: the end of a message that lists what would have been valid."""
    items = list(names)
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} or {items[-1]}"
