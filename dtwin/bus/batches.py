"""Messages of several samples for one wake of the main thread, which costs more than what a sample gives to do."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from dtwin.signals import Sensors


class Batches:
    """What waits for the main thread.

    Args:
        wake: called on Zenoh's threads when the main thread shall take what waits.

    Attributes:
        size: number of samples that may wait for each other; the main thread sets it.
    """

    def __init__(self, wake: Callable[[], object]) -> None:
        self.size = 1
        self._wake = wake
        self._waiting: deque[Any] = deque()
        self._batch = -1

    def put(self, message: object) -> None:
        """Lets a message wait; the first sample after a multiple of the size, which completes a batch, wakes."""
        self._waiting.append(message)
        if isinstance(message, Sensors):
            batch = (message.sequence - 1) // self.size
            if batch != self._batch:
                self._batch = batch
                self._wake()

    def take(self) -> list[Any]:
        """What waits, oldest first; none of it waits any more."""
        return [self._waiting.popleft() for _ in range(len(self._waiting))]
