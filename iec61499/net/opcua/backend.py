"""OPC UA of a device with the library: one server and one connection to each other server, for all its blocks.

All of it runs in the loop of the thread; the module takes a second to be imported there.
"""

from __future__ import annotations

import logging
import warnings
from typing import Final

from iec61499.errors import CommunicationError
from iec61499.net.inlet import Inlet
from iec61499.net.opcua.identifiers import Action
from iec61499.net.opcua.own import CHANNELS, OwnChannel
from iec61499.net.opcua.remote import Connection, RemoteChannel
from iec61499.net.opcua.server import NodeServer
from iec61499.net.opcua.thread import LoopThread
from iec61499.net.settings import Connections

ENDPOINTS: Final = 64
"""Most other servers."""


class Backend:
    """Makes channels.

    Args:
        settings: where the own server listens, and how to log in to others.
        thread: where all of it runs.
    """

    def __init__(self, settings: Connections, thread: LoopThread) -> None:
        # what peers cause is told in one line where it is noticed; the library would show a traceback for each
        logging.getLogger("asyncua").setLevel(logging.CRITICAL + 1)
        # it forgets to tell subscribers of a node that the node has gone
        warnings.filterwarnings("ignore", r"coroutine '[\w.]*datachange_callback' was never awaited", RuntimeWarning)
        self._settings = settings
        self._thread = thread
        self._server = NodeServer(settings.opcua)
        self._connections: dict[str, Connection] = {}

    @property
    def port(self) -> int:
        """The port where the own server listens; 0 before a block has needed it."""
        return self._server.port

    def channel(self, action: Action, inlet: Inlet) -> OwnChannel | RemoteChannel:
        """The channel of a block. Raises CommunicationError when OPC UA has no values of a type."""
        if not action.endpoint:
            return CHANNELS.get(action.name, OwnChannel)(action, inlet, self._server, self._thread)
        return RemoteChannel(action, inlet, self._connection(action.endpoint), self._thread)

    def _connection(self, endpoint: str) -> Connection:
        if endpoint not in self._connections:
            if len(self._connections) >= ENDPOINTS:
                raise CommunicationError(f"{endpoint}: expected at most {ENDPOINTS} OPC UA servers")
            self._connections[endpoint] = Connection(self._settings.peer_at(endpoint))
        return self._connections[endpoint]

    async def end(self) -> None:
        """Ends the server and all connections."""
        for connection in self._connections.values():
            await connection.close()
        await self._server.close()
