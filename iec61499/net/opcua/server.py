"""The device's own OPC UA server: nodes that its blocks make, read, write and answer for.

All of it runs in the loop of `thread`. A node that a block has made, with the folders above it, is there as long as
a block uses it.
"""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any, Final

from asyncua import Node, Server, ua
from asyncua.common.callback import CallbackType
from asyncua.common.connection import TransportLimits
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.crypto.truststore import TrustStore
from asyncua.crypto.validator import CertificateValidator, CertificateValidatorOptions
from asyncua.server.user_managers import UserManager

from iec61499.errors import CommunicationError
from iec61499.net.address import Address
from iec61499.net.opcua.identifiers import NodeName, Place
from iec61499.net.opcua.security import application_uri
from iec61499.net.opcua.structures import AnyConverter, Known, bind_own
from iec61499.net.settings import OwnServer

log = logging.getLogger(__name__)

APPLICATION: Final = "urn:iec61499:device"
PEERS: Final = 64
"""Most clients at a time."""
MESSAGE: Final = 4 << 20
"""Most bytes of a message."""
BUFFER: Final = 65_535
"""Most bytes of a part of a message."""

Written = Callable[[ua.Variant | None], None]
"""Called with the value that a node has got."""
Called = Callable[..., Awaitable[Any]]
"""A method: called with its parent and the arguments."""


class _Everybody(UserManager):
    """Whoever may connect may read and call everything, and write what a block reads."""

    def get_user(self, *args: Any, **rest: Any) -> User:
        return User(role=UserRole.User)


class NodeServer:
    """The server, which listens from the first node on.

    Args:
        settings: where it listens, and for whom.
    """

    def __init__(self, settings: OwnServer) -> None:
        self._settings = settings
        self._server: Server | None = None
        self._lock = asyncio.Lock()
        self._readers: dict[ua.NodeId, Written] = {}
        self._users: dict[ua.NodeId, int] = {}
        self._methods: set[ua.NodeId] = set()
        self._structures: Known = {}

    async def know(self, converter: AnyConverter) -> None:
        """Makes the data type of a structure, unless it is there; others need nothing. Raises CommunicationError."""
        if converter.data_type.is_null():
            async with self._lock:
                await bind_own(await self._listening(), converter, self._structures)

    async def variable(
        self, place: Place, converter: AnyConverter, value: ua.Variant, written: Written | None
    ) -> tuple[ua.NodeId, list[ua.NodeId]]:
        """A variable of a block, made unless it is there.

        Args:
            place: where it is.
            converter: the type of its values.
            value: what it has at first.
            written: takes what it gets; peers may then write it.

        Returns:
            The node, and all that `release` shall get.

        Raises:
            CommunicationError: the server cannot listen, the place is taken, or another block reads it.
        """
        async with self._lock:
            server = await self._listening()
            node, used = await self._found(server, place)
            if node is None:

                def make(parent: Node, *names: Any) -> Awaitable[Node]:
                    made: Awaitable[Node] = parent.add_variable(*names, value, datatype=converter.data_type)
                    return made

                node, used = await self._made(server, place, make)
            elif await node.read_data_type() != converter.data_type:
                raise CommunicationError(f"{place} has values of another type than {converter.variant.name}")
            if written is not None:
                if node.nodeid in self._readers:
                    raise CommunicationError(f"{place} is read by another block")
                await node.set_writable(True)
                self._readers[node.nodeid] = written
            return node.nodeid, self._use(used)

    async def write(self, values: Sequence[tuple[ua.NodeId, ua.Variant]]) -> None:
        """Gives variables values, all at once. Raises CommunicationError, and what the library raises."""
        async with self._lock:
            server = await self._listening()
            asked = ua.WriteParameters()
            for node, variant in values:
                value = ua.DataValue(variant)
                asked.NodesToWrite.append(ua.WriteValue(node, ua.AttributeIds.Value, Value=value))
            for status in await server.iserver.isession.write(asked):
                status.check()

    async def method(
        self, place: Place, called: Called, inputs: Sequence[ua.Argument], outputs: Sequence[ua.Argument]
    ) -> tuple[ua.NodeId, list[ua.NodeId]]:
        """A method that a block answers; as `variable`."""
        async with self._lock:
            server = await self._listening()
            node, used = await self._found(server, place)
            if node is None:

                def make(parent: Node, *names: Any) -> Awaitable[Node]:
                    made: Awaitable[Node] = parent.add_method(*names, called, list(inputs), list(outputs))
                    return made

                node, used = await self._made(server, place, make)
            else:
                if node.nodeid in self._methods:
                    raise CommunicationError(f"{place} is answered by another block")
                if await node.read_node_class() != ua.NodeClass.Method:
                    raise CommunicationError(f"{place} is no method")
                server.link_method(node, called)
            self._methods.add(node.nodeid)
            return node.nodeid, self._use(used)

    async def create(self, kind: Place, place: Place, data_type: Place | None = None) -> list[ua.NodeId]:
        """Makes an object of a type, or a variable with a data type; returns what `release` shall get.

        Raises:
            CommunicationError: there is no such type, or the place is taken.
        """
        async with self._lock:
            server = await self._listening()
            wanted, _ = await self._found(server, kind)
            if wanted is None:
                raise CommunicationError(f"{kind}: no such type")
            if (await self._found(server, place))[0] is not None:
                raise CommunicationError(f"{place} is there already")

            async def make(parent: Node, *names: Any) -> Node:
                if data_type is None:
                    return await parent.add_object(*names, objecttype=wanted.nodeid)
                values, _ = await self._found(server, data_type)
                if values is None or values.nodeid.NamespaceIndex or wanted.nodeid not in _VARIABLES:
                    raise CommunicationError(f"{kind} of {data_type}: expected 0:i=63 or 0:i=68 of a type of OPC UA")
                variant = ua.VariantType(values.nodeid.Identifier)
                first = ua.Variant(ua.get_default_value(variant), variant)
                add = parent.add_variable if wanted.nodeid == _VARIABLES[0] else parent.add_property
                node = await add(*names, first, datatype=values.nodeid)
                await node.set_writable(True)
                return node

            return self._use((await self._made(server, place, make))[1])

    async def delete(self, place: Place) -> None:
        """Removes a node with all below it. Raises CommunicationError when there is none."""
        async with self._lock:
            server = await self._listening()
            node, _ = await self._found(server, place)
            if node is None:
                raise CommunicationError(f"{place}: no such node")
            await server.delete_nodes([node], recursive=True)

    async def release(self, used: Sequence[ua.NodeId]) -> None:
        """Lets go of nodes, which go when no other block uses them."""
        async with self._lock:
            if self._server is not None:
                await self._let_go(self._server, used)

    async def _let_go(self, server: Server, used: Sequence[ua.NodeId]) -> None:
        for node in reversed(used):
            self._users[node] = self._users.get(node, 1) - 1
            if self._users[node] <= 0:
                del self._users[node]
                self._methods.discard(node)
                if node.NamespaceIndex:
                    await server.delete_nodes([server.get_node(node)], recursive=True)

    def forget(self, node: ua.NodeId, written: Written) -> None:
        """Tells a block no longer what a variable gets."""
        if self._readers.get(node) is written:
            del self._readers[node]

    async def close(self) -> None:
        """Ends the server."""
        if self._server is not None:
            await self._server.stop()
            self._server = None

    @property
    def port(self) -> int:
        """The port where it listens; 0 before."""
        return self._server.bserver.port if self._server is not None else 0

    def _use(self, nodes: list[ua.NodeId]) -> list[ua.NodeId]:
        for node in nodes:
            self._users[node] = self._users.get(node, 0) + 1
        return nodes

    async def _listening(self) -> Server:
        if self._server is not None:
            return self._server
        address = self._settings.address
        _look_whether_free(address)
        server = Server(user_manager=_Everybody())
        await server.init()
        server.set_endpoint(f"opc.tcp://{address.host}:{address.port}")
        server.set_server_name("iec61499")
        server.limits = TransportLimits(BUFFER, BUFFER, MESSAGE // BUFFER + 1, MESSAGE)
        server.iserver.max_connections = PEERS
        server.iserver.allow_remote_admin = False
        await self._secure(server)
        server.subscribe_server_callback(CallbackType.PostWrite, self._noted)
        try:
            await server.start()
        except OSError as error:
            raise CommunicationError(f"{_CLOSED.format(address)}: {error.strerror or error}") from None
        self._server = server
        return server

    async def _secure(self, server: Server) -> None:
        settings = self._settings
        if not settings.certificate:
            await server.set_application_uri(APPLICATION)
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
            return
        await server.load_certificate(settings.certificate)
        await server.load_private_key(settings.key)
        await server.set_application_uri(application_uri(server.iserver.certificate) or APPLICATION)
        server.set_security_policy(
            [ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt, ua.SecurityPolicyType.Basic256Sha256_Sign]
        )
        if settings.trusted:
            store = TrustStore([Path(folder) for folder in settings.trusted], [])
            await store.load()
            wanted = CertificateValidatorOptions.TRUSTED_VALIDATION | CertificateValidatorOptions.PEER_CLIENT
            server.set_certificate_validator(CertificateValidator(wanted, store).validate)

    def _noted(self, event: Any, dispatcher: Any) -> None:
        """Tells blocks what their variables have got."""
        for write, status in zip(event.request_params.NodesToWrite, event.response_params, strict=False):
            reader = self._readers.get(write.NodeId)
            if reader is not None and write.AttributeId == ua.AttributeIds.Value and status.is_good():
                reader(write.Value.Value)

    async def _found(self, server: Server, place: Place) -> tuple[Node | None, list[ua.NodeId]]:
        """A node that is there, and the nodes on the way to it from the root."""
        if not place.path:
            return await _node_of(server, _identifier(place)), []
        way: list[ua.NodeId] = []
        node = server.nodes.root
        for namespace, name in place.path:
            try:
                node = await node.get_child([ua.QualifiedName(name, namespace)])
            except ua.UaError:
                return None, []
            way.append(node.nodeid)
        if place.node is not None and node.nodeid != _identifier(place):
            # nodes of one name with identifiers of their own may stand side by side, as in 4diac FORTE
            beside = await _node_of(server, _identifier(place))
            return beside, [*way[:-1], beside.nodeid] if beside is not None else []
        return node, way

    async def _made(
        self, server: Server, place: Place, make: Callable[..., Awaitable[Node]]
    ) -> tuple[Node, list[ua.NodeId]]:
        """Makes a node, with the folders above it unless they are there; returns it and the nodes on the way to it.

        Args:
            server: the server.
            place: where the node shall be.
            make: makes it, given its parent, its identifier and its name.
        """
        parent, used = await self._folder(server, place)
        name = ua.QualifiedName(place.path[-1][1], place.path[-1][0])
        try:
            node = await make(parent, _identifier(place), name)
        except Exception:
            await self._let_go(server, self._use(used))
            raise
        return node, [*used, node.nodeid]

    async def _folder(self, server: Server, place: Place) -> tuple[Node, list[ua.NodeId]]:
        """The folder of a node that is to be made, itself made unless it is there, and the nodes on the way."""
        if not place.path:
            raise CommunicationError(f"{place}: no such node, and no path to make it at")
        way: list[ua.NodeId] = []
        node = server.nodes.root
        for namespace, name in place.path[:-1]:
            try:
                node = await node.get_child([ua.QualifiedName(name, namespace)])
            except ua.UaError:
                node = await node.add_folder(ua.NodeId(0, namespace), ua.QualifiedName(name, namespace))
            way.append(node.nodeid)
        return node, way


_VARIABLES: Final = (ua.NodeId(ua.ObjectIds.BaseDataVariableType), ua.NodeId(ua.ObjectIds.PropertyType))
"""Types of variables that can be made."""
_CLOSED: Final = "cannot listen for OPC UA at {}"


async def _node_of(server: Server, name: ua.NodeId) -> Node | None:
    """The node with an identifier; None when there is none."""
    node = server.get_node(name)
    try:
        await node.read_node_class()
    except ua.UaError:
        return None
    return node


def _look_whether_free(address: Address) -> None:
    """Raises CommunicationError when another process listens there; the server is long in being made."""
    try:
        socket.create_server(address).close()
    except OSError as error:
        raise CommunicationError(f"{_CLOSED.format(address)}: {error.strerror or error}") from None


def _identifier(place: Place) -> ua.NodeId:
    """The identifier that a place asks for; without one the server chooses in the namespace of the name."""
    return identifier(place.node) if place.node is not None else ua.NodeId(0, place.path[-1][0])


def identifier(name: NodeName) -> ua.NodeId:
    """A node's identifier as the library has it."""
    if name.kind == "b":
        return ua.NodeId(str(name.identifier).encode(), name.namespace, ua.NodeIdType.ByteString)
    return ua.NodeId(name.identifier, name.namespace)
