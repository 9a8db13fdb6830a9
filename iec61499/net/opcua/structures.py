"""Structures of function blocks as structures of OPC UA (part 3, 8.49, and part 6, 5.2.6: binary encoding).

A structure is the encoded values of its members one after another, in an extension object that names the node of its
encoding, which each server chooses for itself. They are encoded here, not by classes that the library makes, as these
are known by that node alone, in the whole process: two servers may use one for different structures.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from asyncua import Client, Node, Server, ua
from asyncua.common.structures104 import new_struct, new_struct_field
from asyncua.common.utils import Buffer
from asyncua.ua.ua_binary import Primitives, pack_uatype, struct_to_binary, unpack_uatype

from iec61499.errors import CommunicationError
from iec61499.net.encoding import Value
from iec61499.net.opcua.values import Converter, converter
from iec61499.types import ArrayType, DataType, Member, StructType

BINARY: Final = "Default Binary"
"""Browse name of the node of an encoding."""
LONGEST: Final = 65_535
"""Most elements of an array in a structure."""


@dataclass(frozen=True, slots=True)
class Layout:
    """How a structure is encoded.

    Attributes:
        kind: the structure.
        parts: its members: name, layout or what converts it, and the elements of an array (0: a single value).
    """

    kind: StructType
    parts: tuple[Part, ...]


Part = tuple[str, Layout | Converter, int]


class StructureConverter:
    """Converts the values of one port that are structures, or arrays of them.

    Args:
        kind: the type of the port.

    Attributes:
        layout: the structure, or that of an array's elements.
        length: elements of the array; 0 for a single value.
        variant: what it is in OPC UA.
        data_type: the node of the data type on the server; the null node until `bind`.

    Raises:
        CommunicationError: a member has no value in OPC UA.
    """

    variant: Final = ua.VariantType.ExtensionObject

    def __init__(self, kind: DataType) -> None:
        found = kind.element if isinstance(kind, ArrayType) else kind
        assert isinstance(found, StructType)
        self.layout = _layout(found)
        self.length = kind.elements if isinstance(kind, ArrayType) else 0
        self.data_type = ua.NodeId()
        self._encoding = ua.NodeId()

    @property
    def rank(self) -> int:
        """The rank of a variable: -1 for a single value, 1 for an array."""
        return 1 if self.length else -1

    def bind(self, data_type: ua.NodeId, encoding: ua.NodeId) -> None:
        """Takes the nodes that the server has for the data type and for its encoding."""
        self.data_type = data_type
        self._encoding = encoding

    def encode(self, value: Value) -> ua.Variant:
        """The value for OPC UA. Raises CommunicationError when it has none, or before `bind`."""
        if self._encoding.is_null():
            raise CommunicationError(f"the server has not told yet how it encodes {self.layout.kind.name}")
        try:
            values = value if self.length else [value]
            objects = [ua.ExtensionObject(self._encoding, _pack(self.layout, one)) for one in values]
        except (OverflowError, UnicodeError, ValueError, TypeError, KeyError):
            raise CommunicationError(f"{value!r:.60} is no {self.layout.kind.name} for OPC UA") from None
        return ua.Variant(objects if self.length else objects[0], self.variant)

    def decode(self, variant: ua.Variant | None) -> Value:
        """The value of a block. Raises CommunicationError when it is of another type or length."""
        if variant is None or variant.Value is None or variant.VariantType != self.variant:
            got = "nothing" if variant is None or variant.Value is None else variant.VariantType.name
            raise CommunicationError(f"got {got}, expected the structure {self.layout.kind.name}")
        if bool(variant.is_array) != bool(self.length):
            raise CommunicationError(f"expected {'an array' if self.length else 'a single value'}")
        if self.length:
            return [self._decoded(one) for one in variant.Value[: self.length]]
        return self._decoded(variant.Value)

    def _decoded(self, found: Any) -> Value:
        name = self.layout.kind.name
        if isinstance(found, ua.ExtensionObject):
            if found.TypeId != self._encoding:
                raise CommunicationError(f"got a structure {found.TypeId.to_string()}, expected {name}")
            body = found.Body or b""
        else:  # somebody else in this process has the library know it
            body = struct_to_binary(found)
        rest = Buffer(body)
        try:
            value = _unpack(self.layout, rest)
        except CommunicationError:
            raise
        except Exception:  # the library raises whatever its reading of foreign bytes meets
            raise CommunicationError(f"{len(body)} bytes are no {name}") from None
        if len(rest):
            raise CommunicationError(f"{len(body)} bytes are more than a {name}")
        return value


AnyConverter = Converter | StructureConverter
"""What converts the values of a port."""
Known = dict[str, tuple[StructType, ua.NodeId, ua.NodeId]]
"""The structures that the own server knows by their names, with the nodes of data type and encoding."""


def any_converters(kinds: Sequence[DataType]) -> tuple[AnyConverter, ...]:
    """What converts the values of several ports. Raises CommunicationError."""
    return tuple(map(any_converter, kinds))


def any_converter(kind: DataType) -> AnyConverter:
    """What converts values of a type. Raises CommunicationError when OPC UA has none."""
    element = kind.element if isinstance(kind, ArrayType) else kind
    if isinstance(element, StructType) and element.name != "LocalizedText":
        return StructureConverter(kind)
    return converter(kind)


async def bind_own(server: Server, each: AnyConverter, known: Known) -> None:
    """Has the device's own server know a structure, with those inside it.

    Args:
        server: the server.
        each: what converts its values; others than structures need nothing.
        known: what the server knows, by name.

    Raises:
        CommunicationError: the server knows another structure of that name.
    """
    if isinstance(each, StructureConverter):
        each.bind(*await _made(server, each.layout, known))


async def _made(server: Server, layout: Layout, known: Known) -> tuple[ua.NodeId, ua.NodeId]:
    kind = layout.kind
    if kind.name in known:
        before, *nodes = known[kind.name]
        if before != kind:
            raise CommunicationError(f"the server has another structure {kind.name}: expected one of each name")
        return nodes[0], nodes[1]
    fields = []
    for name, element, length in layout.parts:
        inner = (await _made(server, element, known))[0] if isinstance(element, Layout) else element.data_type
        fields.append(new_struct_field(name, inner, array=bool(length)))
    node, (encoding,) = await new_struct(server, 1, kind.name, fields)
    known[kind.name] = kind, node.nodeid, encoding.nodeid
    return node.nodeid, encoding.nodeid


async def bind_remote(client: Client, each: AnyConverter, data_type: ua.NodeId) -> None:
    """Asks another server how it encodes a structure, and whether it is the one that the block has.

    Args:
        client: the session with the server.
        each: what converts its values; others than structures need nothing.
        data_type: the node of the data type there.

    Raises:
        CommunicationError: it is another structure, or has no binary encoding.
    """
    if isinstance(each, StructureConverter):
        node = client.get_node(data_type)
        await _compare(client, each.layout, node)
        for encoding in await node.get_referenced_nodes(ua.ObjectIds.HasEncoding, ua.BrowseDirection.Forward):
            if (await encoding.read_browse_name()).Name == BINARY:
                each.bind(data_type, encoding.nodeid)
                return
        raise CommunicationError(f"{data_type.to_string()}, for {each.layout.kind.name}, has no {BINARY} there")


async def _compare(client: Client, layout: Layout, node: Node) -> None:
    """Raises CommunicationError if a server describes another structure; servers of old describe none."""
    try:
        described = await node.read_data_type_definition()
    except ua.UaError:
        return
    if not isinstance(described, ua.StructureDefinition) or described.StructureType != ua.StructureType.Structure:
        raise CommunicationError(f"{node.nodeid.to_string()} is no structure without optional members")
    there = described.Fields or []
    name_of, parts = layout.kind.name, layout.parts
    if [field.Name.lower() for field in there] != [name.lower() for name, _, _ in parts]:
        found, names = (", ".join(each) for each in ([f.Name for f in there], [name for name, _, _ in parts]))
        raise CommunicationError(f"{name_of} has the members {found} there: expected {names}")
    for field, (name, element, length) in zip(there, parts, strict=True):
        if (field.ValueRank == ua.ValueRank.OneDimension) != bool(length):
            raise CommunicationError(f"{name_of}.{name} is {'no ' * bool(length)}array there")
        if isinstance(element, Layout):
            await _compare(client, element, client.get_node(field.DataType))
        elif field.DataType != element.data_type:
            raise CommunicationError(f"{name_of}.{name} has another type there than {element.variant.name}")


def _layout(kind: StructType) -> Layout:
    """How a structure is encoded. Raises CommunicationError for a member that has no value in OPC UA."""
    return Layout(kind, tuple(_part(kind, member) for member in kind.members))


def _part(kind: StructType, member: Member) -> Part:
    element = member.type.element if isinstance(member.type, ArrayType) else member.type
    length = member.type.elements if isinstance(member.type, ArrayType) else 0
    if isinstance(element, StructType) and element.name != "LocalizedText":
        return member.name, _layout(element), length
    try:
        return member.name, converter(element), length
    except CommunicationError as error:
        raise CommunicationError(f"{kind.name}.{member.name}: {error}") from None


def _pack(layout: Layout, value: Value) -> bytes:
    packed = []
    for (_, element, length), given in zip(layout.parts, value, strict=True):
        values = given if length else [given]
        if length:
            packed.append(Primitives.Int32.pack(len(values)))
        packed += [_packed(element, one) for one in values]
    return b"".join(packed)


def _packed(element: Layout | Converter, value: Value) -> bytes:
    if isinstance(element, Layout):
        return _pack(element, value)
    found: bytes = pack_uatype(element.variant, element.encode(value).Value)
    return found


def _unpack(layout: Layout, data: Buffer) -> Value:
    values: list[Value] = []
    for _, element, length in layout.parts:
        if not length:
            values.append(_unpacked(element, data))
            continue
        count = Primitives.Int32.unpack(data)
        if not -1 <= count <= LONGEST:
            raise CommunicationError(f"array of {count} elements in {layout.kind.name}: expected at most {LONGEST}")
        values.append([_unpacked(element, data) for _ in range(max(count, 0))][:length])
    return values


def _unpacked(element: Layout | Converter, data: Buffer) -> Value:
    if isinstance(element, Layout):
        return _unpack(element, data)
    value = unpack_uatype(element.variant, data)
    return element.decode(ua.Variant("" if value is None else value, element.variant))
