"""Waiting for conditions, with a deadline: the one way in which tests wait for another process or thread."""

import time
from collections.abc import Callable
from typing import TypeVar

from dtwin.errors import CommunicationError

T = TypeVar("T")


def pause() -> None:
    """20 ms between two looks at a condition; the pause synchronises nothing."""
    time.sleep(0.02)


def until(
    condition: Callable[[], T | None], what: str, timeout: float = 60.0, between: Callable[[], object] = pause
) -> T:
    """Waits until a condition is true and returns its value.

    Args:
        condition: called again and again until its value is true.
        what: what is waited for, as the failure names it.
        timeout: s, after which the test fails.
        between: what is done between two looks.
    """
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {timeout} s: {what}"
        between()
    return value


def connected(connect: Callable[[], T]) -> T:
    """The connection that `connect` makes, as soon as somebody listens."""

    def attempt() -> T | None:
        try:
            return connect()
        except CommunicationError:
            return None

    return until(attempt, "somebody listens")
