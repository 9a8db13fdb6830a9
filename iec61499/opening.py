"""Subapplications whose blocks are mapped one by one: their blocks become blocks of the application.

A subapplication is a way to draw. 4diac IDE lets a person map each block inside one that has no type, by
`APPLICATION.SUBAPPLICATION.BLOCK`. Here such a subapplication is laid open: its blocks are called
`SUBAPPLICATION.BLOCK`, and what crosses its border is one connection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from iec61499.model import Block, Connection, FBNetwork, Parameter, SubApplication, System


def opened(system: System) -> System:
    """The system, with every subapplication without a type laid open that has a block which is mapped by itself."""
    sources = [mapping.source for mapping in system.mappings]
    applications = tuple(
        replace(application, network=_opened(application.network, _inside(application.name, sources)))
        for application in system.applications
    )
    return replace(system, applications=applications)


def _inside(owner: str, paths: Sequence[str]) -> list[str]:
    """The paths that lead into an element, from there."""
    return [path.removeprefix(f"{owner}.") for path in paths if path.startswith(f"{owner}.")]


def _opened(network: FBNetwork, paths: Sequence[str]) -> FBNetwork:
    for sub in network.subapplications:
        inner = _inside(sub.name, paths)
        if inner and not sub.type_name and sub.name not in paths:
            network = _laid_open(network, replace(sub, network=_opened(sub.network, inner)))
    return network


def _laid_open(network: FBNetwork, sub: SubApplication) -> FBNetwork:
    def own(connections: tuple[Connection, ...]) -> tuple[Connection, ...]:
        return tuple(
            replace(c, source=f"{sub.name}.{c.source}", destination=f"{sub.name}.{c.destination}")
            for c in connections
        )

    inside = sub.network
    data = (*network.data, *own(inside.data))
    border = {f"{sub.name}.{port}" for port in (*sub.interface.names(), *(a.name for a in sub.interface.adapters))}
    blocks = [replace(block, name=f"{sub.name}.{block.name}") for block in inside.blocks]
    return replace(
        network,
        blocks=(*network.blocks, *_with_values(blocks, sub, data)),
        subapplications=(
            *(other for other in network.subapplications if other.name != sub.name),
            *(replace(other, name=f"{sub.name}.{other.name}") for other in inside.subapplications),
        ),
        events=_joined((*network.events, *own(inside.events)), border),
        data=_joined(data, border),
        adapters=_joined((*network.adapters, *own(inside.adapters)), border),
    )


def _joined(connections: tuple[Connection, ...], border: set[str]) -> tuple[Connection, ...]:
    """The connections from block to block, given those that begin or end at the border."""
    onward: dict[str, list[Connection]] = {}
    for connection in connections:
        onward.setdefault(connection.source, []).append(connection)

    def ends(connection: Connection, seen: tuple[str, ...] = ()) -> list[str]:
        here = connection.destination
        if here not in border:
            return [here]
        return [end for c in onward.get(here, ()) if here not in seen for end in ends(c, (*seen, here))]

    return tuple(
        replace(connection, destination=end)
        for connection in connections
        if connection.source not in border
        for end in ends(connection)
    )


def _with_values(blocks: list[Block], sub: SubApplication, data: tuple[Connection, ...]) -> list[Block]:
    """The blocks with the values of those inputs of the subapplication that nothing is connected to."""
    connected = {connection.destination for connection in data}
    given = {variable.name: Parameter(variable.name, variable.initial) for variable in sub.interface.inputs}
    given |= {parameter.name: parameter for parameter in sub.parameters}
    values = {
        connection.destination: given[name]
        for name in given
        if given[name].value and f"{sub.name}.{name}" not in connected
        for connection in data
        if connection.source == f"{sub.name}.{name}"
    }
    return [
        replace(
            block,
            parameters=(
                *(p for p in block.parameters if f"{block.name}.{p.name}" not in values),
                *(
                    replace(value, name=end.rpartition(".")[2])
                    for end, value in values.items()
                    if end.rpartition(".")[0] == block.name
                ),
            ),
        )
        for block in blocks
    ]
