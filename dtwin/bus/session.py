"""The bus that joins the services: a Zenoh session with typed topics. Nothing else in the project knows Zenoh.

Without a configuration file the sessions are peers on the loopback interface and need no broker: whoever comes first
listens at the rendezvous and receives the others, who then know and join each other directly. When the first one goes
the others stay joined, and the next one to come takes its place. Nobody looks for others by multicast.
"""

from __future__ import annotations

import errno
import json
import logging
import re
import socket
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import msgspec
import zenoh
from zenoh.handlers import Callback

from dtwin.bus.codec import M, MessageError, Reader, encode
from dtwin.bus.messages import ALIVE, Topic
from dtwin.bus.signature import Signer, Verifier
from dtwin.errors import CommunicationError, DtwinError, UnansweredError

log = logging.getLogger(__name__)

RENDEZVOUS: Final = "tcp/127.0.0.1:7461"
"""Where services meet that nobody told otherwise."""
TIMEOUT: Final = 5.0
"""s, for the answer to a query"""
EXPLAIN: Final = 2.0
"""s that joining may take before it is said why"""
_TRANSPORT_LIMIT: Final = 1 << 20
"""bytes: what a session takes from a peer before it is put together to one message"""
_LOG: Final = "error,zenoh::net::protocol::gossip=off,zenoh::api::session=off"
"""Those two say for every message on its way to a session that has just closed that it is not there."""
_RETRY: Final = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}
_TLS_FILES: Final = tuple(
    f"transport/link/tls/{name}"
    for name in (
        "root_ca_certificate",
        "listen_certificate",
        "listen_private_key",
        "connect_certificate",
        "connect_private_key",
    )
)
_JSON: Final = zenoh.Encoding.APPLICATION_JSON
_SAID: Final = 3
"""Refusals of one kind that are logged one by one; after that they are only counted."""


def open_peer(rendezvous: str = RENDEZVOUS) -> zenoh.Session:
    """A session without a file: a peer that meets others at an endpoint such as tcp/HOST:PORT.

    Raises:
        CommunicationError: that is no endpoint of this machine.
    """
    taken = _taken(rendezvous)
    spoke = _peer([f"{rendezvous.rpartition(':')[0]}:0"], [rendezvous])
    if taken:
        return _open(spoke)
    try:
        return _open(_peer([rendezvous], []))
    except CommunicationError:
        # somebody was faster
        if not _taken(rendezvous):
            raise
        return _open(spoke)


def _taken(endpoint: str) -> bool:
    """Whether somebody listens at a TCP endpoint."""
    match = re.fullmatch(r"tcp/(\d+(?:\.\d+){3}):(\d{1,5})", endpoint)
    if match is None or not 0 < int(match[2]) < 65536:
        raise CommunicationError(f"{endpoint!r}: expected an endpoint such as {RENDEZVOUS}")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((match[1], int(match[2])))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                return True
            raise CommunicationError(f"{endpoint}: {error.strerror}") from None
    return False


def open_configured(path: Path, name: str) -> zenoh.Session:
    """A session after a Zenoh configuration file, or after `NAME.json5` or else `service.json5` of a folder.

    Paths of certificates and keys are relative to the file.

    Raises:
        CommunicationError: the file is missing or no Zenoh configuration, or the session cannot be opened.
    """
    file = path
    if path.is_dir():
        file = next(
            (f for f in (path / f"{name}.json5", path / "service.json5") if f.is_file()), path / f"{name}.json5"
        )
    opened = threading.Event()

    def explain() -> None:
        """Zenoh tries for ever without a word; a session that gives up says what is wrong."""
        while not opened.wait(EXPLAIN):
            hasty = _configuration(file)
            hasty.insert_json5("connect/exit_on_failure", "true")
            hasty.insert_json5("connect/timeout_ms", "0")
            try:
                zenoh.open(hasty).close()
            except zenoh.ZError as error:
                log.warning("cannot join yet: %s Is a router there, and does it take the certificate?", _line(error))

    configuration = _configuration(file)
    threading.Thread(target=explain, name="explain", daemon=True).start()
    try:
        return _open(configuration)
    finally:
        opened.set()


def _configuration(file: Path) -> zenoh.Config:
    try:
        configuration = zenoh.Config.from_file(file)
        for key in _TLS_FILES:
            relative = json.loads(configuration.get_json(key))
            if relative:
                path = file.resolve().parent / relative
                if not path.is_file():
                    raise CommunicationError(f"{file}: {path} is missing: see scripts/certificates")
                configuration.insert_json5(key, json.dumps(str(path)))
    except zenoh.ZError as error:
        raise CommunicationError(f"{file}: no Zenoh configuration: {_line(error)}") from None
    return configuration


def _peer(listen: list[str], connect: list[str]) -> zenoh.Config:
    settings = {
        "mode": "peer",
        "scouting": {"multicast": {"enabled": False}},
        "listen": {"endpoints": listen, "exit_on_failure": True},
        "connect": {"endpoints": connect, "exit_on_failure": False, "timeout_ms": -1, "retry": _RETRY},
        # Shared memory would let large messages past the limit.
        "transport": {
            "link": {"rx": {"max_message_size": _TRANSPORT_LIMIT}},
            "shared_memory": {"enabled": False},
        },
    }
    try:
        return zenoh.Config.from_json5(json.dumps(settings))
    except zenoh.ZError as error:
        raise CommunicationError(f"expected Zenoh endpoints such as {RENDEZVOUS}: {_line(error)}") from None


def _open(configuration: zenoh.Config) -> zenoh.Session:
    zenoh.init_log_from_env_or(_LOG)
    try:
        return zenoh.open(configuration)
    except zenoh.ZError as error:
        raise CommunicationError(f"cannot open a Zenoh session: {_line(error)}") from None


class Publisher:
    """Publishes the messages it is called with, and signs them if the cell has a key."""

    def __init__(self, publisher: zenoh.Publisher, signer: Signer | None) -> None:
        self._publisher = publisher
        self._put = publisher.put
        self._signer = signer
        self._expression = str(publisher.key_expr)
        self._lock = threading.Lock()

    def __call__(self, message: msgspec.Struct) -> None:
        payload = encode(message)
        if self._signer is None:
            self._put(payload)
            return
        with self._lock:  # numbers leave in order
            self._put(payload, attachment=self._signer(self._expression, payload))

    @property
    def wanted(self) -> bool:
        """Whether anybody subscribes."""
        return _matching(self._publisher.matching_status)


class Subscription:
    """A subscription that can be ended before its session."""

    def __init__(self, subscriber: Any) -> None:
        self._end = subscriber.undeclare

    def end(self) -> None:
        """Nothing is received any more, and the publisher learns that it is not wanted; once only."""
        self._end()


class Bus:
    """One session, under the keys of one arm.

    Args:
        session: The session; this object closes it.
        cell: The cell's name in the keys.
        arm: The arm's name in the keys.
        key: The secret of the cell's services. With it, everything that is published is signed, and only what
            is signed with it is received; without it, everything is received.

    Attributes:
        refused: messages refused since the start, by reason; read and written from several threads.
        last_refusal: the last one in words.
    """

    def __init__(
        self, session: zenoh.Session, cell: str = "cell", arm: str = "arm", key: bytes | None = None
    ) -> None:
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        self._prefix = f"dtwin/{cell}/{arm}/"
        self._lock = threading.Lock()
        self._session = session
        self._key = key
        self._declared: list[Any] = []

    def __enter__(self) -> Bus:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Ends the session; tokens and subscriptions end with it."""
        self._session.close()

    def peers(self) -> int:
        """How many other sessions this one is joined to."""
        return len(self._session.info.peers_zid()) + len(self._session.info.routers_zid())

    def key(self, topic: Topic, part: str = "*") -> str:
        """The key expression of a topic; `part` takes the place of its `*`."""
        return self._prefix + topic.name.replace("*", part)

    def refuse(self, reason: str, detail: str) -> None:
        """Counts a message that is not used and says why."""
        with self._lock:
            self.refused[reason] += 1
            count = self.refused[reason]
        self.last_refusal = f"{reason}: {detail}"
        if count <= _SAID:
            rest = "; more of these are only counted" if count == _SAID else ""
            log.warning("refused %s%s", self.last_refusal, rest)

    def announce(self, service: str) -> None:
        """Shows the service's token while the session lives."""
        self._declared.append(self._session.liveliness().declare_token(self.key(ALIVE, service)))

    def publisher(self, topic: Topic, part: str = "*", *, lossless: bool = False) -> Publisher:
        """Publishes messages of a topic, at once and before all other traffic.

        Args:
            lossless: wait for slow subscribers; otherwise messages that they cannot take are lost to them.
        """
        control = zenoh.CongestionControl
        publisher = self._session.declare_publisher(
            self.key(topic, part),
            encoding=_JSON,
            congestion_control=control.BLOCK if lossless else control.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        return Publisher(publisher, Signer(self._key) if self._key else None)

    def subscribe(self, topic: Topic, message: type[M], receive: Callable[[M], Any], part: str = "*") -> Subscription:
        """Calls `receive` with every valid message, on a thread of Zenoh's; it must return at once and not raise.

        It ends with the session, or before that by what is returned.
        """
        return self.subscribe_senders(topic, message, lambda found, sender: receive(found), part)

    def subscribe_senders(
        self, topic: Topic, message: type[M], receive: Callable[[M, bytes], Any], part: str = "*"
    ) -> Subscription:
        """The same, with the sender of each message: one publisher's name for itself, b"" in a cell without key."""
        reader = Reader(message)
        verify = Verifier(self._key) if self._key else None

        def take(sample: zenoh.Sample) -> None:
            payload = _bytes(sample.payload)
            try:
                sender = b""
                if verify is not None:
                    attachment = None if sample.attachment is None else _bytes(sample.attachment)
                    sender = verify(str(sample.key_expr), payload, attachment)
                receive(reader(payload), sender)
            except MessageError as error:
                self.refuse(error.reason, f"{sample.key_expr}: {error}")

        return Subscription(self._declare(self._session.declare_subscriber, self.key(topic, part), take))

    def watch_raw(self, expression: str, receive: Callable[[str, bytes], Any]) -> None:
        """Calls `receive` with key and payload of everything published under the arm's keys that matches."""

        def take(sample: zenoh.Sample) -> None:
            receive(str(sample.key_expr), _bytes(sample.payload))

        self._declare(self._session.declare_subscriber, self._prefix + expression, take)

    def watch_alive(self, receive: Callable[[str, bool], Any]) -> None:
        """Calls `receive` with a service's name and whether its token is there, now and at every change."""

        def take(sample: zenoh.Sample) -> None:
            receive(str(sample.key_expr).rpartition("/")[2], sample.kind == zenoh.SampleKind.PUT)

        def declare(key: str, handler: Callback) -> Any:
            return self._session.liveliness().declare_subscriber(key, handler, history=True)

        self._declare(declare, self.key(ALIVE), take)

    def answer(self, topic: Topic, message: type[M], handle: Callable[[M | None], Any]) -> None:
        """Answers queries with what `handle` returns for their message, or for None when they carry none.

        Args:
            handle: called on a thread of Zenoh's; a DtwinError it raises is the asker's answer.
        """
        reader = Reader(message)

        def take(query: zenoh.Query) -> None:
            with query:
                try:
                    asked = reader(_bytes(query.payload)) if query.payload else None
                    query.reply(query.key_expr, encode(handle(asked)), encoding=_JSON)
                except MessageError as error:
                    self.refuse(error.reason, f"{query.key_expr}: {error}")
                    query.reply_err(str(error))
                except DtwinError as error:
                    query.reply_err(str(error))

        # A thread of its own: what is asked for may take a while, and signals come in on Zenoh's own thread.
        handler = Callback(take, lambda: None, indirect=True)
        self._declared.append(self._session.declare_queryable(self.key(topic), handler))

    def ask(self, topic: Topic, message: msgspec.Struct | None, reply: type[M], timeout: float = TIMEOUT) -> M:
        """The answer to a query.

        Raises:
            UnansweredError: nobody answers in time.
            CommunicationError: the answer is a refusal or no valid message.
        """
        key = self.key(topic)
        hint = f"is the service {topic.sender} there, and may this session ask it?"
        nobody = f"{key}: nobody answered within {timeout:g} s; {hint}"
        there = threading.Event()
        querier = self._session.declare_querier(key, timeout=timeout)

        def note(status: Any) -> None:
            if status.matching:
                there.set()

        listener = querier.declare_matching_listener(Callback(note, lambda: None))
        try:
            # whoever has just joined does not know the others yet
            if not (_matching(querier.matching_status) or there.wait(timeout)):
                raise UnansweredError(nobody)
            for answer in querier.get(payload=b"" if message is None else encode(message), encoding=_JSON):
                if answer.err is not None:
                    raise CommunicationError(f"{key}: {_bytes(answer.err.payload).decode(errors='replace')}")
                if answer.ok is not None:
                    return Reader(reply)(_bytes(answer.ok.payload))
            raise UnansweredError(nobody)
        finally:
            listener.undeclare()
            querier.undeclare()

    def _declare(self, declare: Callable[[str, Any], Any], key: str, take: Callable[[Any], None]) -> Any:
        # Direct: a hand-over to another thread would cost as much as the way over the wire.
        declared = declare(key, Callback(take, lambda: None, indirect=False))
        self._declared.append(declared)
        return declared


def _matching(status: Any) -> bool:
    """Zenoh's stubs call the status a bool, which it is not."""
    return bool(status.matching)


def _bytes(payload: zenoh.ZBytes) -> bytes:
    return payload.to_bytes()


def _line(error: Exception) -> str:
    """Zenoh's words without the places in its source."""
    return " ".join(re.sub(r" at /\S+", "", str(error)).split())
