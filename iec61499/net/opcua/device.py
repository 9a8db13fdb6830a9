"""OPC UA of a device, without the library: what blocks ask for waits until the thread has imported it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from iec61499.errors import CommunicationError
from iec61499.net.inlet import Inlet
from iec61499.net.opcua.identifiers import Action, parse_action
from iec61499.net.opcua.thread import LoopThread
from iec61499.net.settings import Connections

if TYPE_CHECKING:
    from iec61499.net.opcua.backend import Backend
    from iec61499.net.opcua.own import OwnChannel
    from iec61499.net.opcua.remote import RemoteChannel


class OpcUa:
    """Opens channels.

    Args:
        settings: where the own server listens, and how to log in to others.
    """

    def __init__(self, settings: Connections) -> None:
        self._settings = settings
        self._thread = LoopThread()
        self._backend: Backend | None = None

    @property
    def port(self) -> int:
        """The port where the own server listens; 0 before a block has needed it."""
        return self._backend.port if self._backend is not None else 0

    def open(self, inlet: Inlet, parameters: str) -> LateChannel:
        """Opens the channel of a block.

        Args:
            inlet: the way to the block.
            parameters: what stands in the brackets of `opc_ua[...]`.

        Raises:
            CommunicationError: it has another form.
        """
        port = inlet.port
        try:
            action = parse_action(parameters, port.kind, len(port.sends), len(port.receives))
        except CommunicationError as error:
            raise CommunicationError(str(error), "TERMINATED") from None  # as 4diac FORTE says then
        channel = LateChannel(action, inlet, self._thread)
        self._thread.submit(self._open_channel(channel))
        return channel

    def close(self) -> None:
        """Ends the server and all connections."""
        self._thread.close(self._end)

    async def _open_channel(self, channel: LateChannel) -> None:
        from iec61499.net.opcua.backend import Backend

        if self._backend is None:
            self._backend = Backend(self._settings, self._thread)
        channel.open(self._backend)

    async def _end(self) -> None:
        if self._backend is not None:
            await self._backend.end()


class LateChannel:
    """A channel that is made in the thread; requests before that are refused."""

    is_ready = False

    def __init__(self, action: Action, inlet: Inlet, thread: LoopThread) -> None:
        self.confirms = action.name != "CREATE_METHOD"
        self._action = action
        self._inlet = inlet
        self._thread = thread
        self._made: OwnChannel | RemoteChannel | None = None

    def open(self, backend: Backend) -> None:
        """Makes the channel; called in the thread."""
        if self._inlet.closed:
            return
        try:
            self._made = backend.channel(self._action, self._inlet)
        except CommunicationError as error:
            self._inlet.refuse_open("TERMINATED", str(error))

    def send(self, values: tuple[Any, ...]) -> None:
        """Sends the values. Raises CommunicationError when that is impossible, or too early."""
        if self._made is None:
            raise CommunicationError("OPC UA is not there yet", "DATA_TYPE_ERROR")
        self._made.send(values)

    def close(self) -> None:
        self._inlet.close()
        self._thread.call(self._close)

    def _close(self) -> None:
        if self._made is not None:
            self._made.close()
