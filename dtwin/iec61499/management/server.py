"""Serves device management at an address, to several clients at once.

Requests are carried out one after another, in the order in which they come, at most one in a turn of the reactor.
"""

from __future__ import annotations

import logging
import socket
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

from dtwin.errors import CommunicationError
from dtwin.iec61499.management.protocol import REQUESTS, RESPONSES, Response, request_id
from dtwin.iec61499.net.address import StreamAddress
from dtwin.iec61499.net.reactor import Reactor
from dtwin.iec61499.net.stream import StreamConnection, StreamListener
from dtwin.iec61499.net.wire import MessageReader

log = logging.getLogger(__name__)

CLIENTS: Final = 32
"""Most clients at once; one more takes the place of one without a request yet, else of the one silent longest."""

RequestHandler = Callable[[str, str, Callable[[str], None]], None]
"""Takes the resource's name and the request as XML; gives the response as XML to a function, now or later."""


class ManagementServer:
    """Listens for management clients.

    Attributes:
        address: where it listens, with the port that the system chose when 0 was asked for.

    Raises:
        CommunicationError: nobody can listen at the address.
    """

    def __init__(self, reactor: Reactor, address: StreamAddress, handle: RequestHandler) -> None:
        self._reactor = reactor
        self._handle = handle
        self._clients: dict[StreamConnection, MessageReader] = {}
        self._known: set[StreamConnection] = set()
        self._requests: deque[tuple[StreamConnection, str, str]] = deque()
        self._busy = False
        self._listener = StreamListener(reactor, address, self._accepted)
        self.address = self._listener.address

    def close(self) -> None:
        self._listener.close()
        for connection in self._clients:
            connection.close()
        self._requests.clear()
        self._clients.clear()
        self._known.clear()

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        if len(self._clients) >= CLIENTS:
            unknown = (client for client in self._clients if client not in self._known)
            next(unknown, next(iter(self._clients))).drop("silent longest of too many management clients")
        connection = StreamConnection(self._reactor, sock, peer, self._received, self._closed)
        self._clients[connection] = MessageReader(REQUESTS)

    def _received(self, connection: StreamConnection, data: bytes) -> None:
        try:
            messages = self._clients[connection].feed(data)
        except CommunicationError as error:
            connection.drop(str(error))
            return
        if messages:
            # who has spoken last stands last
            self._known.add(connection)
            self._clients[connection] = self._clients.pop(connection)
        self._requests += [(connection, _text(resource), _text(request)) for resource, request in messages]
        self._next()
        if any(waiting is connection for waiting, _, _ in self._requests):
            connection.read(False)

    def _next(self) -> None:
        """Carries out the request that waits longest, unless another one is in progress."""
        while self._requests and not self._busy:
            connection, resource, request = self._requests.popleft()
            if connection.open:
                self._busy = True
                self._handle(resource, request, partial(self._answer, connection, request))
                return

    def _answer(self, connection: StreamConnection, request: str, response: str) -> None:
        connection.send(_encoded(request, response))
        if connection.open and not any(waiting is connection for waiting, _, _ in self._requests):
            connection.read(True)
        self._busy = False
        if self._requests:
            self._reactor.call_soon(self._next)

    def _closed(self, connection: StreamConnection) -> None:
        del self._clients[connection]
        self._known.discard(connection)


def _text(string: str) -> str:
    """A STRING carries bytes: here those of UTF-8."""
    return string.encode("latin-1").decode("utf-8", "replace")


def _encoded(request: str, response: str) -> bytes:
    text = response.encode(errors="replace").decode("latin-1")
    try:
        return RESPONSES.encode([text])
    except CommunicationError:
        log.warning("management: response of %d bytes is too long", len(text))
        return RESPONSES.encode([Response(request_id(request), "OVERFLOW").xml()])
