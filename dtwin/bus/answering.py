"""The answering side of queries: who is heard, in which order, and how often.

In a cell with a key, Zenoh's own thread turns away whoever does not sign, so that a flood of strangers keeps nobody
waiting; what is left is done one by one on another thread.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Final

import msgspec
import zenoh

from dtwin.bus.codec import MessageError, Reader, encode
from dtwin.bus.exchange import NO_CHALLENGE, Answering, Kind
from dtwin.errors import DtwinError

JSON: Final = zenoh.Encoding.APPLICATION_JSON
FRESH: Final = 5.0
"""Age of a challenge up to which a request that carries it may act, s."""
AGAIN: Final = 4
"""Copies of one request that are answered again; further ones are only counted."""
READS: Final = 20.0
"""Queries of strangers that one topic answers in a second, and at once after a pause."""
Act = Callable[[Any], Any]
Read = Callable[[], Any]
Refuse = Callable[[str, str], None]


class _Task(msgspec.Struct):
    """A query that waits for its turn.

    Attributes:
        query: the query.
        payload: its message, b"" for none.
        request: name of its request, b"" of one that is not signed.
        challenge: its challenge.
    """

    query: zenoh.Query
    payload: bytes
    request: bytes = b""
    challenge: bytes = NO_CHALLENGE


class _Done(msgspec.Struct):
    """What became of a request: when it came, s, how often, and the reply, once there is one."""

    came: float
    copies: int = 0
    reply: tuple[Kind, bytes] | None = None


class Answerer:
    """Answers the queries of one topic.

    Args:
        key: key expression of the topic.
        message: type of the message that a query may carry.
        act: returns the answer to a message; without it, a message only reads.
        read: returns the answer to a query without message; without it, such a query is refused.
        patience: how long somebody who asks waits, s; what has waited longer does not act.
        answering: checks and signs, in a cell with a key.
        refuse: told the reason and the details of every refusal.
    """

    def __init__(
        self,
        key: str,
        message: type[msgspec.Struct],
        act: Act | None,
        read: Read | None,
        patience: float,
        answering: Answering | None,
        refuse: Refuse,
    ) -> None:
        self._key = key
        self._message = message.__name__
        self._reader = Reader(message)
        self._act = act
        self._read = read
        self._patience = patience
        self._answering = answering
        self._refuse = refuse
        self._waiting: SimpleQueue[_Task | None] = SimpleQueue()
        self._lock = threading.Lock()
        self._done: OrderedDict[bytes, _Done] = OrderedDict()
        self._reads = (READS, time.monotonic())
        threading.Thread(target=self._work, name=f"answer {key}", daemon=True).start()

    def end(self) -> None:
        """Ends the thread once it has done what waits."""
        self._waiting.put(None)

    def receive(self, query: zenoh.Query) -> None:
        """Turns a query away or lets it wait for its turn; called on Zenoh's thread."""
        payload = query.payload.to_bytes() if query.payload else b""
        task = _Task(query, payload)
        try:
            if payload and str(query.key_expr) != self._key:
                raise MessageError("inexact", f"expected the exact key {self._key} for a message that acts")
            if self._answering is None or self._is_due(task, self._answering):
                self._waiting.put(task)
        except MessageError as error:
            self._refuse(error.reason, f"{query.key_expr}: {error}")
            self._reply(task, Kind.REFUSAL, str(error).encode())

    def _is_due(self, task: _Task, answering: Answering) -> bool:
        """Whether a query is worth its turn: it is signed and new and has a challenge, or it only reads.

        Raises:
            MessageError: It is neither.
        """
        attachment = task.query.attachment
        if attachment is None and not task.payload:
            self._count_read()
            return True
        sealed = None if attachment is None else attachment.to_bytes()
        request, challenge = answering.open(task.payload, sealed)
        task.request, task.challenge = request, challenge
        if answering.age(challenge) > FRESH:
            if challenge != NO_CHALLENGE:
                self._refuse("late", f"{self._key}: a request was held back, or meant for an earlier life")
            self._reply(task, Kind.CHALLENGE, b"")
            return False
        return self._count_copy(request)

    def _count_read(self) -> None:
        """Counts a query of a stranger.

        Raises:
            MessageError: There are too many.
        """
        with self._lock:
            left, since = self._reads
            now = time.monotonic()
            left = min(READS, left + (now - since) * READS)
            self._reads = (max(left - 1.0, 0.0), now)
        if left < 1.0:
            raise MessageError("flood", f"expected at most {READS:g} unsigned queries a second")

    def _count_copy(self, request: bytes) -> bool:
        """Whether a request, or a copy of it, shall have an answer."""
        now = time.monotonic()
        with self._lock:
            while self._done and (first := next(iter(self._done.values()))).reply and now - first.came > 2 * FRESH:
                self._done.popitem(last=False)
            done = self._done.setdefault(request, _Done(now))
            done.copies += 1
            copies = done.copies
        if copies > 1:
            self._refuse("replayed", f"{self._key}: a request has come before and does not act again")
        return copies <= 1 + AGAIN

    def _work(self) -> None:
        while (task := self._waiting.get()) is not None:
            done = self._done.get(task.request)
            kind, payload = (done and done.reply) or self._answer(task)
            if done is not None:
                done.reply = kind, payload
            self._reply(task, kind, payload)
            del task  # Zenoh waits for the end of a query as long as somebody holds it.

    def _answer(self, task: _Task) -> tuple[Kind, bytes]:
        try:
            return Kind.ANSWER, encode(self._found(task))
        except MessageError as error:
            self._refuse(error.reason, f"{self._key}: {error}")
            return Kind.REFUSAL, str(error).encode()
        except DtwinError as error:
            return Kind.REFUSAL, str(error).encode()
        except Exception as error:  # The thread answers everybody: no query of one may end it.
            self._refuse("failed", f"{self._key}: {type(error).__name__}: {error}")
            return Kind.REFUSAL, f"failed: {type(error).__name__}".encode()

    def _found(self, task: _Task) -> Any:
        if self._answering is not None and task.request and self._answering.age(task.challenge) > self._patience:
            raise MessageError("late", f"nothing was done: the request has waited for more than {self._patience:g} s")
        asked = self._reader(task.payload) if task.payload else None
        if asked is not None and self._act is not None:
            return self._act(asked)
        if self._read is None:
            raise MessageError("empty", f"expected a {self._message}, without which there is nothing to do")
        return self._read()

    def _reply(self, task: _Task, kind: Kind, payload: bytes) -> None:
        """Sends a reply, signed if its request is, and ends the query."""
        with task.query as query, contextlib.suppress(zenoh.ZError):  # The session may be at its end.
            if self._answering is not None and task.request:
                attachment = self._answering.attachment(task.request, kind, payload)
                query.reply(self._key, payload, encoding=JSON, attachment=attachment)
            elif kind is Kind.ANSWER:
                query.reply(self._key, payload, encoding=JSON)
            else:
                query.reply_err(payload.decode())
