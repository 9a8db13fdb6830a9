"""What of a system runs: the network of a resource with the application blocks mapped to it, and other parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dtwin.errors import FunctionBlockError, choices
from dtwin.iec61499.model import (
    Block,
    Connection,
    DeviceDeclaration,
    FBNetwork,
    ResourceDeclaration,
    SubApplication,
    System,
)


def resource_network(system: System, name: str = "") -> FBNetwork:
    """The network that runs on a resource.

    Application blocks lose the application's name (`App.PLANNER` is `PLANNER`), which connections of the
    resource may still use. The resource's E_RESTART block `START`, which 4diac does not write, is added.

    Args:
        system: the system configuration.
        name: `DEVICE.RESOURCE`, or the resource's name alone; may be left out when there is only one.

    Raises:
        FunctionBlockError: unknown or ambiguous resource, a mapping to or of something unknown, two blocks of
            one name, or a connection between blocks on different resources.
    """
    device, resource = _find_resource(system, name)
    return _ResourceNetwork(system, f"{device.name}.{resource.name}", resource).build()


def management_address(device: DeviceDeclaration) -> str:
    """What a device says of where it is managed, such as `localhost:61499`; "" when it says nothing."""
    given = next((p.value for p in device.parameters if p.name == "MGR_ID"), "")
    return given.strip("'\"")


def literal_of(value: float | str) -> str:
    """A number, truth value or text as a literal of IEC 61131-3; texts are words of letters and digits."""
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
        self.applications = {application.name for application in system.applications}

    def build(self) -> FBNetwork:
        mapped = self._mapped()
        blocks: list[Block] = []
        subapplications: list[SubApplication] = []
        events: list[Connection] = []
        data: list[Connection] = []
        adapters: list[Connection] = []
        for application in self.system.applications:
            here = mapped.get(application.name, set())
            network = application.network
            blocks += [block for block in network.blocks if block.name in here]
            subapplications += [sub for sub in network.subapplications if sub.name in here]
            events += self._inside(network.events, here, application.name)
            data += self._inside(network.data, here, application.name)
            adapters += self._inside(network.adapters, here, application.name)
        names = {block.name for block in blocks} | {sub.name for sub in subapplications}
        if len(names) < len(blocks) + len(subapplications):
            raise FunctionBlockError(
                f"two applications map blocks of one name to {self.full_name}", self.file, self.resource.line
            )
        own = self.resource.network
        blocks += [block for block in own.blocks if block.name not in names]
        subapplications += [sub for sub in own.subapplications if sub.name not in names]
        if all(block.name != "START" for block in blocks):
            blocks.insert(0, Block("START", "E_RESTART", line=self.resource.line))
        events = [self._plain(connection) for connection in own.events] + events
        data = [self._plain(connection) for connection in own.data] + data
        adapters = [self._plain(connection) for connection in own.adapters] + adapters
        return FBNetwork(
            tuple(blocks),
            tuple(subapplications),
            tuple(_unique(events)),
            tuple(_unique(data)),
            self.file,
            tuple(_unique(adapters)),
        )

    def _mapped(self) -> dict[str, set[str]]:
        return {
            application: {element for element, resource in places.items() if resource == self.full_name}
            for application, places in places_of(self.system).items()
        }

    def _inside(self, connections: tuple[Connection, ...], here: set[str], application: str) -> list[Connection]:
        inside = []
        for connection in connections:
            ends = [end.rpartition(".")[0] in here for end in (connection.source, connection.destination)]
            if all(ends):
                inside.append(connection)
            elif any(ends) and self._is_placed(application, connection):
                raise FunctionBlockError(
                    f"connection {connection.source} -> {connection.destination} of application {application} leaves "
                    f"resource {self.full_name}: expected both blocks mapped to it, or communication blocks between",
                    self.file,
                    connection.line,
                )
        return inside

    def _is_placed(self, application: str, connection: Connection) -> bool:
        places = places_of(self.system).get(application, {})
        return all(end.rpartition(".")[0] in places for end in (connection.source, connection.destination))

    def _plain(self, connection: Connection) -> Connection:
        return replace(
            connection, source=self._strip(connection.source), destination=self._strip(connection.destination)
        )

    def _strip(self, endpoint: str) -> str:
        first, _, rest = endpoint.partition(".")
        return rest if first in self.applications and "." in rest else endpoint


def unplaced_connections(system: System) -> tuple[str, ...]:
    """What connections of applications no resource has: one of their blocks is mapped to a resource, the other not.

    4diac IDE does not deploy them either. Raises FunctionBlockError as `places_of`.
    """
    places = places_of(system)
    said = []
    for application in system.applications:
        network, here = application.network, places.get(application.name, {})
        for connection in (*network.events, *network.data, *network.adapters):
            ends = [end.rpartition(".")[0] for end in (connection.source, connection.destination)]
            missing = [block for block in ends if block not in here]
            if len(missing) == 1:
                name = f"{system.header.file}:{connection.line}: {connection.source} -> {connection.destination}"
                said.append(f"{name}, as {missing[0]} is mapped to no resource")
    return tuple(said)


def places_of(system: System) -> dict[str, dict[str, str]]:
    """For every application the resource, `DEVICE.RESOURCE`, of each of its blocks that is mapped.

    Raises:
        FunctionBlockError: a mapping of or to something unknown; names file and line.
    """
    elements = {
        f"{application.name}.{element.name}"
        for application in system.applications
        for element in _elements(application.network)
    }
    resources = [f"{d.name}.{r.name}" for d in system.devices for r in d.resources]
    places: dict[str, dict[str, str]] = {}
    for mapping in system.mappings:
        if mapping.source not in elements:
            valid = choices(sorted(elements)) if elements else "a block of an application, and there is none"
            raise FunctionBlockError(
                f"mapping of unknown block {mapping.source!r}: expected {valid}", system.header.file, mapping.line
            )
        # older tools write the block behind the resource
        destination = ".".join(mapping.destination.split(".")[:2])
        if destination not in resources:
            raise FunctionBlockError(
                f"mapping to unknown resource {mapping.destination!r}: expected {choices(resources)}",
                system.header.file,
                mapping.line,
            )
        application, _, element = mapping.source.partition(".")
        places.setdefault(application, {})[element] = destination
    return places


def _elements(network: FBNetwork) -> list[Block | SubApplication]:
    return [*network.blocks, *network.subapplications]


def _unique(connections: list[Connection]) -> list[Connection]:
    """Without the copies of application connections that some versions of 4diac also write into the resource."""
    seen: dict[tuple[str, str], Connection] = {}
    for connection in connections:
        seen.setdefault((connection.source, connection.destination), connection)
    return list(seen.values())
