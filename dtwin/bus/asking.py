"""The asking side of queries: who is asked, whose answer is believed, and how long it is waited for.

Everybody who declares a topic's key is asked, also when somebody says that his answers are complete. In a cell with a
key the first answer counts that is signed and belongs to this very request; others are counted and passed over.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, Final

import zenoh
from zenoh.handlers import Callback

from dtwin.bus.answering import JSON
from dtwin.bus.codec import MessageError
from dtwin.bus.exchange import NO_CHALLENGE, Asking, Kind, Opened
from dtwin.errors import CommunicationError, UnansweredError

TIMEOUT: Final = 5.0
"""Longest wait for somebody who answers a query, s."""
_ZENOH_TIMEOUT: Final = "Timeout"
"""What Zenoh itself answers to a query whose time is over."""
_FIRST_PAUSE: Final = 0.25
"""Time after which a challenge is asked for again, s, which doubles; not everybody may be known at first."""
_SHORT: Final = 0.05
"""The same at first when all who were asked have answered, s, which doubles, too."""


class Question:
    """One question to all who answer a key.

    Args:
        querier: what asks for the key, in a session; `declare_querier` makes it.
        key: key expression of the topic.
        sender: name of the service that should answer.
        timeout: longest wait for the answer, s.
        asking: signs and checks, in a cell with a key.
        refuse: told the reason and the details of every answer that is not believed.
    """

    def __init__(
        self,
        querier: zenoh.Querier,
        key: str,
        sender: str,
        timeout: float,
        asking: Asking | None,
        refuse: Callable[[str, str], None],
    ) -> None:
        self._querier = querier
        self._key = key
        self._sender = sender
        self._timeout = timeout
        self._asking = asking
        self._refuse = refuse
        self._wrong = 0
        self._said = ""

    def answer(self, payload: bytes) -> bytes:
        """The answer to a message, b"" for none.

        Raises:
            UnansweredError: no answer comes in time, or none that can be believed.
            CommunicationError: the answer is a refusal.
        """
        joining = min(self._timeout, TIMEOUT)
        began = time.monotonic()
        # A session that has just joined does not know the others yet.
        if not _is_matched(self._querier, joining):
            raise UnansweredError(self._nobody())
        if self._asking is None:
            return self._first(payload)
        return self._signed(self._asking, payload, began + joining)

    def _first(self, payload: bytes) -> bytes:
        """The first answer, from whomever."""
        for answer in self._querier.get(payload=payload, encoding=JSON):
            if answer.err is not None:
                said = answer.err.payload.to_bytes().decode(errors="replace")
                if said == _ZENOH_TIMEOUT:
                    raise UnansweredError(self._silent())
                raise CommunicationError(f"{self._key}: {said}")
            if answer.ok is not None:
                return answer.ok.payload.to_bytes()
        raise UnansweredError(self._nobody())

    def _signed(self, asking: Asking, payload: bytes, joined: float) -> bytes:
        """The answer with the cell's signature; the challenge must come until a time."""
        opened = self._challenged(asking, payload, joined)
        if opened is None:
            raise UnansweredError(self._nobody())
        if opened.kind is Kind.CHALLENGE:
            opened = self._carried_out(asking, payload, opened.challenge)
        if opened.kind is Kind.ANSWER:
            return opened.payload
        raise CommunicationError(f"{self._key}: {opened.payload.decode(errors='replace')}")

    def _challenged(self, asking: Asking, payload: bytes, until: float) -> Opened | None:
        """The challenge of somebody who answers; it is asked for until there is one, since that does nothing."""
        request = asking.request(payload, NO_CHALLENGE)
        inbox: SimpleQueue[Opened | None] = SimpleQueue()
        pause, short = _FIRST_PAUSE, _SHORT
        while (now := time.monotonic()) < until:
            self._send(asking, payload, request, inbox)
            again = min(until, now + pause)
            pause *= 2.0
            short *= 2.0
            while (now := time.monotonic()) < again:
                try:
                    found = inbox.get(timeout=again - now)
                except Empty:
                    break
                if found is not None:
                    return found
                again = min(again, time.monotonic() + short)
        return None

    def _carried_out(self, asking: Asking, payload: bytes, challenge: bytes) -> Opened:
        """The answer to a request that may act, which is sent once."""
        inbox: SimpleQueue[Opened | None] = SimpleQueue()
        self._send(asking, payload, asking.request(payload, challenge), inbox)
        until = time.monotonic() + self._timeout
        while (left := until - time.monotonic()) > 0.0:
            try:
                found = inbox.get(timeout=left)
            except Empty:
                break
            if found is None:
                break
            if found.kind is not Kind.CHALLENGE:  # which another one gives, or the same in another life
                return found
        raise UnansweredError(self._silent())

    def _send(self, asking: Asking, payload: bytes, request: bytes, inbox: SimpleQueue[Opened | None]) -> None:
        """Sends a request; what can be believed goes into the inbox, and None when everybody has answered."""

        def collect(reply: zenoh.Reply) -> None:
            try:
                if reply.ok is None:
                    said = b"" if reply.err is None else reply.err.payload.to_bytes()
                    if said == _ZENOH_TIMEOUT.encode():
                        return
                    raise MessageError("unsigned", said.decode(errors="replace")[:200])
                attachment = reply.ok.attachment
                sealed = None if attachment is None else attachment.to_bytes()
                inbox.put(asking.open(request, reply.ok.payload.to_bytes(), sealed))
            except (MessageError, ValueError) as error:
                self._wrong += 1
                self._said = str(error)
                self._refuse(getattr(error, "reason", "invalid"), f"{self._key}: an answer to a request: {error}")

        handler = Callback(collect, lambda: inbox.put(None), indirect=False)
        self._querier.get(handler, payload=payload, encoding=JSON, attachment=request)

    def _nobody(self) -> str:
        waited = min(self._timeout, TIMEOUT)
        if self._wrong:
            return f"{self._key}: {self._sender} did not answer within {waited:g} s{self._others()}"
        hint = f"is the service {self._sender} there, and may this session ask it?"
        return f"{self._key}: nobody answered within {waited:g} s; {hint}"

    def _silent(self) -> str:
        return f"{self._key}: {self._sender} did not answer within {self._timeout:g} s{self._others()}"

    def _others(self) -> str:
        """What is to be said of answers that were not believed."""
        if not self._wrong:
            return ""
        count = "an answer" if self._wrong == 1 else f"{self._wrong} answers"
        return f"; {count} without the signature of this cell did not count, the last one: {self._said}"


def declare_querier(session: zenoh.Session, key: str, timeout: float) -> zenoh.Querier:
    """What asks all who answer a key, each time with a timeout, s; it may ask many times, from several threads."""
    return session.declare_querier(
        key, target=zenoh.QueryTarget.ALL, consolidation=zenoh.ConsolidationMode.NONE, timeout=timeout
    )


def _is_matched(querier: zenoh.Querier, timeout: float) -> bool:
    """Whether somebody answers the key of a querier within a time, s."""
    status: Any = querier.matching_status  # Zenoh's type stubs wrongly call it a bool.
    if status.matching:
        return True
    there = threading.Event()

    def note(status: Any) -> None:
        if status.matching:
            there.set()

    listener = querier.declare_matching_listener(Callback(note, lambda: None))
    try:
        status = querier.matching_status  # which may have changed before the listener was there
        return bool(status.matching) or there.wait(timeout)
    finally:
        listener.undeclare()
