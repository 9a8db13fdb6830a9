"""Answers to queries on the bus, for tests that look at what was asked."""

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


def noting(requests: list[Any], reply: T) -> Callable[[Any], T]:
    """An answer that adds every request to the list and always gives the same reply."""

    def answer(request: Any) -> T:
        requests.append(request)
        return reply

    return answer
