"""The bus that joins the services: a Zenoh session with typed topics, which are signed in a cell with a key."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import threading
from collections import Counter
from collections.abc import Callable
from typing import Any, Final

import msgspec
import zenoh
from zenoh.handlers import Callback

from dtwin.bus.answering import JSON, Answerer
from dtwin.bus.asking import Question, declare_querier
from dtwin.bus.codec import M, MessageError, Reader, encode
from dtwin.bus.exchange import Answering, Asking
from dtwin.bus.messages import ALIVE
from dtwin.bus.presence import Presence, token
from dtwin.bus.signature import FORGED, UNSIGNED, Signer, Verifier
from dtwin.bus.topics.topic import Topic
from dtwin.errors import ParameterError
from dtwin.names import check_name
from dtwin.terminal import printable
from iec61499.net.sockets import Closing

log = logging.getLogger(__name__)

_SAID: Final = 3
"""Number of refusals for one reason that are logged one by one; further ones are only counted."""
_threads: Final = threading.local()


class Publisher:
    """Publishes messages of one topic: called with a message, it sends it, signed if the cell has a key."""

    def __init__(self, publisher: zenoh.Publisher, signer: Signer | None) -> None:
        self._publisher = publisher
        self._put = publisher.put
        self._signer = signer
        self._lock = threading.Lock()
        self._matched = threading.RLock()
        self._listener: Any = None
        self._wanted = False

    def __call__(self, message: msgspec.Struct) -> None:
        payload = encode(message)
        if self._signer is None:
            self._put(payload)
            return
        with self._lock:  # The sequence numbers must leave in order.
            self._put(payload, attachment=self._signer(payload))

    @property
    def sender(self) -> bytes:
        """The name under which subscribers know this publisher, or b"" in a cell without key."""
        return b"" if self._signer is None else self._signer.sender

    @property
    def wanted(self) -> bool:
        """Whether at least one session subscribes to the topic, as far as this one has heard."""
        if self._listener is None:
            with self._matched:  # What the listener hears meanwhile is newer, and counts.
                self._listener = self._publisher.declare_matching_listener(Callback(self._note, lambda: None))
                self._wanted = _matching(self._publisher.matching_status)
        return self._wanted

    def _note(self, status: Any) -> None:
        with self._matched:
            self._wanted = _matching(status)


class Subscription:
    """A subscription that can be ended before its session."""

    def __init__(self, subscriber: Any) -> None:
        self._end = subscriber.undeclare

    def end(self) -> None:
        """Ends the subscription; its publishers learn that they have one subscriber less. May be called once."""
        self._end()


class Bus(Closing):
    """One Zenoh session and the typed topics of one arm.

    Args:
        session: the session; the bus closes it.
        cell: name of the cell in the keys.
        arm: name of the arm in the keys.
        key: secret of the cell's services. With it, everything that is published is signed, and only what is signed
            with it is received; without it, everything is received.

    Attributes:
        refused: number of messages refused since the start, by reason; read and written from several threads.
        last_refusal: the last refusal in words.

    Raises:
        ParameterError: cell or arm cannot be part of a key; the session is closed.
    """

    def __init__(
        self, session: zenoh.Session, cell: str = "cell", arm: str = "arm", key: bytes | None = None
    ) -> None:
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        try:
            self._prefix = f"dtwin/{check_name(cell, 'cell')}/{check_name(arm, 'arm')}/"
        except ParameterError:
            session.close()
            raise
        self._lock = threading.Lock()
        self._session = session
        self._cell = cell
        self._key = key
        self._declared: list[Any] = []
        self._queriers: dict[tuple[str, float], zenoh.Querier] = {}

    def close(self) -> None:
        """Closes the session; its liveliness tokens and subscriptions end with it.

        A peer that is frozen, or a network that has gone, may keep it from saying goodbye in time: others see then by
        its lease that it has ended.
        """
        with contextlib.suppress(zenoh.ZError):
            self._session.close()

    def beside(self, arm: str) -> Bus:
        """The topics of another arm of the same cell or line on the same session, which this bus closes.

        Raises:
            ParameterError: the arm cannot be part of a key.
        """
        check_name(arm, "arm")
        return Bus(self._session, self._cell, arm, self._key)

    def peers(self) -> int:
        """Number of other sessions that this one is connected to."""
        return len(self._session.info.peers_zid()) + len(self._session.info.routers_zid())

    def key(self, topic: Topic, part: str = "*") -> str:
        """The key expression of a topic; `part` takes the place of its `*`."""
        return self._prefix + topic.name.replace("*", part)

    def refuse(self, reason: str, detail: str) -> None:
        """Counts a message that is refused and logs the reason."""
        with self._lock:
            self.refused[reason] += 1
            count = self.refused[reason]
        self.last_refusal = printable(f"{reason}: {detail}")
        if count <= _SAID:
            rest = "; more of these are only counted" if count == _SAID else ""
            log.warning("refused %s%s", self.last_refusal, rest)

    def announce(self, service: str) -> None:
        """Declares the liveliness token of a service, which lasts as long as the session."""
        key = token(self.key(ALIVE, service), self._key)
        self._declared.append(self._session.liveliness().declare_token(key))

    def publisher(self, topic: Topic, part: str = "*", *, lossless: bool = False) -> Publisher:
        """A publisher of a topic.

        Messages of an urgent topic go out at once and before all other traffic. All others have a queue of their
        own, in which many wait together for a busy receiver.

        Args:
            topic: topic to publish on.
            part: what takes the place of the `*` in the topic's key.
            lossless: whether to wait for slow subscribers; otherwise they lose messages they cannot take in time.
        """
        control = zenoh.CongestionControl
        publisher = self._session.declare_publisher(
            self.key(topic, part),
            encoding=JSON,
            congestion_control=control.BLOCK if lossless else control.DROP,
            priority=zenoh.Priority.REAL_TIME if topic.urgent else zenoh.Priority.INTERACTIVE_HIGH,
            express=topic.urgent,
        )
        return Publisher(publisher, Signer(self._key, self.key(topic)) if self._key else None)

    def subscribe(
        self,
        topic: Topic,
        message: type[M],
        receive: Callable[[M], Any],
        part: str = "*",
        *,
        stranger: Callable[[], Any] | None = None,
    ) -> Subscription:
        """Calls `receive` with every valid message of a topic.

        `receive` runs on a thread of Zenoh; it must return at once and raise nothing but a MessageError, with which
        it refuses the message. The subscription lasts as long as the session, unless it is ended before.
        """
        return self.subscribe_senders(topic, message, lambda found, sender: receive(found), part, stranger=stranger)

    def subscribe_senders(
        self,
        topic: Topic,
        message: type[M],
        receive: Callable[[M, bytes], Any],
        part: str = "*",
        *,
        stranger: Callable[[], Any] | None = None,
    ) -> Subscription:
        """Calls `receive` with every valid message of a topic and its sender.

        The sender is the name that the publisher chose for itself, or b"" in a cell without key. The first message
        that is refused because somebody without the cell's key has sent it calls `stranger`, on the same thread.
        """
        strangers = iter(() if stranger is None else (stranger,))
        reader = Reader(message)
        verify = Verifier(self._key, self.key(topic)) if self._key else None

        def deliver(sample: zenoh.Sample) -> None:
            _stay_attached()
            payload = _bytes(sample.payload)
            try:
                sender = b""
                if verify is not None:
                    sender = verify(payload, _attached(sample))
                receive(reader(payload), sender)
            except MessageError as error:
                self.refuse(error.reason, f"{sample.key_expr}: {error}")
                if error.reason in (UNSIGNED, FORGED):
                    for tell in strangers:
                        tell()

        return Subscription(self._declare(self._session.declare_subscriber, self.key(topic, part), deliver))

    def watch_raw(self, expression: str, receive: Callable[[str, bytes], Any]) -> None:
        """Calls `receive` with key and payload of all messages of the arm whose key matches an expression.

        Raises:
            ParameterError: it is no key expression.
        """

        def deliver(sample: zenoh.Sample) -> None:
            receive(str(sample.key_expr), _bytes(sample.payload))

        try:
            key = zenoh.KeyExpr(self._prefix + expression)
        except zenoh.ZError:
            raise ParameterError(f"{expression!r}: expected a key expression such as sensors or status/*") from None
        self._declare(self._session.declare_subscriber, str(key), deliver)

    def plain(self, name: str) -> Publisher:
        """A publisher in a form that others have laid down: unsigned, at a key of their own below that of the arm."""
        control, priority = zenoh.CongestionControl.DROP, zenoh.Priority.INTERACTIVE_HIGH
        publisher = self._session.declare_publisher(
            self._prefix + name, encoding=JSON, congestion_control=control, priority=priority
        )
        return Publisher(publisher, None)

    def retain(self, name: str, read: Callable[[], msgspec.Struct]) -> None:
        """Gives whoever asks for a key of `plain` the last message there, as a broker does that retains it."""
        key = self._prefix + name

        def reply(query: zenoh.Query) -> None:
            query.reply(key, encode(read()), encoding=JSON)

        handler = Callback(reply, lambda: None, indirect=False)
        self._declared.append(self._session.declare_queryable(key, handler))

    def retained(self, name: str, timeout: float = 1.0) -> bytes:
        """What `retain` gives at a key; b"" if nobody does within a time, s."""
        for reply in self._session.get(self._prefix + name, timeout=timeout):
            if reply.ok is not None:
                return _bytes(reply.ok.payload)
        return b""

    def watch_alive(self, receive: Callable[[str, bool], Any], service: str = "*") -> None:
        """Calls `receive` with the name of a service, or of that one, and whether its liveliness token exists, now
        and on changes.

        A service that starts again may be told to be there twice. In a cell with a key tokens count that were made
        with it.
        """
        presence = Presence(self.key(ALIVE, ""), self._key, receive)

        def deliver(sample: zenoh.Sample) -> None:
            try:
                presence.update(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)
            except MessageError as error:
                self.refuse(error.reason, str(error))

        def declare(key: str, handler: Callback) -> Any:
            return self._session.liveliness().declare_subscriber(key, handler, history=True)

        self._declare(declare, self.key(ALIVE, service if self._key is None else f"{service}/**"), deliver)

    def answer(
        self,
        topic: Topic,
        message: type[M],
        act: Callable[[M], Any] | None,
        read: Callable[[], Any] | None = None,
    ) -> None:
        """Answers the queries of a topic.

        A query that carries a message acts, and must name the exact key for that, and in a cell with a key be signed
        with it and come in time; it acts once. A query without one only reads, also when its key expression has
        wildcards. The text of a DtwinError is sent as the answer. Both functions run on a thread of their own.

        Args:
            topic: Topic of the queries.
            message: Type of the message that a query may carry.
            act: Function that returns the answer to a message; without it, a message only reads.
            read: Function that returns the answer to a query without message; without it, such a query is refused.
        """
        key = self.key(topic)
        answering = Answering(self._key, key) if self._key else None
        answerer = Answerer(key, message, act, read, topic.patience, answering, self.refuse)
        handler = Callback(answerer.receive, answerer.end, indirect=False)
        self._declared.append(self._session.declare_queryable(key, handler))

    def ask(self, topic: Topic, message: msgspec.Struct | None, reply: type[M], timeout: float | None = None) -> M:
        """Sends a query and returns its answer, in a cell with a key the one that the cell has signed.

        Args:
            topic: topic of the query.
            message: message that the query carries, or None.
            reply: type of the answer.
            timeout: longest wait for the answer, s; None for the patience of the topic.

        Raises:
            UnansweredError: no answer comes in time, or none that can be believed.
            CommunicationError: the answer is a refusal or no valid message.
        """
        key = self.key(topic)
        patience = topic.patience if timeout is None else timeout
        asking = Asking(self._key, key) if self._key else None
        question = Question(self._querier(key, patience), key, topic.sender, patience, asking, self.refuse)
        return Reader(reply)(question.answer(b"" if message is None else encode(message)))

    def _querier(self, key: str, patience: float) -> zenoh.Querier:
        """What asks for a key, declared once: every declaration costs all other sessions time."""
        with self._lock:
            if (key, patience) not in self._queriers:
                self._queriers[key, patience] = declare_querier(self._session, key, patience)
            return self._queriers[key, patience]

    def _declare(self, declare: Callable[[str, Any], Any], key: str, deliver: Callable[[Any], None]) -> Any:
        # Direct: a hand-over to another thread would cost as much as the way over the wire.
        declared = declare(key, Callback(deliver, lambda: None, indirect=False))
        self._declared.append(declared)
        return declared


def _stay_attached() -> None:
    """Lets the calling thread of Zenoh keep its state in Python until it ends.

    Python forgets a foreign thread at the end of a call that comes from it, with memory that the system maps and
    unmaps; for small messages that is a quarter of the work. The state is counted (PyGILState_Ensure): with one more
    entry than exits it stays.
    """
    if not hasattr(_threads, "attached"):
        _threads.attached = True
        ctypes.pythonapi.PyGILState_Ensure()


def _matching(status: Any) -> bool:
    """Whether a matching status reports a match; Zenoh's type stubs wrongly call the status a bool."""
    return bool(status.matching)


def _bytes(payload: zenoh.ZBytes) -> bytes:
    return payload.to_bytes()


def _attached(received: zenoh.Sample) -> bytes | None:
    attachment = received.attachment
    return None if attachment is None else _bytes(attachment)
