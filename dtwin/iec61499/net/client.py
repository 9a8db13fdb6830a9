"""A blocking client that speaks the wire format, with a deadline on every exchange."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType

from dtwin.errors import CommunicationError
from dtwin.iec61499.net.address import StreamAddress
from dtwin.iec61499.net.encoding import Value
from dtwin.iec61499.net.sockets import connected_socket
from dtwin.iec61499.net.stream import CHUNK
from dtwin.iec61499.net.wire import Message, MessageReader, Signature


class BlockingClient:
    """Sends a message, waits for the answer.

    Args:
        address: the server's address.
        sends: the requests' signature.
        receives: the answers' signature.
        timeout: longest time to connect, and for every exchange, s.

    Raises:
        CommunicationError: nobody answers at the address.
    """

    def __init__(self, address: StreamAddress, sends: Signature, receives: Signature, timeout: float) -> None:
        self.address = address
        self.timeout = timeout
        self._sends = sends
        self._reader = MessageReader(receives)
        self._sock = connected_socket(address, timeout)

    def __enter__(self) -> BlockingClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def exchange(self, values: Sequence[Value]) -> Message:
        """The answer to a request.

        After an error the connection is closed: a late answer must not pass for that of the next request.

        Raises:
            CommunicationError: the answer is late, the connection is lost, or request or answer does not fit its
                signature.
        """
        try:
            return self._exchange(self._sends.encode(values))
        except TimeoutError:
            self.close()
            raise CommunicationError(f"{self.address}: no answer within {self.timeout:g} s") from None
        except OSError as error:
            self.close()
            raise CommunicationError(f"{self.address}: connection lost: {error.strerror or error}") from None
        except CommunicationError as error:
            self.close()
            raise CommunicationError(f"{self.address}: {error}") from None

    def close(self) -> None:
        self._sock.close()

    @property
    def lost(self) -> bool:
        """Whether the connection is closed, by `close` or after an error."""
        return self._sock.fileno() < 0

    def _exchange(self, request: bytes) -> Message:
        deadline = time.monotonic() + self.timeout
        if self._sock.gettimeout() != self.timeout:  # Setting it costs a system call.
            self._sock.settimeout(self.timeout)
        self._sock.sendall(request)
        while True:
            data = self._sock.recv(CHUNK)
            if not data:
                raise CommunicationError("connection lost: closed by the peer")
            messages = self._reader.feed(data)
            if len(messages) == 1 and self._reader.idle:
                return messages[0]
            if messages:
                raise CommunicationError("more than one answer to a request")
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError
            self._sock.settimeout(remaining)
