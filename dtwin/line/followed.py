"""Blocks of a line elsewhere whose state is known, because the same blocks here are asked the same."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from dtwin.errors import CommunicationError
from dtwin.line.control import Exchange, OneResource


class Followed:
    """Blocks elsewhere, beside the same blocks in this process that get the same values.

    Blocks elsewhere tell nobody their state. As long as both answer alike it is that of the blocks here. From the
    first other answer on, and once one did not come, nobody can tell.

    Args:
        there: the blocks elsewhere, which have just begun.
        here: blocks of the same line in this process, which have just begun, too.
    """

    def __init__(self, there: Exchange, here: OneResource) -> None:
        self._there = there
        self._here: OneResource | None = here

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        try:
            answer = self._there.exchange(block, values)
        except CommunicationError:
            self._here = None
            raise
        if self._here is not None and self._here.exchange(block, values) != answer:
            self._here = None
        return answer

    def now(self) -> Any:
        return None if self._here is None else self._here.now()

    def resume(self, now: Any) -> None:
        """Does nothing: blocks elsewhere go on as they are."""

    def memory(self) -> dict[str, Any] | None:
        """What `OneResource.memory` tells; None where nobody can tell."""
        return None if self._here is None else self._here.memory()
