"""Ports of running devices by the names that people give: `[DEVICE.][RESOURCE.]BLOCK.PORT`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from iec61499.deploy.listing import listed
from iec61499.errors import ToolError, choices
from iec61499.files.project import project_of
from iec61499.files.systems import read_system
from iec61499.library import Library
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ManagementError, Watch
from iec61499.mapping import management_address
from iec61499.net.address import parse_stream_address

Clients = Mapping[str, ManagementClient]
"""Sessions by the device's name; "" is that of a device without one."""


@dataclass(frozen=True, slots=True)
class Place:
    """A resource of a device, and what is meant in it.

    Attributes:
        client: the session with the device.
        resource: the resource's name.
        name: the block, `BLOCK`, or the port, `BLOCK.PORT`.
        called: what people call it.
    """

    client: ManagementClient
    resource: str
    name: str
    called: str


@contextmanager
def sessions(target: str) -> Iterator[Clients]:
    """Sessions with the device at an address, or with all devices of a system (.sys), at the addresses that it gives.

    Raises:
        ToolError: the system cannot be read, a device has no address, or does not answer.
    """
    with ExitStack() as stack:
        if not target.endswith(".sys"):
            yield {"": stack.enter_context(ManagementClient(parse_stream_address(target)))}
            return
        file = Path(target)
        system = read_system(file, Library([project_of(file)]))
        clients = {}
        for device in system.devices:
            address = management_address(device)
            if not address:
                raise ToolError(f"{target}: device {device.name} has no address: expected its parameter MGR_ID")
            clients[device.name] = stack.enter_context(ManagementClient(parse_stream_address(address)))
        if not clients:
            raise ToolError(f"{target}: has no device")
        yield clients


def port(clients: Clients, name: str) -> Place:
    """The port that a name means. Raises ToolError, which names what may be meant."""
    return _one(clients, name, _has_port)


def block(clients: Clients, name: str) -> Place:
    """The block that a name means. Raises ToolError."""
    return _one(clients, name, _has_block)


def _one(clients: Clients, name: str, has: Callable[[Place], bool]) -> Place:
    places = list(_places(clients, name))
    found = [place for place in places if has(place)]
    if len(found) == 1:
        return found[0]
    if found:
        valid = choices([f"{_prefix(clients, place)}{place.resource}.{place.name}" for place in found])
        raise ToolError(f"{name}: expected one of {valid}")
    if not places:
        addresses = ", ".join(str(client.address) for client in clients.values())
        raise ToolError(f"{name}: {addresses} has no resource: expected a device on which something is built")
    raise ToolError(f"{name}: no such block or port{_hint(places)}")


def _places(clients: Clients, name: str) -> Iterator[Place]:
    """What a name may mean: an application may be called as a device or a resource."""
    for device, client in clients.items():
        for resource in [each.name for each in client.blocks("")]:
            yield Place(client, resource, name, name)
            for before in (f"{resource}.", f"{device}.", f"{device}.{resource}."):
                if len(before) > 1 and name.startswith(before):
                    yield Place(client, resource, name.removeprefix(before), name)


def _has_port(place: Place) -> bool:
    """Whether a resource has a port: a datum that can be read, or an event that can be watched."""
    if "." not in place.name:
        return False
    try:
        place.client.read(place.resource, place.name)
    except ManagementError:
        watches = place.client.request(place.resource, "READ", Watch()).watches or {}
        if any(place.name in ports for ports in watches.values()):
            return True
        if place.client.request(place.resource, "CREATE", Watch(place.name)).reason is not None:
            return False
        place.client.demand(place.resource, "DELETE", Watch(place.name))
    return True


def _has_block(place: Place) -> bool:
    return any(place.name == name for name, _ in listed(place.client, place.resource).blocks)


def _prefix(clients: Clients, place: Place) -> str:
    return next((f"{name}." for name, client in clients.items() if name and client is place.client), "")


def _hint(places: list[Place]) -> str:
    """Names of blocks that may be meant."""
    meant = []
    for place in places:
        inner, _, end = place.name.rpartition(".")
        for name, _kind in listed(place.client, place.resource).blocks:
            if inner and name.endswith(f".{inner}"):
                meant.append(f"{name}.{end}")
            elif name.endswith(f".{place.name}"):
                meant.append(name)
    return f": expected {choices(dict.fromkeys(meant))}" if meant else ""
