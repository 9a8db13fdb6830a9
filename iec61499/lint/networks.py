"""Rules for networks: events that do not come, and events that come back."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.lint.findings import Finding

Find = Callable[[str], model.LibraryElement]


def network_findings(
    network: model.FBNetwork, find: Find, others: tuple[model.Connection, ...] = ()
) -> Iterator[Finding]:
    """What is hardly meant in a network.

    Args:
        network: the blocks and their connections.
        find: finds a type by its name.
        others: connections of other networks to these blocks, such as those of resources to an application.
    """
    types: dict[str, model.LibraryElement] = {}
    for block in network.blocks:
        try:
            types[block.name] = find(block.type_name)
        except FunctionBlockError:
            continue
    fed = _fed(network, others)
    plugged = {end for c in (*network.adapters, *network.data) for end in (c.source, c.destination)}
    for block in network.blocks:
        kind = types.get(block.name)
        events = [e for e in kind.interface.event_inputs if e.type == "Event"] if kind is not None else []
        if kind is None or not events or not _is_passive(kind) or block.name in fed:
            continue
        if any(f"{block.name}.{port.name}" in plugged for port in kind.interface.adapters):
            continue
        message = f"no event is connected to {block.name} ({block.type_name}): it never does anything"
        yield Finding(network.file, block.line, 0, "never-triggered", message)
    yield from _duplicates(network)
    yield from _loops(network, types)
    for sub in network.subapplications:
        yield from network_findings(sub.network, find)


def _duplicates(network: model.FBNetwork) -> Iterator[Finding]:
    """Connections of data that are drawn twice."""
    lines: dict[tuple[str, str], int] = {}
    for connection in network.data:
        ends = connection.source, connection.destination
        if ends in lines:
            message = f"{ends[0]} -> {ends[1]} is drawn in line {lines[ends]}, too"
            yield Finding(network.file, connection.line, 0, "duplicate-connection", message)
        lines.setdefault(ends, connection.line)


def _fed(network: model.FBNetwork, others: tuple[model.Connection, ...]) -> set[str]:
    """The blocks that an event is connected to."""
    found = set()
    for connection in (*network.events, *others):
        parts = connection.destination.split(".")
        found |= set(parts[:-1])
    return found


def _is_passive(kind: model.LibraryElement) -> bool:
    """Whether a block does something only when an event comes: services may do so by themselves."""
    return isinstance(kind, model.BasicFBType | model.SimpleFBType | model.CompositeFBType)


def _loops(network: model.FBNetwork, types: dict[str, model.LibraryElement]) -> Iterator[Finding]:
    """Circles of basic and simple blocks, each of which answers at once."""
    onward: dict[str, list[tuple[str, model.Connection]]] = {}
    for connection in network.events:
        source, destination = (end.rpartition(".")[0] for end in (connection.source, connection.destination))
        if all(isinstance(types.get(end), model.BasicFBType | model.SimpleFBType) for end in (source, destination)):
            onward.setdefault(source, []).append((destination, connection))
    told: set[str] = set()
    for start in onward:
        if start in told:
            continue
        path = _circle(start, onward)
        if path:
            told |= {*path}
            line = next(c.line for destination, c in onward[path[-1]] if destination == start)
            yield Finding(network.file, line, 0, "event-loop", f"{' -> '.join([*path, start])} is a loop of events")


def _circle(start: str, onward: dict[str, list[tuple[str, model.Connection]]]) -> list[str]:
    """A shortest way from a block back to it."""
    ways = [[start]]
    seen: set[str] = set()
    while ways:
        way = ways.pop(0)
        for destination, _ in onward.get(way[-1], ()):
            if destination == start:
                return way
            if destination not in seen:
                seen.add(destination)
                ways.append([*way, destination])
    return []
