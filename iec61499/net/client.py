"""A blocking client that speaks the wire format, with a deadline on every exchange."""

from __future__ import annotations

import select
import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

from iec61499.errors import CommunicationError
from iec61499.net.address import StreamAddress
from iec61499.net.encoding import Value
from iec61499.net.sockets import Closing, connected_socket
from iec61499.net.stream import CHUNK
from iec61499.net.wire import Message, MessageReader, Signature


class BlockingClient(Closing):
    """Sends a message, waits for the answer.

    Args:
        address: the server's address.
        sends: the requests' signature.
        receives: the answers' signature.
        timeout: longest time to connect, and for every exchange, s.

    Attributes:
        lost: whether the connection is closed, by `close` or after an error.

    Raises:
        CommunicationError: nobody answers at the address.
    """

    def __init__(self, address: StreamAddress, sends: Signature, receives: Signature, timeout: float) -> None:
        self.address = address
        self.timeout = timeout
        self._sends = sends
        self._reader = MessageReader(receives)
        self._sock = connected_socket(address, timeout)
        self._come = select.poll()  # select.select refuses descriptors from 1024 on
        self._come.register(self._sock, select.POLLIN)
        self.lost = False

    def exchange(self, values: Sequence[Value]) -> Message:
        """The answer to a request.

        After an error the connection is closed: a late answer must not pass for that of the next request. It is an
        error, too, when something has come although nothing was asked: a server may send a late answer to who has
        connected meanwhile, and all later ones would be those of the requests before.

        Raises:
            CommunicationError: the answer is late, the connection is lost, or request or answer does not fit its
                signature.
        """
        try:
            data = self._sends.encode(values)
            self._expect_nothing()
            self._send(data)
            return self._received(1)[0]
        except (OSError, CommunicationError) as error:
            raise self._ended(error) from None

    def exchange_all(self, requests: Iterable[Sequence[Value]], window: int) -> Iterator[Message]:
        """The answers to requests, in order, while at most `window` of them wait for theirs.

        After an error, or when not all answers are taken, the connection is closed. A request is taken only when it
        is sent; with those that are under way then, `requests` may end when an answer says so.

        Raises:
            CommunicationError: as `exchange`; the time for every answer counts from the one before it.
        """
        coming = iter(requests)
        waiting = 0
        try:
            while True:
                # half a window goes while the other half is answered
                if waiting <= window // 2:
                    sent = [self._sends.encode(values) for values in islice(coming, window - waiting)]
                    waiting += len(sent)
                    if sent:
                        self._send(b"".join(sent))
                if not waiting:
                    return
                for answer in self._received(waiting):
                    waiting -= 1
                    yield answer
        except (OSError, CommunicationError) as error:
            raise self._ended(error) from None
        finally:
            if waiting:
                self.close()

    def close(self) -> None:
        self.lost = True
        self._sock.close()

    def _ended(self, error: OSError | CommunicationError) -> CommunicationError:
        """Closes the connection after an error, and says which."""
        self.close()
        if isinstance(error, TimeoutError):
            return CommunicationError(f"{self.address}: no answer within {self.timeout:g} s")
        if isinstance(error, OSError):
            return CommunicationError(f"{self.address}: connection lost: {error.strerror or error}")
        return CommunicationError(f"{self.address}: {error}")

    def _expect_nothing(self) -> None:
        """Raises CommunicationError when something has come before anything was asked."""
        if not self.lost and self._come.poll(0) and self._sock.recv(CHUNK):
            raise CommunicationError("more than one answer to a request")

    def _send(self, data: bytes) -> None:
        self._allow(self.timeout)
        self._sock.sendall(data)

    def _received(self, most: int) -> list[Message]:
        """The next answers, one or more; at most `most` may come."""
        self._allow(self.timeout)
        deadline = time.monotonic() + self.timeout
        while True:
            data = self._sock.recv(CHUNK)
            if not data:
                raise CommunicationError("connection lost: closed by the peer")
            answers = self._reader.feed(data)
            if len(answers) > most or (len(answers) == most and not self._reader.idle):
                raise CommunicationError("more than one answer to a request")
            if answers:
                return answers
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError
            self._allow(remaining)

    def _allow(self, seconds: float) -> None:
        """Sets the longest time for what is done to the socket next."""
        if self._sock.gettimeout() != seconds:  # Setting it costs a system call.
            self._sock.settimeout(seconds)
