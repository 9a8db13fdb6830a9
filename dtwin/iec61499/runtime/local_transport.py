"""The in-process transport: communication blocks of one ID reach each other without sockets."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from dtwin.errors import CommunicationError
from dtwin.iec61499.runtime.communication import CommunicationPort, Values

Deliver = Callable[[Values], None]
"""Takes the values that a peer has sent."""
_LISTENERS = {"CLIENT": "SERVER", "SERVER": "CLIENT", "PUBLISH": "SUBSCRIBE", "SUBSCRIBE": ""}


class LocalTransport:
    """Connects the ports opened with one ID: a client with its server, a publisher with every subscriber.

    Several resources may share one; what is delivered waits in the receiver's queue until its resource runs.
    """

    def __init__(self) -> None:
        self._ports: dict[tuple[str, str], dict[CommunicationPort, Deliver]] = {}

    def open(self, port: CommunicationPort, deliver: Deliver | None = None) -> LocalChannel:
        """Opens a channel; as `Transport.open`.

        Args:
            port: the port that opens it.
            deliver: takes what its peers send; without it `port.deliver` does, at once.

        Raises:
            CommunicationError: a server of that ID exists already.
        """
        ports = self._ports.setdefault((port.kind, port.id), {})
        if port.kind == "SERVER" and ports:
            raise CommunicationError(f"{port.name}: {port.id} is served by {next(iter(ports)).name}")
        ports[port] = deliver or port.deliver
        return LocalChannel(self, port)

    def peers(self, port: CommunicationPort) -> tuple[Deliver, ...]:
        """What takes the values for every open port that gets what `port` sends."""
        ports = self._ports.get((_LISTENERS[port.kind], port.id), {})
        return tuple(deliver for peer, deliver in ports.items() if peer.is_open)

    def forget(self, port: CommunicationPort) -> None:
        """Removes a port: its peers reach it no longer."""
        del self._ports[port.kind, port.id][port]


class LocalChannel:
    """One port's channel to its peers in process."""

    is_ready = True

    def __init__(self, transport: LocalTransport, port: CommunicationPort) -> None:
        self._transport = transport
        self._port = port

    def send(self, values: tuple[Any, ...]) -> None:
        """Delivers to the peers.

        Raises:
            CommunicationError: a client has no server, or the peers' number of values differs.
        """
        peers = self._transport.peers(self._port)
        if not peers and self._port.kind == "CLIENT":
            raise CommunicationError(f"{self._port.name}: nothing serves {self._port.id}")
        for deliver in peers:
            deliver(values)

    def close(self) -> None:
        self._transport.forget(self._port)
