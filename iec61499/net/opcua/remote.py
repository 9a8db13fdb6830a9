"""Connections to other OPC UA servers, and the channels of the blocks that name their endpoints.

A connection is tried until the server is there, and again when it has gone; nodes are looked for anew each time, as
the server may have been started anew. All of it runs in the loop of the thread.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from typing import Any, Final

from asyncua import Client, Node, ua
from asyncua.crypto.security_policies import SecurityPolicyBasic256Sha256
from asyncua.crypto.uacrypto import load_certificate

from iec61499.errors import CommunicationError
from iec61499.net.inlet import Inlet
from iec61499.net.opcua.identifiers import Action, Place
from iec61499.net.opcua.own import ERRORS, UNDER_WAY, Together
from iec61499.net.opcua.security import application_uri
from iec61499.net.opcua.server import identifier
from iec61499.net.opcua.structures import AnyConverter, any_converters, bind_remote
from iec61499.net.opcua.thread import LoopThread
from iec61499.net.settings import Peer

log = logging.getLogger(__name__)

RETRY: Final = 1.0
"""Time after which a server, or a node that it does not have yet, is asked for again, s."""
TIMEOUT: Final = 5.0
"""Longest time that an answer is waited for, s, as in 4diac FORTE."""
WATCH: Final = 1.0
"""Time between two looks whether the server is still there, s."""
PUBLISHING: Final = 100.0
"""Time between two messages of a subscription, ms, as in 4diac FORTE."""


class Connection:
    """A connection to one server, shared by the blocks that name it.

    Args:
        peer: the server, and how to log in there.
    """

    def __init__(self, peer: Peer) -> None:
        self._peer = peer
        self._channels: list[RemoteChannel] = []
        self._changed = asyncio.Event()
        self._task: asyncio.Task[None] | None = None

    async def add(self, channel: RemoteChannel) -> None:
        """Serves one block more."""
        self._channels.append(channel)
        self._changed.set()
        if self._task is None:
            self._task = asyncio.create_task(self._keep())

    async def remove(self, channel: RemoteChannel) -> None:
        """Serves a block no longer; without any the connection ends."""
        if channel in self._channels:
            self._channels.remove(channel)
            await channel.leave()
        if not self._channels:
            await self.close()

    async def close(self) -> None:
        """Ends the connection."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.wait([task])

    async def _keep(self) -> None:
        """Connects, serves the blocks until the connection is lost, and begins again."""
        told = ""
        while True:
            client = Client(self._peer.endpoint, timeout=TIMEOUT, watchdog_intervall=WATCH)
            lost = asyncio.Event()
            try:
                await self._connect(client, lost)
                log.info("%s: connected", self._peer.endpoint)
                told = ""
                await self._serve(client, lost)
                log.warning("%s: connection lost: tried again every %g s", self._peer.endpoint, RETRY)
            except ERRORS as error:
                reason = f"cannot connect: {error or type(error).__name__}"
                if reason != told:
                    told = reason
                    log.warning("%s: %s: tried again every %g s", self._peer.endpoint, reason, RETRY)
            finally:
                for channel in self._channels:
                    channel.lost()
                with contextlib.suppress(*ERRORS):
                    await asyncio.wait_for(client.disconnect(), WATCH)
            await asyncio.sleep(RETRY)

    async def _connect(self, client: Client, lost: asyncio.Event) -> None:
        peer = self._peer

        async def note(error: Exception) -> None:
            lost.set()

        client.connection_lost_callback = note
        if peer.username:
            client.set_user(peer.username)
            client.set_password(peer.password)
        if peer.certificate:
            client.application_uri = application_uri(await load_certificate(peer.certificate))
            await client.set_security(
                SecurityPolicyBasic256Sha256,
                certificate=peer.certificate,
                private_key=peer.key,
                server_certificate=peer.server_certificate,
                mode=ua.MessageSecurityMode[peer.mode],
            )
        await client.connect()

    async def _serve(self, client: Client, lost: asyncio.Event) -> None:
        """Prepares the channels, those that cannot be prepared yet again and again, until the connection is lost."""
        while not lost.is_set():
            self._changed.clear()
            for channel in [channel for channel in self._channels if not channel.is_prepared]:
                await channel.prepare(client)
            waits = any(not channel.is_prepared for channel in self._channels)
            signals = [asyncio.create_task(event.wait()) for event in (lost, self._changed)]
            try:
                await asyncio.wait(signals, timeout=RETRY if waits else None, return_when=asyncio.FIRST_COMPLETED)
            finally:
                for signal in signals:
                    signal.cancel()


class RemoteChannel:
    """A block's channel to another server: READ, WRITE and CALL_METHOD of a CLIENT, SUBSCRIBE of a SUBSCRIBE.

    The block is confirmed at once, as in 4diac FORTE; until the server is there and has the nodes its requests are
    refused as DATA_TYPE_ERROR, as FORTE says then.
    """

    def __init__(self, action: Action, inlet: Inlet, connection: Connection, thread: LoopThread) -> None:
        self.is_prepared = False
        self._action = action
        self._inlet = inlet
        self._connection = connection
        self._thread = thread
        self._client: Client | None = None
        self._nodes: list[Node] = []
        self._parent: Node | None = None
        self._told = ""
        self._under_way = 0
        self._sends = any_converters(inlet.port.sends)
        self._receives = any_converters(inlet.port.receives)
        self._subscription = Subscription(inlet, self._receives)
        inlet.put(inlet.port.confirm_open)
        thread.submit(connection.add(self))

    def send(self, values: tuple[Any, ...]) -> None:
        """Reads, writes or calls.

        Raises:
            CommunicationError: the server is not there, a value has no form in OPC UA, or too much is under way.
        """
        if not self.is_prepared:
            raise CommunicationError(f"{self._action.endpoint} is not connected", "DATA_TYPE_ERROR")
        if self._under_way >= UNDER_WAY:
            raise CommunicationError(f"{UNDER_WAY} requests are under way already")
        variants = [each.encode(value) for each, value in zip(self._sends, values, strict=True)]
        self._under_way += 1
        self._thread.submit(self._exchange(variants))

    def close(self) -> None:
        """Leaves the connection."""
        self._thread.submit(self._connection.remove(self))

    async def prepare(self, client: Client) -> None:
        """Looks for the nodes, and subscribes; what is not there yet is a line in the log, once."""
        try:
            self._nodes = [await _node(client, place) for place in self._action.places]
            if self._action.name == "CALL_METHOD":
                self._parent = await _parent(client, self._action.places[0])
            await self._bind(client)
            self._client = client
            if self._action.name == "SUBSCRIBE":
                await self._subscription.begin(client, self._nodes)
        except ERRORS as error:
            if str(error) != self._told:
                self._told = str(error)
                log.warning("%s: %s: tried again every %g s", self._inlet.port.name, error, RETRY)
        else:
            self._told = ""
            self.is_prepared = True

    async def _bind(self, client: Client) -> None:
        """Asks the server how it encodes structures. Raises what is in ERRORS."""
        given = [each for each in (*self._sends, *self._receives) if each.variant == ua.VariantType.ExtensionObject]
        if not given:
            return
        if self._action.name != "CALL_METHOD":
            for each, node in zip((*self._sends, *self._receives), self._nodes, strict=True):
                await bind_remote(client, each, await node.read_data_type())
            return
        for name, converters in (("InputArguments", self._sends), ("OutputArguments", self._receives)):
            arguments = await (await self._nodes[0].get_child(f"0:{name}")).read_value() if converters else []
            if len(arguments) != len(converters):
                raise CommunicationError(f"the method has {len(arguments)} {name}, expected {len(converters)}")
            for each, argument in zip(converters, arguments, strict=True):
                await bind_remote(client, each, argument.DataType)

    def lost(self) -> None:
        """The connection has gone."""
        self.is_prepared = False
        self._client = self._parent = None
        self._subscription.lost()

    async def leave(self) -> None:
        """Ends a subscription."""
        self.is_prepared = False
        await self._subscription.end()

    async def _exchange(self, variants: Sequence[ua.Variant]) -> None:
        try:
            results = await self._asked(variants)
            values = tuple(each.decode(one) for each, one in zip(self._receives, results, strict=True))
        except ERRORS as error:
            self._inlet.refuse("RECV_FAILED", f"{self._action.endpoint}: {error or type(error).__name__}")
        else:
            self._inlet.deliver(values)
        finally:
            self._under_way -= 1

    async def _asked(self, variants: Sequence[ua.Variant]) -> Sequence[ua.Variant | None]:
        """What the server answers to a request. Raises what is in ERRORS."""
        client = self._client
        if client is None:
            raise CommunicationError("connection lost")
        if self._action.name == "READ":
            found = await client.read_attributes(self._nodes)
            for value in found:
                value.StatusCode.check()
            return [value.Value for value in found]
        if self._action.name == "WRITE":
            for status in await client.uaclient.write_attributes(
                [node.nodeid for node in self._nodes], [ua.DataValue(variant) for variant in variants]
            ):
                status.check()
            return ()
        assert self._parent is not None
        request = ua.CallMethodRequest(
            ObjectId=self._parent.nodeid, MethodId=self._nodes[0].nodeid, InputArguments=list(variants)
        )
        (answer,) = await client.uaclient.call([request])
        answer.StatusCode.check()
        results = answer.OutputArguments or []
        if len(results) != len(self._receives):
            raise CommunicationError(f"the method gives {len(results)} values, expected {len(self._receives)}")
        return list(results)


class Subscription:
    """Variables of another server whose changes are told to a block.

    Args:
        inlet: where values of all variables together go.
        receives: converters of their values.
    """

    def __init__(self, inlet: Inlet, receives: Sequence[AnyConverter]) -> None:
        self._inlet = inlet
        self._receives = receives
        self._together = Together(inlet)
        self._values = [kind.default for kind in inlet.port.receives]
        self._nodes: list[Node] = []
        self._made: Any = None

    async def begin(self, client: Client, nodes: list[Node]) -> None:
        """Subscribes to nodes, one for each value. Raises what is in ERRORS."""
        self._nodes = nodes
        self._made = await client.create_subscription(PUBLISHING, self)
        await self._made.subscribe_data_change(list(dict.fromkeys(nodes)), queuesize=1)

    def lost(self) -> None:
        """The connection has gone, and the subscription with it."""
        self._made = None

    async def end(self) -> None:
        """Ends the subscription, if there is one."""
        if self._made is not None:
            with contextlib.suppress(*ERRORS):
                await asyncio.wait_for(self._made.delete(), WATCH)

    def datachange_notification(self, node: Node, value: Any, data: Any) -> None:
        """A variable has got a value; called by the library."""
        status = data.monitored_item.Value.StatusCode
        places = [number for number, each in enumerate(self._nodes) if each == node]
        try:
            if status is not None and not status.is_good():
                raise CommunicationError(f"{node}: {status.name}")
            for number in places:
                self._values[number] = self._receives[number].decode(data.monitored_item.Value.Value)
        except CommunicationError as error:
            self._inlet.refuse("RECV_FAILED", str(error))
        else:
            self._together.deliver(self._values)


async def _node(client: Client, place: Place) -> Node:
    """The node at a place. Raises CommunicationError when it is not there, or another one."""
    if not place.path:
        assert place.node is not None
        return client.get_node(identifier(place.node))
    try:
        found = await client.nodes.root.get_child([ua.QualifiedName(name, number) for number, name in place.path])
    except ua.UaStatusCodeError as error:
        raise CommunicationError(f"{place}: no such node: {error}") from None
    if place.node is not None and found.nodeid != identifier(place.node):
        raise CommunicationError(f"{place} is the node {found.nodeid.to_string()}, not the one that the ID names")
    return found


async def _parent(client: Client, place: Place) -> Node:
    """The node above a method, which is called with it."""
    above = [ua.QualifiedName(name, number) for number, name in place.path[:-1]]
    return await client.nodes.root.get_child(above) if above else client.nodes.root
