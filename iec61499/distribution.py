"""Connections from one resource to another: left to communication blocks, or given such blocks.

4diac IDE deploys the networks of the resources and skips connections of the application between them. Where nothing
in the receiving resource is connected to the end of such a connection, this module adds the blocks: a PUBLISH for
every event and one SUBSCRIBE for all that a resource sends to another, so that it arrives in the order in which it
was sent. Where several events cross, the first value says which of them came. An event that goes to several
resources goes to them in the order in which the system lists these; what follows from it in one of them can
overtake it on the way to the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Final

from iec61499 import acknowledged, model
from iec61499.errors import FunctionBlockError, choices
from iec61499.mapping import management_address, places_of
from iec61499.types import UINT, DataType

FIRST_PORT: Final = 62_000
"""UDP port of the first pair between devices; the others follow it."""
GROUP: Final = "239.192.0.2"
"""Multicast group for devices whose host is a name."""

Finder = Callable[[str, str, int], model.LibraryElement]


Adder = Callable[[model.BasicFBType], None]


def distributed(system: model.System, find: Finder, add: Adder | None = None) -> model.System:
    """The system without connections between resources, and with communication blocks where they were needed.

    `inserted` of the result says which blocks were added.

    Args:
        system: the system as its file says.
        find: finds a type by its name; the file and line that use it are for errors.
        add: makes a type known; given, every event waits until the one before it is acknowledged (`acknowledged`),
            otherwise events are sent as datagrams.

    Raises:
        FunctionBlockError: a mapping of or to something unknown, or an input that would get two sources.
    """
    if sum(len(device.resources) for device in system.devices) < 2:
        return system
    return _Distribution(system, find, add).build()


@dataclass(slots=True)
class _Link:
    """What one resource sends to another: destinations by source port; types of data, events that carry them."""

    sender: str
    receiver: str
    line: int
    events: dict[str, list[str]] = field(default_factory=dict)
    data: dict[str, list[str]] = field(default_factory=dict)
    types: dict[str, DataType] = field(default_factory=dict)
    carriers: dict[str, list[str]] = field(default_factory=dict)


class _Distribution:
    def __init__(self, system: model.System, find: Finder, add: Adder | None) -> None:
        self._system = system
        self._find = find
        self._add = add
        self._resources = {f"{d.name}.{r.name}": r for d in system.devices for r in d.resources}
        self._hosts = {device.name: _host(device) for device in system.devices}
        self._places = places_of(system)
        self._links: dict[tuple[str, str], _Link] = {}
        self._told: dict[tuple[str, str], dict[str, DataType]] = {}
        self._said: list[str] = []
        self._ports = 0

    def build(self) -> model.System:
        applications = tuple(self._typed(self._application(each)) for each in self._system.applications)
        order = list(self._resources)
        for link in sorted(self._links.values(), key=lambda link: order.index(link.receiver)):
            self._insert(link)
        devices = tuple(
            replace(device, resources=tuple(self._resources[f"{device.name}.{r.name}"] for r in device.resources))
            for device in self._system.devices
        )
        return replace(self._system, applications=applications, devices=devices, inserted=tuple(self._said))

    def _application(self, application: model.ApplicationDeclaration) -> model.ApplicationDeclaration:
        network, places = application.network, self._places.get(application.name, {})
        kept: dict[str, list[model.Connection]] = {"events": [], "data": [], "adapters": []}
        for kind, connections in (("events", network.events), ("data", network.data), ("adapters", network.adapters)):
            for connection in connections:
                ends = (places.get(_block(connection.source)), places.get(_block(connection.destination)))
                if ends[0] == ends[1] or None in ends:
                    kept[kind].append(connection)
                else:
                    self._leave(application, kind, connection, ends)
        changed = replace(
            network, events=tuple(kept["events"]), data=tuple(kept["data"]), adapters=tuple(kept["adapters"])
        )
        return replace(application, network=changed)

    def _leave(
        self,
        application: model.ApplicationDeclaration,
        kind: str,
        connection: model.Connection,
        ends: tuple[str | None, ...],
    ) -> None:
        """Notes a connection from one resource to another."""
        network = application.network
        if kind == "data" and self._is_of_adapter(network, connection):
            kind = "adapters"
        if kind != "adapters" or not self._has_adapter(application, connection, ends):
            for one_kind, one in self._plain(network, kind, connection):
                self._cross(application, self._places[application.name], one_kind, one)

    def _is_of_adapter(self, network: model.FBNetwork, connection: model.Connection) -> bool:
        """Whether a connection begins at a plug or socket: older versions of 4diac IDE write these among the data."""
        block, _, port = connection.source.rpartition(".")
        return any(adapter.name == port for adapter in self._interface(network, block, connection.line).adapters)

    def _has_adapter(
        self, application: model.ApplicationDeclaration, connection: model.Connection, ends: tuple[str | None, ...]
    ) -> bool:
        """Whether a resource connects the plug or the socket to something of its own."""
        served = {end for place in ends if place for end in _ends(self._resources[place].network.adapters)}
        own = (connection.source, connection.destination)
        return any(end in served or f"{application.name}.{end}" in served for end in own)

    def _plain(
        self, network: model.FBNetwork, kind: str, connection: model.Connection
    ) -> Iterator[tuple[str, model.Connection]]:
        """A connection of events or data as it is; one of adapters as those that it stands for."""
        if kind != "adapters":
            yield kind, connection
            return
        plug = connection.source.rpartition(".")[2]
        interface = self._interface(network, _block(connection.source), connection.line)
        ports = next((a.type.interface for a in interface.adapters if a.name == plug), model.Interface())
        forward, backward = (connection.source, connection.destination), (connection.destination, connection.source)
        for (source, destination), events, variables in (
            (forward, ports.event_outputs, ports.outputs),
            (backward, ports.event_inputs, ports.inputs),
        ):
            for event in events:
                one = model.Connection(f"{source}.{event.name}", f"{destination}.{event.name}", line=connection.line)
                yield "events", one
            for variable in variables:
                name = variable.name
                yield "data", model.Connection(f"{source}.{name}", f"{destination}.{name}", line=connection.line)

    def _cross(
        self,
        application: model.ApplicationDeclaration,
        places: dict[str, str],
        kind: str,
        connection: model.Connection,
    ) -> None:
        """Notes a connection to another resource, unless something there serves its end already."""
        block, receiver = _block(connection.source, places), places[_block(connection.destination, places)]
        own = self._resources[receiver].network
        served = own.events if kind == "events" else own.data
        names = (connection.destination, f"{application.name}.{connection.destination}")
        if any(other.destination in names for other in served):
            return
        ends = places[block], receiver
        link = self._links.setdefault(ends, _Link(*ends, connection.line))
        if kind == "events":
            link.events.setdefault(connection.source, []).append(connection.destination)
            return
        link.data.setdefault(connection.source, []).append(connection.destination)
        name = connection.source.removeprefix(f"{block}.")
        interface = self._interface(application.network, block, connection.line)
        if name in interface.in_outs:
            raise FunctionBlockError(
                f"connection {connection.source} -> {connection.destination}: a VAR_IN_OUT does not leave its "
                "resource: expected both blocks mapped to one",
                application.network.file,
                connection.line,
            )
        carriers = [f"{block}.{event.name}" for event in interface.event_outputs if name in event.with_variables]
        link.carriers[connection.source] = carriers
        kind_of = next((v.type for v in interface.outputs if v.name == name), None)
        if kind_of is None or isinstance(kind_of, model.GenericType):
            kind_of = self._wanted(application.network, connection, places)
            if kind_of is not None:
                self._told.setdefault((application.name, block), {})[name] = kind_of
        if kind_of is not None:
            link.types[connection.source] = kind_of

    def _wanted(
        self, network: model.FBNetwork, connection: model.Connection, places: dict[str, str]
    ) -> DataType | None:
        """The type of the input at the end of a connection, which its generic source has to have."""
        block = _block(connection.destination, places)
        name = connection.destination.removeprefix(f"{block}.")
        inputs = self._interface(network, block, connection.line).inputs
        found = next((v.type for v in inputs if v.name == name), None)
        return None if isinstance(found, model.GenericType) else found

    def _typed(self, application: model.ApplicationDeclaration) -> model.ApplicationDeclaration:
        """The application whose generic blocks know the types that only inputs in other resources tell."""
        network = application.network
        blocks = tuple(
            replace(block, types=(*block.types, *self._told.get((application.name, block.name), {}).items()))
            for block in network.blocks
        )
        return replace(application, network=replace(network, blocks=blocks))

    def _insert(self, link: _Link) -> None:
        data = list(link.data)
        triggers = list(link.events)
        for port in data:
            carriers = link.carriers.get(port, ())
            if not any(carrier in triggers for carrier in carriers):
                triggers += carriers
        if not triggers:
            # nothing publishes these data: the receiver keeps its initial values, as it would in one resource
            return
        sender, receiver = f"TO_{link.receiver}".replace(".", "_"), f"FROM_{link.sender}".replace(".", "_")
        ports = choices((*triggers, *data)).replace(" or ", " and ")
        if self._add is not None:
            self._acknowledge(link, sender, receiver, triggers, data, self._add)
            self._said.append(f"{link.sender} -> {link.receiver}: queue, CLIENT and SERVER for {ports}")
            return
        count = len(data) + (len(triggers) > 1)
        given = (("QI", "TRUE"), ("ID", f"'{self._address(link)}'"))
        self._add_sender(link, sender, f"PUBLISH_{count}", given, triggers, data)
        self._add_receiver(link, receiver, f"SUBSCRIBE_{count}", given, triggers, data)
        self._said.append(f"{link.sender} -> {link.receiver}: PUBLISH and SUBSCRIBE for {ports}")

    def _acknowledge(
        self, link: _Link, sender: str, receiver: str, triggers: list[str], data: list[str], add: Adder
    ) -> None:
        host = self._hosts[link.receiver.partition(".")[0]]
        if host == GROUP:
            raise FunctionBlockError(
                f"device {link.receiver.partition('.')[0]}: MGR_ID has no host in figures, which acknowledged links "
                "need: expected one such as 192.168.1.5:61499",
                self._system.header.file,
                link.line,
            )
        address = self._address(link)
        queue = f"QUEUE_{link.sender}_{link.receiver}".replace(".", "_")
        file, types = self._system.header.file, [link.types.get(port) for port in data]
        if unknown := [port for port, kind in zip(data, types, strict=True) if kind is None]:
            raise FunctionBlockError(f"{unknown[0]} has no type of its own to be sent with", file, link.line)
        known = [kind for kind in types if kind is not None]
        add(acknowledged.queue_type(queue, len(triggers), known, file, link.line))
        sending = acknowledged.sender(sender, queue, address, triggers, data)
        to = [link.events.get(trigger, []) for trigger in triggers]
        receiving = acknowledged.receiver(receiver, address, to, [link.data[port] for port in data])
        sent = (UINT, *known) if len(triggers) > 1 else known
        received = tuple((f"RD_{n}", kind) for n, kind in enumerate(sent, 1))
        for resource, part in ((link.sender, sending), (link.receiver, receiving)):
            blocks = [_made(name, kind, link.line, given) for name, kind, given in part.blocks]
            if part is receiving:
                blocks[0] = replace(blocks[0], types=received)
            self._extend(resource, blocks, list(part.events), list(part.data), link.line)

    def _address(self, link: _Link) -> str:
        self._ports += 1
        return f"{self._hosts[link.receiver.partition('.')[0]]}:{FIRST_PORT + self._ports - 1}"

    def _add_sender(
        self,
        link: _Link,
        name: str,
        kind: str,
        given: tuple[tuple[str, str], ...],
        triggers: list[str],
        data: list[str],
    ) -> None:
        """Adds a publisher for every event: its number is a constant, which no later event can overtake."""
        blocks: list[model.Block] = []
        events: list[tuple[str, str]] = []
        wires: list[tuple[str, str]] = []
        several = len(triggers) > 1
        for number, trigger in enumerate(triggers):
            one = f"{name}_{number}" if several else name
            which = (("SD_1", f"UINT#{number}"),) if several else ()
            blocks.append(_made(one, kind, link.line, (*given, *which)))
            events += [("START.COLD", f"{one}.INIT"), (trigger, f"{one}.REQ")]
            wires += [(port, f"{one}.SD_{place}") for place, port in enumerate(data, 1 + several)]
        self._extend(link.sender, blocks, events, wires, link.line)

    def _add_receiver(
        self,
        link: _Link,
        name: str,
        kind: str,
        given: tuple[tuple[str, str], ...],
        triggers: list[str],
        data: list[str],
    ) -> None:
        several = len(triggers) > 1
        types = ((f"RD_{n}", link.types[port]) for n, port in enumerate(data, 1 + several) if port in link.types)
        blocks = [replace(_made(name, kind, link.line, given), types=tuple(types))]
        events = [("START.COLD", f"{name}.INIT")]
        first = 1
        wires: list[tuple[str, str]] = []
        if several:
            first = 2
            blocks.append(_made(f"{name}_WHICH", f"E_DEMUX_{len(triggers)}", link.line))
            events.append((f"{name}.IND", f"{name}_WHICH.EI"))
            wires.append((f"{name}.RD_1", f"{name}_WHICH.K"))
        for number, trigger in enumerate(triggers, 1):
            source = f"{name}_WHICH.EO{number}" if several else f"{name}.IND"
            events += [(source, destination) for destination in link.events.get(trigger, ())]
        for number, port in enumerate(data, first):
            wires += [(f"{name}.RD_{number}", destination) for destination in link.data[port]]
        self._extend(link.receiver, blocks, events, wires, link.line)

    def _extend(
        self,
        resource: str,
        blocks: list[model.Block],
        events: list[tuple[str, str]],
        data: list[tuple[str, str]],
        line: int,
    ) -> None:
        declared = self._resources[resource]
        network = declared.network
        # channels open before the application starts
        opening = [e for e in events if e[0] == "START.COLD"]
        rest = [e for e in events if e[0] != "START.COLD"]
        changed = replace(
            network,
            blocks=(*network.blocks, *blocks),
            events=(*_connections(opening, line), *network.events, *_connections(rest, line)),
            data=(*network.data, *_connections(data, line)),
            file=network.file or self._system.header.file,
        )
        self._resources[resource] = replace(declared, network=changed)

    def _interface(self, network: model.FBNetwork, name: str, line: int) -> model.Interface:
        for block in network.blocks:
            if block.name == name:
                return self._find(block.type_name, network.file, block.line).interface
        for sub in network.subapplications:
            if sub.name == name:
                typed = sub.type_name and not sub.network.blocks and not sub.network.subapplications
                return self._find(sub.type_name, network.file, sub.line).interface if typed else sub.interface
        raise FunctionBlockError(f"unknown block {name}", network.file, line)


def _block(end: str, places: dict[str, str] | None = None) -> str:
    """The block in `BLOCK.PORT`; with places also in `BLOCK.ADAPTER.PORT`."""
    block = end.rpartition(".")[0]
    if places is not None and block not in places:
        return block.rpartition(".")[0]
    return block


def _ends(connections: tuple[model.Connection, ...]) -> set[str]:
    return {end for connection in connections for end in (connection.source, connection.destination)}


def _made(name: str, kind: str, line: int, given: tuple[tuple[str, str], ...] = ()) -> model.Block:
    return model.Block(name, kind, tuple(model.Parameter(port, value, line=line) for port, value in given), line=line)


def _connections(ends: list[tuple[str, str]], line: int) -> tuple[model.Connection, ...]:
    return tuple(model.Connection(source, destination, line=line) for source, destination in ends)


def _host(device: model.DeviceDeclaration) -> str:
    """Where to send to a device: its own address where figures give it, else a group."""
    address = management_address(device)
    host = address.rpartition(":")[0]
    if address and host in ("", "localhost"):
        return "127.0.0.1"
    return host if host and host.replace(".", "").isdigit() else GROUP
