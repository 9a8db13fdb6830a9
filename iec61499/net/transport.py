"""Carries the values of communication blocks over streams and UDP, and those of local blocks in process.

IDs are `HOST:PORT` or `fbdk[].ip[HOST:PORT]`, or `raw[].ip[HOST:PORT]` for texts; a server binds the host its ID
names, so `localhost:61500` stays on this machine. In a device whose management listens on a Unix domain socket, a
server listens on one, too: in the same folder, under the port number of its ID. PUBL_n, SUBL_n and IDs such as
`loc[NAME]` meet in process. `opc_ua[...]` and `...mqtt[...]` go by what the device's blocks share, `protocols`.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from iec61499.errors import CommunicationError
from iec61499.net.address import LOOPBACK, Address, StreamAddress, parse_numeric_address
from iec61499.net.inlet import Inlet, Perform
from iec61499.net.layers import parse_layers
from iec61499.net.protocols import Protocols, needs_library, signatures
from iec61499.net.reactor import Reactor, Timer
from iec61499.net.stream import StreamServer
from iec61499.net.tcp import TcpClient
from iec61499.net.udp import UdpPublisher, UdpSubscriber
from iec61499.net.wire import Message, Signature
from iec61499.runtime.communication import Channel, CommunicationPort, LocalTransport, Values

log = logging.getLogger(__name__)

RETRY: Final = 1.0
"""Time after which a client asks again for a server that does not listen, s."""


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What the resources of one device share to reach others.

    Attributes:
        local: connects blocks in process.
        protocols: what reaches others by more than sockets.
        management: address of the device's management.
    """

    local: LocalTransport
    protocols: Protocols
    management: StreamAddress


class NetworkTransport:
    """Opens channels on a reactor; the log says why it cannot, since a block's STATUS has no room for that.

    Args:
        reactor: the event loop that serves the sockets.
        surroundings: what the device's resources share; multicast uses the network interface of its management.
        perform: does something to the resource and lets it run.
        receive: the same, for what a block of the same device sends.

    Attributes:
        addresses: where the open SERVER and SUBSCRIBE blocks listen, by the block's dotted name.
    """

    def __init__(
        self,
        reactor: Reactor,
        surroundings: Surroundings,
        perform: Perform,
        receive: Perform,
    ) -> None:
        self.addresses: dict[str, StreamAddress] = {}
        self._reactor = reactor
        self._local = surroundings.local
        self._protocols = surroundings.protocols
        self._perform = perform
        self._receive = receive
        self._management = management = surroundings.management
        self._interface = management.host if isinstance(management, Address) else LOOPBACK

    def open(self, port: CommunicationPort) -> Channel:
        """Opens a channel; as `communication.Transport.open`.

        Raises:
            CommunicationError: the ID is no address, the port is taken, or a type cannot be sent.
        """
        try:
            return self._open_local(port) if port.is_local else self._open(port)
        except CommunicationError as error:
            log.warning("%s: %s", port.name, error)
            raise

    def _open_local(self, port: CommunicationPort) -> Channel:
        def receive(values: Values) -> None:
            self._receive(partial(port.deliver, values))

        return self._local.open(port, receive)

    def _open(self, port: CommunicationPort) -> Channel:
        layers = parse_layers(port.id)
        if needs_library(layers):
            return self._protocols.open(Inlet(self._reactor, port, self._perform), layers)
        sends, receives = signatures(layers, port.kind, port.sends, port.receives)
        # Names are not looked up, as in 4diac FORTE: that would stop the event loop.
        address = parse_numeric_address(layers[-1].parameters)
        perform = self._perform
        if port.kind == "CLIENT":
            return _ClientChannel(self._reactor, address, receives, sends, port, self._perform)

        def indicate(message: Message) -> None:
            perform(partial(_deliver, port, message))

        if port.kind == "PUBLISH":
            return _ReadyChannel(port, UdpPublisher(address, sends, self._interface), self.addresses)
        if port.kind == "SERVER":
            served = StreamServer(self._reactor, self._served(address), receives, sends, indicate)
            self.addresses[port.name] = served.address
            return _ReadyChannel(port, served, self.addresses)
        subscribed = UdpSubscriber(self._reactor, address, receives, indicate, self._interface)
        self.addresses[port.name] = subscribed.address
        return _ReadyChannel(port, subscribed, self.addresses)

    def _served(self, address: Address) -> StreamAddress:
        """Where the server with the address in its ID listens."""
        return address if isinstance(self._management, Address) else self._management._replace(port=address.port)


def _deliver(port: CommunicationPort, message: Message) -> None:
    """Hands a message over, unless the block has been closed since it came."""
    if port.is_open:
        port.deliver(message)


class _ReadyChannel:
    """A channel that is usable as soon as it is open."""

    is_ready = True
    confirms = False

    def __init__(
        self,
        port: CommunicationPort,
        end: StreamServer | UdpPublisher | UdpSubscriber,
        addresses: dict[str, StreamAddress],
    ) -> None:
        self._port = port
        self._end = end
        self._addresses = addresses

    def send(self, values: tuple[Any, ...]) -> None:
        if not isinstance(self._end, UdpSubscriber):
            self._end.send(values)

    def close(self) -> None:
        self._addresses.pop(self._port.name, None)
        self._end.close()


class _ClientChannel:
    """A client's channel: usable once connected. While its server does not listen it asks again every `RETRY`."""

    is_ready = False
    confirms = False

    def __init__(
        self,
        reactor: Reactor,
        address: Address,
        receives: Signature,
        sends: Signature,
        port: CommunicationPort,
        perform: Perform,
    ) -> None:
        self._port = port
        self._perform = perform
        self._reactor = reactor
        self._refused = False
        self._timer: Timer | None = None
        self._make = partial(
            TcpClient,
            reactor,
            address,
            receives,
            sends,
            opened=self._opened,
            confirm=self._confirm,
            lost=self._lost,
        )
        self._client = self._make()

    def send(self, values: tuple[Any, ...]) -> None:
        self._client.send(values)

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._client.close()

    def _opened(self, problem: str) -> None:
        if not problem:
            self._perform(self._port.confirm_open)
            return
        if not self._refused:
            self._refused = True
            log.warning("%s: %s: tried again every %g s", self._port.name, problem, RETRY)
            self._perform(self._port.refuse_open)
        self._timer = self._reactor.call_at(self._reactor.now() + RETRY, self._again)

    def _again(self) -> None:
        self._client = self._make()

    def _confirm(self, message: Message) -> None:
        self._perform(partial(_deliver, self._port, message))

    def _lost(self) -> None:
        self._perform(self._port.terminate)
