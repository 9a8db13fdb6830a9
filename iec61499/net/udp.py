"""UDP for the communication blocks PUBLISH and SUBSCRIBE: one datagram a message, to one host or a group."""

from __future__ import annotations

import ipaddress
import logging
import socket
from collections.abc import Callable, Sequence
from typing import Final

from iec61499.errors import CommunicationError
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.encoding import Value
from iec61499.net.reactor import READ, Reactor
from iec61499.net.wire import Message, Signature

log = logging.getLogger(__name__)

DATAGRAM: Final = 65535
"""Largest datagram, bytes."""
BURST: Final = 100
"""Datagrams taken from one socket before the others have their turn."""


class UdpPublisher:
    """Carries the messages of a PUBLISH block.

    Args:
        address: the address of a host or of a multicast group.
        interface: IPv4 address of the network interface that multicast leaves by; loopback keeps it on this machine.
    """

    def __init__(self, address: Address, sends: Signature, interface: str = LOOPBACK) -> None:
        self._address = address
        self._sends = sends
        self._sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sock.setblocking(False)
        self._sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
        self._sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)

    def send(self, values: Sequence[Value]) -> None:
        """Sends a message to whoever listens.

        Raises:
            CommunicationError: the values do not fit the signature, or the network refuses them.
        """
        try:
            self._sock.sendto(self._sends.encode(values), self._address)
        except OSError as error:
            raise CommunicationError(f"{self._address}: cannot publish: {error.strerror or error}") from None

    def close(self) -> None:
        self._sock.close()


class UdpSubscriber:
    """Carries the messages of a SUBSCRIBE block; a datagram that is no such message costs a line in the log.

    Args:
        address: the group to join, or the local address to listen on.
        indicate: called with the values of every message.
        interface: IPv4 address of the network interface that multicast is taken from.

    Attributes:
        address: where it listens, with the port that the system chose when 0 was asked for.

    Raises:
        CommunicationError: the port cannot be bound, as another one listens there, or the group cannot be joined.
    """

    def __init__(
        self,
        reactor: Reactor,
        address: Address,
        receives: Signature,
        indicate: Callable[[Message], None],
        interface: str = LOOPBACK,
    ) -> None:
        self._reactor = reactor
        self._receives = receives
        self._indicate = indicate
        self._sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            grouped = ipaddress.IPv4Address(address.host).is_multicast
            if grouped:  # of those that shared the address of a host, only the last one would hear anything
                self._sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._sock.bind(address)
            if grouped:
                group = socket.inet_aton(address.host) + socket.inet_aton(interface)
                self._sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        except OSError as error:
            self._sock.close()
            raise CommunicationError(f"cannot subscribe to {address}: {error.strerror or error}") from None
        self._sock.setblocking(False)
        self.address = Address(*self._sock.getsockname())
        reactor.watch(self._sock, READ, self._ready)

    def close(self) -> None:
        if self._sock.fileno() >= 0:
            self._reactor.forget(self._sock)
            self._sock.close()

    def _ready(self, events: int) -> None:
        for _ in range(BURST):
            if self._sock.fileno() < 0:
                return
            try:
                data, (host, port) = self._sock.recvfrom(DATAGRAM)
            except OSError:
                return
            try:
                message = self._receives.decode(data)
            except CommunicationError as error:
                log.warning("%s:%d at port %d: %s; datagram ignored", host, port, self.address.port, error)
                continue
            self._indicate(message)
