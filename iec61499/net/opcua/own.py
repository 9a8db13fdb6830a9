"""Channels of blocks whose IDs name no endpoint: variables and methods of the device's own server."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

from asyncua import ua

from iec61499.errors import CommunicationError
from iec61499.net.inlet import Inlet
from iec61499.net.opcua.identifiers import Action
from iec61499.net.opcua.server import NodeServer
from iec61499.net.opcua.structures import AnyConverter, any_converters
from iec61499.net.opcua.thread import LoopThread

ANSWER: Final = 4.0
"""Longest time that the caller of a method waits for the block's answer, s, as with 4diac FORTE."""
UNDER_WAY: Final = 100
"""Most requests of one block that are not done yet."""
ERRORS: Final = (CommunicationError, ua.UaError, OSError, ValueError, TypeError)
"""What the library raises for what peers or files say."""


class OwnChannel:
    """A block's channel to the own server. What it asks for is done in the thread; it says so when it is done.

    Args:
        action: what the block does.
        inlet: the way back to the block.
        server: the server.
        thread: where it runs.
    """

    def __init__(self, action: Action, inlet: Inlet, server: NodeServer, thread: LoopThread) -> None:
        self._action = action
        self._inlet = inlet
        self._server = server
        self._thread = thread
        self._nodes: list[ua.NodeId] = []
        self._used: list[ua.NodeId] = []
        self._under_way = 0
        self._sends = any_converters(inlet.port.sends)
        self._receives = any_converters(inlet.port.receives)
        thread.submit(self._open())

    def send(self, values: tuple[Any, ...]) -> None:
        """Has the values written, or the node made or deleted.

        Raises:
            CommunicationError: a value has no form in OPC UA, or too much is under way.
        """
        if self._under_way >= UNDER_WAY:
            raise CommunicationError(f"{UNDER_WAY} requests are under way already")
        variants = [each.encode(value) for each, value in zip(self._sends, values, strict=True)]
        self._under_way += 1
        self._thread.submit(self._execute(variants))

    def close(self) -> None:
        """Lets go of the nodes."""
        self._thread.submit(self._close())

    async def _open(self) -> None:
        try:
            for each in (*self._sends, *self._receives):
                await self._server.know(each)
            await self._prepare()
        except ERRORS as error:
            self._inlet.refuse_open("TERMINATED", str(error))
        else:
            self._inlet.put(self._inlet.port.confirm_open)

    async def _prepare(self) -> None:
        """Makes the variables that the block writes."""
        if self._action.name != "WRITE":
            return
        for place, each, kind in zip(self._action.places, self._sends, self._inlet.port.sends, strict=True):
            node, used = await self._server.variable(place, each, each.encode(kind.default), None)
            self._nodes.append(node)
            self._used += used

    async def _execute(self, variants: Sequence[ua.Variant]) -> None:
        places = self._action.places
        try:
            match self._action.name:
                case "WRITE":
                    await self._server.write(list(zip(self._nodes, variants, strict=True)))
                case "CREATE_OBJECT":
                    self._used += await self._server.create(places[0], places[1])
                case "CREATE_VARIABLE":
                    self._used += await self._server.create(places[0], places[2], places[1])
                case _:
                    await self._server.delete(places[0])
        except ERRORS as error:
            self._inlet.refuse("DATA_TYPE_ERROR", str(error))
        else:
            self._inlet.confirm()
        finally:
            self._under_way -= 1

    async def _close(self) -> None:
        await self._server.release(self._used)
        self._used = []


class ReadChannel(OwnChannel):
    """A SUBSCRIBE's: variables that peers write."""

    def __init__(self, action: Action, inlet: Inlet, server: NodeServer, thread: LoopThread) -> None:
        self._values = [kind.default for kind in inlet.port.receives]
        self._written: list[tuple[ua.NodeId, Any]] = []
        self._together = Together(inlet)
        super().__init__(action, inlet, server, thread)

    async def _prepare(self) -> None:
        for number, (place, each) in enumerate(zip(self._action.places, self._receives, strict=True)):
            written = partial(self._on_value, number, each)
            value = each.encode(self._values[number])
            node, used = await self._server.variable(place, each, value, written)
            self._written.append((node, written))
            self._used += used

    def _on_value(self, number: int, each: AnyConverter, variant: ua.Variant | None) -> None:
        try:
            self._values[number] = each.decode(variant)
        except CommunicationError as error:
            self._inlet.refuse("RECV_FAILED", str(error))
        else:
            self._together.deliver(self._values)

    async def _close(self) -> None:
        for node, written in self._written:
            self._server.forget(node, written)
        await super()._close()


class MethodChannel(OwnChannel):
    """A SERVER's: a method. One call at a time; the others wait."""

    def __init__(self, action: Action, inlet: Inlet, server: NodeServer, thread: LoopThread) -> None:
        self._turn = asyncio.Lock()
        self._answer: asyncio.Future[list[ua.Variant]] | None = None
        super().__init__(action, inlet, server, thread)

    def send(self, values: tuple[Any, ...]) -> None:
        """Answers the call. Raises CommunicationError when there is none, or a value has no form in OPC UA."""
        answer = self._answer
        if answer is None:
            raise CommunicationError(f"{self._action.places[0]} is not being called", "DATA_TYPE_ERROR")
        variants = [each.encode(value) for each, value in zip(self._sends, values, strict=True)]
        self._thread.call(partial(_answered, answer, variants))

    async def _prepare(self) -> None:
        names = ("RD_", self._receives), ("SD_", self._sends)
        inputs, outputs = (
            [_argument(f"{prefix}{number}", each) for number, each in enumerate(found, 1)] for prefix, found in names
        )
        _, self._used = await self._server.method(self._action.places[0], self._called, inputs, outputs)

    async def _called(self, parent: ua.NodeId, *arguments: ua.Variant) -> Any:
        async with self._turn:
            if len(arguments) != len(self._receives):
                return ua.StatusCode(ua.StatusCodes.BadArgumentsMissing)
            try:
                values = tuple(each.decode(one) for each, one in zip(self._receives, arguments, strict=True))
            except CommunicationError as error:
                self._inlet.refuse("RECV_FAILED", str(error))
                return ua.StatusCode(ua.StatusCodes.BadInvalidArgument)
            self._answer = asyncio.get_running_loop().create_future()
            try:
                self._inlet.deliver(values)
                return await asyncio.wait_for(self._answer, ANSWER)
            except TimeoutError:
                return ua.StatusCode(ua.StatusCodes.BadTimeout)
            finally:
                self._answer = None


class Together:
    """Delivers values that come one after the other in one turn of the loop at once, as they belong together."""

    def __init__(self, inlet: Inlet) -> None:
        self._inlet = inlet
        self._asked = False

    def deliver(self, values: list[Any]) -> None:
        """Delivers what the list holds at the end of the turn."""
        if not self._asked:
            self._asked = True
            asyncio.get_running_loop().call_soon(self._now, values)

    def _now(self, values: list[Any]) -> None:
        self._asked = False
        self._inlet.deliver_latest(tuple(values))


def _answered(answer: asyncio.Future[list[ua.Variant]], variants: list[ua.Variant]) -> None:
    if not answer.done():
        answer.set_result(variants)


def _argument(name: str, each: AnyConverter) -> ua.Argument:
    return ua.Argument(Name=name, DataType=each.data_type, ValueRank=each.rank)


CHANNELS: Final = {"READ": ReadChannel, "CREATE_METHOD": MethodChannel}
"""The channels of actions that peers begin; the others have an OwnChannel."""
