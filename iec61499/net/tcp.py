"""TCP for the communication block CLIENT: a non-blocking socket on a reactor."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Sequence

from iec61499.errors import CommunicationError
from iec61499.net.address import Address
from iec61499.net.encoding import Value
from iec61499.net.reactor import WRITE, Reactor, Timer
from iec61499.net.stream import StreamConnection
from iec61499.net.wire import Message, Signature


class TcpClient:
    """Carries the messages of a CLIENT block: connects without waiting, then exchanges messages.

    Args:
        opened: called once with "" when connected, or with the reason why not.
        confirm: called with the values of every message.
        lost: called when the connection ends, unless `close` ended it.
        timeout: longest time to connect, s.
    """

    def __init__(
        self,
        reactor: Reactor,
        address: Address,
        receives: Signature,
        sends: Signature,
        *,
        opened: Callable[[str], None],
        confirm: Callable[[Message], None],
        lost: Callable[[], None],
        timeout: float = 1.0,
    ) -> None:
        self._reactor = reactor
        self._address = address
        self._sends = sends
        self._reader = receives.reader()
        self._opened = opened
        self._confirm = confirm
        self._lost = lost
        self._connection: StreamConnection | None = None
        self._sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._sock.setblocking(False)
        self._sock.connect_ex(address)
        self._timer: Timer = reactor.call_at(reactor.now() + timeout, self._late)
        reactor.watch(self._sock, WRITE, self._connected)

    @property
    def connected(self) -> bool:
        return self._connection is not None

    def send(self, values: Sequence[Value]) -> None:
        """Sends a message.

        Raises:
            CommunicationError: there is no connection, or the values do not fit the signature.
        """
        if self._connection is None:
            raise CommunicationError(f"{self._address}: not connected")
        self._connection.send(self._sends.encode(values))

    def close(self) -> None:
        self._timer.cancel()
        if self._connection is not None:
            self._connection.close()
            self._connection = None
        elif self._sock.fileno() >= 0:
            self._reactor.forget(self._sock)
            self._sock.close()

    def _connected(self, events: int) -> None:
        self._timer.cancel()
        self._reactor.forget(self._sock)
        code = self._sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code:
            self._fail(os.strerror(code))
            return
        self._connection = StreamConnection(
            self._reactor, self._sock, str(self._address), self._received, self._ended
        )
        self._opened("")

    def _late(self) -> None:
        self._reactor.forget(self._sock)
        self._fail("no answer in time")

    def _fail(self, reason: str) -> None:
        self._sock.close()
        self._opened(f"{self._address}: cannot connect: {reason}")

    def _received(self, connection: StreamConnection, data: bytes) -> None:
        try:
            messages = self._reader.feed(data)
        except CommunicationError as error:
            connection.drop(str(error))
            return
        for message in messages:
            if self._connection is connection:
                self._confirm(message)

    def _ended(self, connection: StreamConnection) -> None:
        self._connection = None
        self._lost()
