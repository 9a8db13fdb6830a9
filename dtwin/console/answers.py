"""Asks for what is not published, in rounds on a thread of its own, and keeps the last answers."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any, TypeVar

import msgspec

from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.errors import CommunicationError

log = logging.getLogger(__name__)
M = TypeVar("M", bound=msgspec.Struct)


class Answers:
    """The last message of each kind, from answers and from what is published.

    Args:
        bus: session on which is asked.
        patience: longest wait for one answer, s.
        ask_round: asks once for everything, and returns the time until the next round, s.
    """

    def __init__(self, bus: Bus, patience: float, ask_round: Callable[[], float]) -> None:
        self._bus = bus
        self._patience = patience
        self._ask_round = ask_round
        self._last: dict[type, Any] = {}
        self._over = threading.Event()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._work, name="ask", daemon=True)

    def start(self) -> None:
        """Begins to ask."""
        self._thread.start()

    def ask_now(self) -> None:
        """Asks again at once."""
        self._wake.set()

    def close(self) -> None:
        """Asks no more."""
        self._over.set()
        self._wake.set()
        self._thread.join()

    def __contains__(self, kind: type[msgspec.Struct]) -> bool:
        return kind in self._last

    def last(self, kind: type[M]) -> M | None:
        """The last message of a kind; None if there was none."""
        found: M | None = self._last.get(kind)
        return found

    def keep(self, message: msgspec.Struct) -> None:
        """Keeps a message as the last one of its kind."""
        self._last[type(message)] = message

    def forget(self, kind: type[msgspec.Struct]) -> None:
        """Forgets the last message of a kind."""
        self._last.pop(kind, None)

    def ask(self, topic: Topic, reply: type[M], patience: float | None = None) -> M | None:
        """The answer of a topic without a message, which is kept; None without one.

        Args:
            topic: what is asked.
            reply: kind of the answer.
            patience: longest wait for it, s; as for all if not given.
        """
        try:
            answer = self._bus.ask(topic, None, reply, self._patience if patience is None else patience)
        except CommunicationError as error:
            log.debug("%s", error)
            return None
        self._last[reply] = answer
        return answer

    def _work(self) -> None:
        while not self._over.is_set():
            self._wake.wait(self._ask_round())
            self._wake.clear()
