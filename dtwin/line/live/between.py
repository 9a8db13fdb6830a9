"""What is asked of a line is done by the thread that runs it, between two cycles: nobody sees half a one."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from dtwin.errors import CommunicationError

R = TypeVar("R")


class Between:
    """What waits to be done between two cycles.

    Args:
        clock: gives a time that only grows, s.
        patience: longest wait of who asks, s.
    """

    def __init__(self, clock: Callable[[], float], patience: float) -> None:
        self._clock, self._patience = clock, patience
        self._asked: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()

    def ask(self, act: Callable[..., R], *message: Any) -> R:
        """What comes of something that the thread of the line does; called by other threads.

        Raises:
            CommunicationError: it does not come to it in time; then it is not done later either.
            DtwinError: it is refused.
        """
        answer: Future[R] = Future()
        self._asked.put((partial(act, *message), answer))
        try:
            return answer.result(self._patience)
        except Late:
            answer.cancel()
            raise CommunicationError("the line is busy, or has come to its end; try again") from None

    def serve(self, seconds: float = 0.0) -> None:
        """Does what was asked, and for some seconds what is asked meanwhile.

        Whatever comes of it is told to who asked: no question may end the thread of the line.
        """
        until = self._clock() + seconds
        while True:
            left = until - self._clock()
            try:
                asked, answer = self._asked.get(timeout=left) if left > 0.0 else self._asked.get_nowait()
            except Empty:
                return
            if not answer.set_running_or_notify_cancel():
                continue
            try:
                answer.set_result(asked())
            except Exception as error:
                answer.set_exception(error)
