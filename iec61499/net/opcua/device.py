"""OPC UA of a device: one server and one connection to each other server, for the blocks of all its resources."""

from __future__ import annotations

import logging
import warnings
from typing import Final

from iec61499.errors import CommunicationError
from iec61499.net.inlet import Inlet
from iec61499.net.opcua.identifiers import parse_action
from iec61499.net.opcua.own import CHANNELS, OwnChannel
from iec61499.net.opcua.remote import Connection, RemoteChannel
from iec61499.net.opcua.server import NodeServer
from iec61499.net.opcua.thread import LoopThread
from iec61499.net.settings import Connections

ENDPOINTS: Final = 64
"""Most other servers."""


class OpcUa:
    """Opens channels.

    Args:
        settings: where the own server listens, and how to log in to others.
    """

    def __init__(self, settings: Connections) -> None:
        # what peers cause is told in one line where it is noticed; the library would show a traceback for each
        logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)
        # it forgets to tell subscribers of a node that the node has gone
        warnings.filterwarnings("ignore", r"coroutine '[\w.]*datachange_callback' was never awaited", RuntimeWarning)
        self._settings = settings
        self._thread = LoopThread()
        self._server = NodeServer(settings.opcua)
        self._connections: dict[str, Connection] = {}

    @property
    def port(self) -> int:
        """The port where the own server listens; 0 before a block has needed it."""
        return self._server.port

    def open(self, inlet: Inlet, parameters: str) -> OwnChannel | RemoteChannel:
        """Opens the channel of a block.

        Args:
            inlet: the way to the block.
            parameters: what stands in the brackets of `opc_ua[...]`.

        Raises:
            CommunicationError: it has another form, or OPC UA has no values of a type.
        """
        port = inlet.port
        try:
            action = parse_action(parameters, port.kind, len(port.sends), len(port.receives))
            if not action.endpoint:
                return CHANNELS.get(action.name, OwnChannel)(action, inlet, self._server, self._thread)
            return RemoteChannel(action, inlet, self._connection(action.endpoint), self._thread)
        except CommunicationError as error:
            raise CommunicationError(str(error), "TERMINATED") from None  # as 4diac FORTE says then

    def close(self) -> None:
        """Ends the server and all connections."""
        self._thread.close(self._end)

    def _connection(self, endpoint: str) -> Connection:
        if endpoint not in self._connections:
            if len(self._connections) >= ENDPOINTS:
                raise CommunicationError(f"{endpoint}: expected at most {ENDPOINTS} OPC UA servers")
            self._connections[endpoint] = Connection(self._settings.peer_at(endpoint))
        return self._connections[endpoint]

    async def _end(self) -> None:
        for connection in self._connections.values():
            await connection.close()
        await self._server.close()
