"""The errors a user can meet. Every message is one line: what, where, what was expected, the valid choices."""

from __future__ import annotations

from collections.abc import Iterable

from iec61499.errors import CommunicationError as CommunicationError
from iec61499.errors import FunctionBlockError as FunctionBlockError
from iec61499.errors import NativeError as NativeError
from iec61499.errors import ToolError
from iec61499.errors import choices as choices

DtwinError = ToolError
"""Base of all errors raised on purpose, those of the function blocks too; the command line prints it as one line and
exits with 2."""


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


class RecordingError(DtwinError):
    """A log or recording cannot be read or written."""


class NoSpaceError(RecordingError):
    """A log or recording cannot be written because the disk, or the part of it that one may use, is full."""


class TaskError(DtwinError):
    """A task of a campaign failed."""


class UnansweredError(CommunicationError):
    """Nobody answers a query: the service that should is not there, or may not be asked."""
