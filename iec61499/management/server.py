"""Serves device management at an address, to several clients at once.

Requests are carried out one after another, in the order in which they come, for a short time in a turn of the
reactor. A client need not wait for a response before its next request: of what it sends no more is read than a chunk,
until all requests in it have been answered.
"""

from __future__ import annotations

import logging
import socket
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Final

from iec61499.errors import CommunicationError
from iec61499.management.protocol import (
    REQUESTS,
    RESPONSES,
    WINDOW,
    ManagementError,
    Request,
    Response,
    Window,
    parse_request,
    request_id,
)
from iec61499.net.address import StreamAddress
from iec61499.net.reactor import Reactor, Timer
from iec61499.net.stream import StreamConnection, StreamListener
from iec61499.net.wire import MessageReader

log = logging.getLogger(__name__)

CLIENTS: Final = 32
"""Most clients at once; one more takes the place of one without a request yet, else of the one silent longest."""
TURN: Final = 0.001
"""Time for which requests are carried out in one turn of the reactor, s; the last of them may take longer."""

RequestHandler = Callable[[str, Request, Callable[[Response | Exception], None]], None]
"""Takes the resource's name and the request; gives the response, or why it refuses, to a function, now or later."""

_LONGEST_DETAIL: Final = 1000
"""Characters of the words that say why a request is refused."""


@dataclass(slots=True)
class _Session:
    """A client's connection.

    Attributes:
        waiting: requests that are not answered yet.
        replies: responses that are not sent yet.
        fulfilled: the ID of the last request if it was fulfilled, else "".
        known: whether a request has come.
        told: whether the client has asked for the window: so it knows what only these devices say.
    """

    reader: MessageReader = field(default_factory=lambda: MessageReader(REQUESTS))
    waiting: int = 0
    replies: bytearray = field(default_factory=bytearray)
    fulfilled: str = ""
    known: bool = False
    told: bool = False


class ManagementServer:
    """Listens for management clients.

    A refusal is one line in the log. What the device does not support is logged below warnings: a client may ask to
    find out.

    Attributes:
        address: where it listens, with the port that the system chose when 0 was asked for.

    Raises:
        CommunicationError: nobody can listen at the address.
    """

    def __init__(self, reactor: Reactor, address: StreamAddress, handle: RequestHandler) -> None:
        self._reactor = reactor
        self._handle = handle
        self._sessions: dict[StreamConnection, _Session] = {}
        self._requests: deque[tuple[StreamConnection, str, str]] = deque()
        self._answered: dict[StreamConnection, None] = {}
        self._busy = False
        self._serving = False
        self._next_turn: Timer | None = None
        self._listener = StreamListener(reactor, address, self._accepted)
        self.address = self._listener.address

    def close(self) -> None:
        self._listener.close()
        for connection in self._sessions:
            connection.close()
        self._requests.clear()
        self._sessions.clear()

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        if len(self._sessions) >= CLIENTS:
            unknown = (connection for connection, session in self._sessions.items() if not session.known)
            next(unknown, next(iter(self._sessions))).drop("silent longest of too many management clients")
        connection = StreamConnection(self._reactor, sock, peer, self._received, self._closed)
        self._sessions[connection] = _Session()

    def _received(self, connection: StreamConnection, data: bytes) -> None:
        session = self._sessions[connection]
        try:
            messages = session.reader.feed(data)
        except CommunicationError as error:
            connection.drop(str(error))
            return
        if not messages:
            return
        session.known = True
        session.waiting += len(messages)
        # who has spoken last stands last
        self._sessions[connection] = self._sessions.pop(connection)
        self._requests += [(connection, _text(resource), _text(request)) for resource, request in messages]
        self._carry_out()
        if session.waiting:
            connection.read(False)

    def _carry_out(self) -> None:
        """Carries out requests for one turn, unless one is in progress; responses to one client go together."""
        self._serving = True
        ends = self._reactor.now() + TURN
        while self._requests and not self._busy and self._reactor.now() < ends:
            connection, resource, text = self._requests.popleft()
            if connection.open:
                self._busy = True
                self._start_request(connection, resource, text)
        self._serving = False
        answered, self._answered = self._answered, {}
        for connection in answered:
            session = self._sessions.get(connection)
            if session is not None:
                replies, session.replies = session.replies, bytearray()
                connection.send(bytes(replies))
                connection.read(session.waiting == 0)
        if self._requests and not self._busy:
            self._go_on()

    def _go_on(self) -> None:
        """Lets another turn follow."""
        if self._next_turn is None:
            self._next_turn = self._reactor.call_soon(self._turn)

    def _turn(self) -> None:
        self._next_turn = None
        self._carry_out()

    def _start_request(self, connection: StreamConnection, resource: str, text: str) -> None:
        answer = partial(self._answer, connection, text)
        try:
            request = parse_request(text)
        except Exception as error:
            answer("", error)
            return
        if request.after and request.after != self._sessions[connection].fulfilled:
            answer(request.id, Response(request.id, "NOT_READY"))
        elif isinstance(request.subject, Window):
            self._sessions[connection].told = True
            answer(request.id, Response(request.id, window=WINDOW))
        else:
            self._handle(resource, request, partial(answer, request.id))

    def _answer(self, connection: StreamConnection, text: str, number: str, outcome: Response | Exception) -> None:
        self._busy = False
        session = self._sessions.get(connection)
        told = session is not None and session.told
        response = _refusal(text, outcome, told) if isinstance(outcome, Exception) else outcome
        if session is not None:
            session.waiting -= 1
            session.fulfilled = number if response.reason is None else ""
            session.replies += _encoded(response)
            self._answered[connection] = None
        if not self._serving:
            self._go_on()

    def _closed(self, connection: StreamConnection) -> None:
        del self._sessions[connection]


def _text(string: str) -> str:
    """A STRING carries bytes: here those of UTF-8."""
    return string.encode("latin-1").decode("utf-8", "replace")


def _refusal(text: str, error: Exception, told: bool) -> Response:
    """The response to a request that is refused, in words if the client is to be told."""
    if isinstance(error, ManagementError):
        log.log(logging.INFO if error.reason == "UNSUPPORTED_CMD" else logging.WARNING, "management: %s", error)
        return Response(request_id(text), error.reason, detail=str(error)[:_LONGEST_DETAIL] if told else "")
    log.error("management: %.200s: %s: %s", text, type(error).__name__, error)
    return Response(request_id(text), "INVALID_OPERATION")


def _encoded(response: Response) -> bytes:
    text = response.xml().encode(errors="replace").decode("latin-1")
    try:
        return RESPONSES.encode([text])
    except CommunicationError:
        log.warning("management: response of %d bytes is too long", len(text))
        return RESPONSES.encode([Response(response.id, "OVERFLOW").xml()])
