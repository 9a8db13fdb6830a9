"""What of a system runs: the network of a resource with the application blocks mapped to it, and other parameters."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from iec61499.errors import FunctionBlockError, choices
from iec61499.model import (
    Block,
    Connection,
    DeviceDeclaration,
    FBNetwork,
    ResourceDeclaration,
    SubApplication,
    System,
)
from iec61499.model import Mapping as Mapped


def device_network(system: System, name: str = "") -> FBNetwork:
    """The network that runs on a resource, with the names that 4diac IDE gives its blocks on a device.

    A block of an application is called `APPLICATION.BLOCK`, one inside its subapplication
    `APPLICATION.SUBAPPLICATION.BLOCK`; a block of the resource alone has its own name. Connections of the resource
    may use these names or those of the copies that 4diac IDE writes into the resource. The resource's E_RESTART block
    `START`, which 4diac does not write, is added.

    Args:
        system: the system configuration.
        name: `DEVICE.RESOURCE`, or the resource's name alone; may be left out when there is only one.

    Raises:
        FunctionBlockError: unknown or ambiguous resource, a mapping to or of something unknown, or a connection
            between blocks on different resources.
    """
    device, resource = _find_resource(system, name)
    return _ResourceNetwork(system, f"{device.name}.{resource.name}", resource).build()


def resource_network(system: System, name: str = "") -> FBNetwork:
    """The network that runs on a resource, with the names that its blocks have in their applications.

    It is `device_network` for programs in this process, which know one application: `APPLICATION.BLOCK` is `BLOCK`,
    unless another block of the resource is called so, too. Arguments and errors are those of `device_network`.
    """
    return _without_application(device_network(system, name), [a.name for a in system.applications])


def management_address(device: DeviceDeclaration) -> str:
    """What a device says of where it is managed, such as `localhost:61499`; "" when it says nothing."""
    given = next((p.value for p in device.parameters if p.name == "MGR_ID"), "")
    return given.strip("'\"")


def literal_of(value: Any) -> str:
    """A number, truth value, text or row of them as a literal of IEC 61131-3.

    Texts are words of letters and digits.
    """
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(literal_of, value))}]"
    if isinstance(value, str):
        return f"'{value}'"
    return str(value).upper() if isinstance(value, bool) else repr(value)


def configured(system: System, values: Mapping[str, float | str]) -> System:
    """The system with other parameters of its blocks.

    Args:
        system: the system configuration.
        values: numbers, truth values and texts by `BLOCK.INPUT`.

    Raises:
        FunctionBlockError: no block of the system has such a parameter.
    """
    known: set[str] = set()

    def in_block(block: Block) -> Block:
        names = {parameter.name: f"{block.name}.{parameter.name}" for parameter in block.parameters}
        known.update(names.values())
        changed = (
            replace(p, value=literal_of(values[names[p.name]])) if names[p.name] in values else p
            for p in block.parameters
        )
        return replace(block, parameters=tuple(changed))

    def in_network(network: FBNetwork) -> FBNetwork:
        return replace(network, blocks=tuple(in_block(block) for block in network.blocks))

    changed = replace(
        system,
        applications=tuple(replace(a, network=in_network(a.network)) for a in system.applications),
        devices=tuple(
            replace(d, resources=tuple(replace(r, network=in_network(r.network)) for r in d.resources))
            for d in system.devices
        ),
    )
    if missing := values.keys() - known:
        raise FunctionBlockError(f"no block has the parameter {min(missing)}", system.header.file)
    return changed


def _find_resource(system: System, name: str) -> tuple[DeviceDeclaration, ResourceDeclaration]:
    pairs = [(device, resource) for device in system.devices for resource in device.resources]
    names = [f"{device.name}.{resource.name}" for device, resource in pairs]
    if not pairs:
        raise FunctionBlockError(f"system {system.header.name} has no resource to run", system.header.file)
    found = [pair for pair, full in zip(pairs, names, strict=True) if name in ("", full, full.partition(".")[2])]
    if len(found) != 1:
        problem = f"unknown resource {name!r}" if not found else "more than one resource fits"
        raise FunctionBlockError(f"{problem}: expected {choices(names)}", system.header.file)
    return found[0]


class _ResourceNetwork:
    """Puts the network of one resource together from applications and mappings."""

    def __init__(self, system: System, full_name: str, resource: ResourceDeclaration) -> None:
        self.system = system
        self.full_name = full_name
        self.resource = resource
        self.file = system.header.file
        self.places = places_of(system)
        self.copies = self._copies()

    def build(self) -> FBNetwork:
        own = self.resource.network
        blocks = [block for block in own.blocks if block.name not in self.copies]
        subapplications = [sub for sub in own.subapplications if sub.name not in self.copies]
        self.own = {"START", *(block.name for block in blocks), *(sub.name for sub in subapplications)}
        events = [self._plain(connection) for connection in own.events]
        data = [self._plain(connection) for connection in own.data]
        adapters = [self._plain(connection) for connection in own.adapters]
        mapped_blocks: list[Block] = []
        mapped_subapplications: list[SubApplication] = []
        for application in self.system.applications:
            here = self._here(application.name)
            network, prefix = application.network, f"{application.name}."
            mapped_blocks += [replace(b, name=prefix + b.name) for b in network.blocks if b.name in here]
            mapped_subapplications += [
                replace(s, name=prefix + s.name) for s in network.subapplications if s.name in here
            ]
            events += self._inside(network.events, here, application.name)
            data += self._inside(network.data, here, application.name)
            adapters += self._inside(network.adapters, here, application.name)
        blocks = [*mapped_blocks, *blocks]
        if all(block.name != "START" for block in blocks):
            blocks.insert(0, Block("START", "E_RESTART", line=self.resource.line))
        return FBNetwork(
            tuple(blocks),
            (*mapped_subapplications, *subapplications),
            tuple(_unique(events)),
            tuple(_unique(data)),
            self.file,
            tuple(_unique(adapters)),
        )

    def _here(self, application: str) -> set[str]:
        """The elements of an application that are mapped to the resource."""
        places = self.places.get(application, {})
        return {element for element, resource in places.items() if resource == self.full_name}

    def _copies(self) -> dict[str, list[str]]:
        """For every name in the resource the blocks of applications whose copy there may be called so.

        A mapping may say how the copy is called; otherwise it is called as the block.
        """
        said: dict[str, list[str]] = {}
        plain: dict[str, list[str]] = {}
        for mapping in self.system.mappings:
            resource, copy = _destination(mapping)
            if resource == self.full_name:
                said.setdefault(copy, []).append(mapping.source)
                plain.setdefault(mapping.source.rpartition(".")[2], []).append(mapping.source)
        certain = {name: blocks for name, blocks in said.items() if name and len(blocks) == 1}
        return {**said, **plain, **certain}

    def _inside(self, connections: tuple[Connection, ...], here: set[str], application: str) -> list[Connection]:
        inside = []
        for connection in connections:
            ends = [end.rpartition(".")[0] in here for end in (connection.source, connection.destination)]
            if all(ends):
                source, destination = (f"{application}.{end}" for end in (connection.source, connection.destination))
                inside.append(replace(connection, source=source, destination=destination))
            elif any(ends) and self._is_placed(application, connection):
                raise FunctionBlockError(
                    f"connection {connection.source} -> {connection.destination} of application {application} leaves "
                    f"resource {self.full_name}: expected both blocks mapped to it, or communication blocks between",
                    self.file,
                    connection.line,
                )
        return inside

    def _is_placed(self, application: str, connection: Connection) -> bool:
        places = self.places.get(application, {})
        return all(end.rpartition(".")[0] in places for end in (connection.source, connection.destination))

    def _plain(self, connection: Connection) -> Connection:
        """A connection of the resource, its ends called as on a device."""
        source, destination = (self._end(end, connection.line) for end in (connection.source, connection.destination))
        return replace(connection, source=source, destination=destination)

    def _end(self, end: str, line: int) -> str:
        for block, port in _splits(end):
            application, _, element = block.partition(".")
            if block in self.own or element in self._here(application):
                return end
            meant = self.copies.get(block, [])
            if len(meant) > 1:
                raise FunctionBlockError(
                    f"{end}: {self.full_name} has more than one block {block}: expected {choices(list(meant))}",
                    self.file,
                    line,
                )
            if meant:
                return f"{meant[0]}.{port}"
        return end


def _splits(end: str) -> list[tuple[str, str]]:
    """The ways to take an end apart into a block, whose name may have dots, and a port; the longest block first."""
    parts = end.split(".")
    return [(".".join(parts[:n]), ".".join(parts[n:])) for n in range(len(parts) - 1, 0, -1)]


def _without_application(network: FBNetwork, applications: list[str]) -> FBNetwork:
    elements = [element.name for element in _elements(network)]
    short = {name: name.partition(".")[2] for name in elements if name.partition(".")[0] in applications}
    counted = Counter(short.get(name) or name for name in elements)
    names = {name: plain for name, plain in short.items() if plain and counted[plain] == 1}

    def renamed(connections: tuple[Connection, ...]) -> tuple[Connection, ...]:
        return tuple(replace(c, source=end(c.source), destination=end(c.destination)) for c in connections)

    def end(full: str) -> str:
        return next((f"{names[block]}.{port}" for block, port in _splits(full) if block in names), full)

    return replace(
        network,
        blocks=tuple(replace(block, name=names.get(block.name, block.name)) for block in network.blocks),
        subapplications=tuple(replace(sub, name=names.get(sub.name, sub.name)) for sub in network.subapplications),
        events=renamed(network.events),
        data=renamed(network.data),
        adapters=renamed(network.adapters),
    )


def left_out(system: System) -> tuple[str, ...]:
    """What is drawn in applications and runs nowhere: blocks that are mapped to no resource, and their connections.

    4diac IDE does not deploy them either. Each line begins with file and line. Raises FunctionBlockError as
    `places_of`.
    """
    places = places_of(system)
    file = system.header.file
    said = []
    for application in system.applications:
        network, here = application.network, places.get(application.name, {})
        elements = _elements(network)
        missing = [element for element in elements if element.name not in here]
        if missing and len(missing) == len(elements):
            text = f"application {application.name}, as none of its {len(elements)} blocks is mapped to a resource"
            said.append(f"{file}:{application.line}: {text}")
            continue
        said += [
            f"{file}:{element.line}: block {element.name} of {application.name}, as it is mapped to no resource"
            for element in missing
        ]
        for connection in (*network.events, *network.data, *network.adapters):
            ends = [end.rpartition(".")[0] for end in (connection.source, connection.destination)]
            unplaced = [block for block in ends if block not in here]
            if len(unplaced) == 1:
                name = f"{file}:{connection.line}: {connection.source} -> {connection.destination}"
                said.append(f"{name}, as {unplaced[0]} is mapped to no resource")
    return tuple(said)


def places_of(system: System) -> dict[str, dict[str, str]]:
    """For every application the resource, `DEVICE.RESOURCE`, of each of its blocks that is mapped.

    Raises:
        FunctionBlockError: a mapping of or to something unknown; names file and line.
    """
    for error in wrong_mappings(system).values():
        raise error
    places: dict[str, dict[str, str]] = {}
    for mapping in system.mappings:
        application, _, element = mapping.source.partition(".")
        places.setdefault(application, {})[element] = _destination(mapping)[0]
    return places


def wrong_mappings(system: System) -> dict[Mapped, FunctionBlockError]:
    """The mappings of a system of or to something unknown, and what is wrong with each."""
    elements = {
        f"{application.name}.{element.name}"
        for application in system.applications
        for element in _elements(application.network)
    }
    resources = [f"{d.name}.{r.name}" for d in system.devices for r in d.resources]
    wrong: dict[Mapped, FunctionBlockError] = {}
    first: dict[str, Mapped] = {}
    for mapping in system.mappings:
        before = first.setdefault(mapping.source, mapping)
        problem = ""
        if mapping.source not in elements:
            valid = choices(sorted(elements)) if elements else "a block of an application, and there is none"
            problem = f"mapping of unknown block {mapping.source!r}: expected {valid}"
        elif _destination(mapping)[0] not in resources:
            valid = choices(resources) if resources else "a resource of a device, and there is none"
            problem = f"mapping to unknown resource {mapping.destination!r}: expected {valid}"
        elif _destination(before)[0] != _destination(mapping)[0]:
            place, line = _destination(before)[0], before.line
            problem = (
                f"{mapping.source} is mapped to {place} already, in line {line}: expected one resource for a block"
            )
        if problem:
            wrong[mapping] = FunctionBlockError(problem, system.header.file, mapping.line)
    return wrong


def _destination(mapping: Mapped) -> tuple[str, str]:
    """The resource that a mapping names, and the block's copy there, if it names one."""
    device, _, rest = mapping.destination.partition(".")
    resource, _, copy = rest.partition(".")
    return f"{device}.{resource}", copy


def _elements(network: FBNetwork) -> list[Block | SubApplication]:
    return [*network.blocks, *network.subapplications]


def _unique(connections: list[Connection]) -> list[Connection]:
    """Without the copies of application connections that some versions of 4diac also write into the resource."""
    seen: dict[tuple[str, str], Connection] = {}
    for connection in connections:
        seen.setdefault((connection.source, connection.destination), connection)
    return list(seen.values())
