"""Streams under the SERVER blocks and device management: non-blocking sockets on one reactor, no threads.

A stream is a TCP connection or one over a Unix domain socket; the messages are the same.

A peer that breaks the wire format, reads too slowly or asks for a port in use costs one line in the log and its
connection, never the loop.
"""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable, Sequence
from typing import Final

from iec61499.errors import CommunicationError
from iec61499.net.address import StreamAddress
from iec61499.net.encoding import Value
from iec61499.net.reactor import READ, WRITE, Reactor
from iec61499.net.sockets import BACKLOG, ListeningSocket, tune
from iec61499.net.wire import Message, Reader, Signature

log = logging.getLogger(__name__)

CANDIDATES: Final = 64
"""Silent connections a server keeps while nobody has spoken; the oldest gives way."""
CHUNK: Final = 4096
"""Most bytes taken from one peer before the others have their turn."""
UNSENT_LIMIT: Final = 1 << 20
"""Bytes a peer may leave unread before it is dropped."""


class StreamConnection:
    """One connected peer.

    Args:
        reactor: the event loop that serves the socket.
        sock: a connected socket, which belongs to this object from here on.
        peer: the peer's name in the log.
        received: called with the bytes as they come.
        closed: called once when the peer has gone or was dropped, not after `close`.
    """

    def __init__(
        self,
        reactor: Reactor,
        sock: socket.socket,
        peer: str,
        received: Callable[[StreamConnection, bytes], None],
        closed: Callable[[StreamConnection], None],
    ) -> None:
        self.peer = peer
        self._reactor = reactor
        self._sock = sock
        self._received = received
        self._closed = closed
        self._unsent = bytearray()
        self._reading = True
        sock.setblocking(False)
        tune(sock)
        self._watch()

    @property
    def open(self) -> bool:
        return self._sock.fileno() >= 0

    def send(self, data: bytes) -> None:
        """Sends now what the kernel takes, and the rest when it can."""
        if not self.open:
            return
        if not self._unsent:
            try:
                data = data[self._sock.send(data) :]
            except BlockingIOError:
                pass
            except OSError as error:
                self.drop(error.strerror or str(error), logging.INFO)
                return
        if data:
            self._unsent += data
            if len(self._unsent) > UNSENT_LIMIT:
                self.drop(f"left {len(self._unsent)} bytes unread")
            else:
                self._watch()

    def read(self, reading: bool) -> None:
        """Whether the peer is read from now on; otherwise what it sends waits with the kernel."""
        if reading != self._reading and self.open:
            self._reading = reading
            self._watch()

    def notice_end(self) -> None:
        """Closes the connection now if the peer has closed it and nothing is left to read."""
        try:
            ended = not self._sock.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return
        except OSError:
            ended = True
        if ended:
            self.drop("closed by the peer", logging.DEBUG)

    def drop(self, reason: str, level: int = logging.WARNING) -> None:
        """Closes the connection, says why in the log, and tells the owner."""
        if self.open:
            log.log(level, "%s: %s; connection closed", self.peer, reason)
            self.close()
            self._closed(self)

    def close(self) -> None:
        """Closes the connection without a word."""
        if self.open:
            self._reactor.forget(self._sock)
            self._sock.close()

    def _ready(self, events: int) -> None:
        if events & WRITE:
            self._flush()
        if events & READ and self.open:
            try:
                data = self._sock.recv(CHUNK)
            except BlockingIOError:
                return
            except OSError as error:
                self.drop(error.strerror or str(error), logging.INFO)
                return
            if data:
                self._received(self, data)
            else:
                self.drop("closed by the peer", logging.DEBUG)

    def _flush(self) -> None:
        try:
            del self._unsent[: self._sock.send(self._unsent)]
        except BlockingIOError:
            return
        except OSError as error:
            self.drop(error.strerror or str(error), logging.INFO)
            return
        if not self._unsent:
            self._watch()

    def _watch(self) -> None:
        events = READ * self._reading | WRITE * bool(self._unsent)
        if events:
            self._reactor.watch(self._sock, events, self._ready)
        else:
            self._reactor.forget(self._sock)


class StreamListener:
    """Accepts connections at an address.

    Attributes:
        address: where it listens, with the port that the system chose when 0 was asked for.

    Raises:
        CommunicationError: nobody can listen at the address.
    """

    def __init__(
        self, reactor: Reactor, address: StreamAddress, accepted: Callable[[socket.socket, str], None]
    ) -> None:
        self._reactor = reactor
        self._accepted = accepted
        self._listening = ListeningSocket(address)
        self.address = self._listening.address
        reactor.watch(self._listening.sock, READ, self._ready)

    def close(self) -> None:
        if self._listening.sock.fileno() >= 0:
            self._reactor.forget(self._listening.sock)
            self._listening.close()

    def _ready(self, events: int) -> None:
        for _ in range(BACKLOG):
            try:
                sock, peer = self._listening.accept()
            except OSError:
                # none left, or the peer has gone meanwhile, or no descriptor is free: the next round tries again
                return
            self._accepted(sock, peer)


class StreamServer:
    """Carries the messages of a SERVER block: one client at a time, as in 4diac FORTE.

    Connections wait side by side until one has sent its first whole message; it becomes the client, the others
    are closed, and so is every connection that comes while it stays. So a peer that connects and says nothing
    keeps nobody out. Until then what the block sends goes to all of them, as the clients of a block that only sends
    say nothing.

    Args:
        indicate: called with the values of every message.
    """

    def __init__(
        self,
        reactor: Reactor,
        address: StreamAddress,
        receives: Signature,
        sends: Signature,
        indicate: Callable[[Message], None],
    ) -> None:
        self._reactor = reactor
        self._receives = receives
        self._sends = sends
        self._indicate = indicate
        self._client: StreamConnection | None = None
        self._readers: dict[StreamConnection, Reader] = {}
        self._listener = StreamListener(reactor, address, self._accepted)
        self.address = self._listener.address

    def send(self, values: Sequence[Value]) -> None:
        """Sends a message to the client, or to those who wait; without any it is lost.

        Raises:
            CommunicationError: the values do not fit the signature.
        """
        data = self._sends.encode(values)
        for connection in [self._client] if self._client is not None else list(self._readers):
            connection.send(data)

    def close(self) -> None:
        self._listener.close()
        for connection in list(self._readers):
            connection.close()
        self._readers.clear()
        self._client = None

    def _accepted(self, sock: socket.socket, peer: str) -> None:
        if self._client is not None:
            # a client that comes back finds its port free, although its old connection's end may not be served yet
            self._client.notice_end()
        if self._client is not None:
            log.warning("%s: refused, %s is served", peer, self._client.peer)
            sock.close()
            return
        if len(self._readers) >= CANDIDATES:
            next(iter(self._readers)).drop("silent, and too many wait")
        connection = StreamConnection(self._reactor, sock, peer, self._received, self._closed)
        self._readers[connection] = self._receives.reader()

    def _received(self, connection: StreamConnection, data: bytes) -> None:
        try:
            messages = self._readers[connection].feed(data)
        except CommunicationError as error:
            connection.drop(str(error))
            return
        if messages and self._client is None:
            self._client = connection
            for other in [other for other in self._readers if other is not connection]:
                other.drop(f"{connection.peer} has spoken first")
        for message in messages:
            # the block may have been closed by what the message before led to
            if self._client is connection:
                self._indicate(message)

    def _closed(self, connection: StreamConnection) -> None:
        del self._readers[connection]
        if connection is self._client:
            self._client = None
