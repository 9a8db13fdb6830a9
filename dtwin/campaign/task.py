"""One task at its worker. A failure comes back in words: not every exception survives the way to another process."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from dtwin.errors import DtwinError

T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True, slots=True)
class Success(Generic[R]):
    """What a task gave."""

    value: R


@dataclass(frozen=True, slots=True)
class Failure:
    """Why a task gave nothing.

    Attributes:
        reason: one line.
        trace: where in the code it happened, "" where that is of no use.
    """

    reason: str
    trace: str = ""


def attempt(function: Callable[[T], R], item: T) -> Success[R] | Failure:
    """Does a task."""
    try:
        return Success(function(item))
    except DtwinError as error:
        return Failure(str(error))
    except Exception as error:
        return Failure(f"{type(error).__name__}: {error}", traceback.format_exc())
