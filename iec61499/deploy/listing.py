"""What a resource on a device consists of, as far as the device tells it.

A 4diac FORTE 2 lists only blocks without a dot in their name, and so none of an application. `write_note` leaves on
such a device what has been built: blocks of type PUBLISH that are never initialised hold it in their input ID, as
JSON, compressed, in base 64. `listed` puts it together with what the device lists by itself. A FORTE 3 writes the
name of the resource in front of the ends of connections.
"""

from __future__ import annotations

import base64
import binascii
import itertools
import zlib
from collections.abc import Iterable
from typing import Final

import msgspec

from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ANY, ManagedBlock, ManagedConnection, ManagementError

NOTE: Final = "DEPLOYED_"
"""What the names of the blocks with the note begin with; a number follows."""
NOTE_TYPE: Final = "PUBLISH_0"
PIECE: Final = 18_000
"""Most characters of the note in one request to a FORTE with Lua."""
SHORT_PIECE: Final = 1_000
"""The same for one without Lua, whose buffer is shorter."""
_LARGEST: Final = 4 * 2**20
"""Most bytes of a note that is taken from a device."""


class Listing(msgspec.Struct, frozen=True):
    """Blocks, each with its type, and connections, each with source and destination, of a resource."""

    blocks: tuple[tuple[str, str], ...]
    connections: tuple[tuple[str, str], ...]


def listed(client: ManagementClient, resource: str) -> Listing:
    """The blocks of a resource but START, and its connections.

    What a FORTE 2 does not list is what `write_note` has left there; blocks and connections that others have changed
    since then are not found out.

    Raises:
        ManagementError: the device has no such resource, or a note that cannot be read.
        CommunicationError: the device does not answer.
    """
    told = [(block.name, block.type_name) for block in client.blocks(resource)]
    notes = [name for name, _ in told if name.startswith(NOTE) and name.removeprefix(NOTE).isdecimal()]
    blocks = {name: kind for name, kind in told if name not in notes}
    links = client.demand(resource, "QUERY", ManagedConnection(ANY, ANY)).connections or ()
    ends = [(_end(link.source, resource, blocks), _end(link.destination, resource, blocks)) for link in links]
    if not notes:
        blocks.pop("START", None)
        return Listing(tuple(blocks.items()), tuple(ends))
    noted = _read_note(client, resource, notes)
    own = set(blocks)
    connections = [pair for pair in ends if _block(pair[0]) in own and _block(pair[1]) in own]
    hidden = [pair for pair in noted.connections if not (_block(pair[0]) in own and _block(pair[1]) in own)]
    blocks = dict(noted.blocks) | blocks
    blocks.pop("START", None)
    gone = {name for name, _ in noted.blocks if "." not in name} - own
    return Listing(
        tuple((name, kind) for name, kind in blocks.items() if name not in gone),
        (*connections, *(pair for pair in hidden if not {_block(pair[0]), _block(pair[1])} & gone)),
    )


def write_note(client: ManagementClient, resource: str, built: Listing, short: bool) -> None:
    """Leaves what a resource consists of on a device that does not list it; nothing on any other device.

    Args:
        client: a session with the device.
        resource: the resource's name.
        built: its blocks and connections.
        short: whether the device takes short requests only.

    Raises:
        ManagementError: the device refuses.
        CommunicationError: the device does not answer.
    """
    told = {block.name for block in client.blocks(resource)}
    old = {name for name in told if name.startswith(NOTE)}
    if all(name in told for name, _ in built.blocks):
        _delete(client, resource, old)
        return
    text = base64.b64encode(zlib.compress(msgspec.json.encode(built), 9)).decode()
    size = SHORT_PIECE if short else PIECE
    pieces = {
        f"{NOTE}{number}": text[start : start + size]
        for number, start in zip(itertools.count(1), range(0, len(text), size), strict=False)
    }
    _delete(client, resource, old - set(pieces))
    for name, piece in pieces.items():
        if name not in old:
            client.create_block(resource, name, NOTE_TYPE)
            # a FORTE 2 stops a resource only if all its blocks run
            client.demand(resource, "START", ManagedBlock(name, NOTE_TYPE))
        client.write(resource, f"{name}.ID", f'"{piece}"')


def _delete(client: ManagementClient, resource: str, names: Iterable[str]) -> None:
    for name in sorted(names):
        client.request(resource, "STOP", ManagedBlock(name, NOTE_TYPE))
        client.delete_block(resource, name)


def _read_note(client: ManagementClient, resource: str, names: Iterable[str]) -> Listing:
    ordered = sorted(names, key=lambda name: int(name.removeprefix(NOTE)))
    text = "".join(client.read_all((resource, f"{name}.ID") for name in ordered))
    try:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(base64.b64decode(text, validate=True), _LARGEST)
        return msgspec.json.decode(data, type=Listing)
    except (binascii.Error, zlib.error, msgspec.MsgspecError) as error:
        raise ManagementError(
            "INVALID_STATE",
            f"{client.address}: {resource} has a note of what was deployed that cannot be read ({error}): "
            "expected one built by deploy",
        ) from None


def _block(end: str) -> str:
    return end.rpartition(".")[0]


def _end(end: str, resource: str, blocks: Iterable[str]) -> str:
    plain = end.removeprefix(f"{resource}.")
    return plain if _block(plain) in blocks and _block(end) not in blocks else end
