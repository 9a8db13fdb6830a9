"""The in-process transport: communication blocks of one ID reach each other without sockets."""

from __future__ import annotations

from typing import Any

from dtwin.errors import CommunicationError
from dtwin.iec61499.runtime.communication import CommunicationPort

_LISTENERS = {"CLIENT": "SERVER", "SERVER": "CLIENT", "PUBLISH": "SUBSCRIBE", "SUBSCRIBE": ""}


class LocalTransport:
    """Connects the ports opened with one ID: a client with its server, a publisher with every subscriber.

    Several resources may share one; what is delivered waits in the receiver's queue until its resource runs.
    """

    def __init__(self) -> None:
        self._ports: dict[tuple[str, str], list[CommunicationPort]] = {}

    def open(self, port: CommunicationPort) -> LocalChannel:
        """Opens a channel; as `Transport.open`.

        Raises:
            CommunicationError: a server of that ID exists already.
        """
        ports = self._ports.setdefault((port.kind, port.id), [])
        if port.kind == "SERVER" and ports:
            raise CommunicationError(f"{port.name}: {port.id} is served by {ports[0].name}")
        ports.append(port)
        return LocalChannel(self, port)

    def peers(self, port: CommunicationPort) -> tuple[CommunicationPort, ...]:
        """The open ports that get what `port` sends."""
        return tuple(peer for peer in self._ports.get((_LISTENERS[port.kind], port.id), ()) if peer.is_open)

    def forget(self, port: CommunicationPort) -> None:
        """Removes a port: its peers reach it no longer."""
        self._ports[port.kind, port.id].remove(port)


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
        for peer in peers:
            peer.deliver(values)

    def close(self) -> None:
        self._transport.forget(self._port)
