"""Connects the blocks of a resource: which entries of the queue an event of a block leads to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

from iec61499.runtime.entries import Entries, EntryGenerator, Member, is_forced, port_name
from iec61499.runtime.linking.netlist import Netlist, Terminal
from iec61499.runtime.operation import ObservedEvent, Operation, QueueEntry


class Wiring:
    """Connects the blocks of a netlist, and then those of others, of which only what changes is generated again.

    Args:
        extend: appends entries to the resource's queue.
    """

    def __init__(self, extend: Callable[[Any], None]) -> None:
        self._extend = extend
        self._netlist = Netlist()
        self._operation = Operation()
        self._blocks: dict[int, Entries] = {}

    def connect(self, netlist: Netlist, members: Mapping[int, Member], operation: Operation) -> dict[QueueEntry, str]:
        """Connects the blocks; returns the queue entries, each with the event that it delivers (`BLOCK.EVENT`).

        Args:
            netlist: a network without generic types, whose connections fit; a number stands for the same node as
                in the netlist before.
            members: the blocks of the nodes, by their numbers.
            operation: what is stopped, forced and observed.
        """
        generator = EntryGenerator(netlist, members, self._extend, operation)
        stale = self._stale(netlist, members, operation)
        blocks = {
            number: generator.entries(number, self._blocks.get(number)) if number in stale else self._blocks[number]
            for number in netlist.nodes
        }
        names = _Connections(netlist, blocks, operation).connect()
        self._netlist, self._operation, self._blocks = netlist, operation, blocks
        return names

    def _stale(self, netlist: Netlist, members: Mapping[int, Member], operation: Operation) -> set[int]:
        """The numbers of the nodes whose entries have to be generated."""
        before = self._netlist
        is_other = (operation.forced, operation.is_passive) != (self._operation.forced, self._operation.is_passive)
        if is_other or _shares(before) or _shares(netlist):
            return set(netlist.nodes)
        stale = {number for number, member in members.items() if self._is_other(number, member)}
        stale |= {port.node for port in before.data.keys() - netlist.data.keys()}
        others = frozenset(stale)
        if before.data != netlist.data or not others.isdisjoint(before.nodes):
            for port, wire in netlist.data.items():
                if wire.source.node in others or before.data.get(port) != wire:
                    stale.add(port.node)
        return stale & netlist.nodes.keys()

    def _is_other(self, number: int, member: Member) -> bool:
        known = self._blocks.get(number)
        return known is None or known.member.instance is not member.instance


def _shares(netlist: Netlist) -> bool:
    """Whether a VAR_IN_OUT is connected, which stands for a variable that may be several blocks away."""
    in_outs = {number for number, node in netlist.nodes.items() if node.interface.in_outs}
    return bool(in_outs) and any(port.node in in_outs for port in netlist.data)


class _Connections:
    """Lets the events of blocks lead to the entries of others."""

    def __init__(self, netlist: Netlist, blocks: Mapping[int, Entries], operation: Operation) -> None:
        self._netlist = netlist
        self._blocks = blocks
        self._operation = operation
        self._observers = operation.all_observers()
        self._entries = dict(chain.from_iterable(block.entries.items() for block in blocks.values()))

    def connect(self) -> dict[QueueEntry, str]:
        """Connects them; returns all entries, with the events that they deliver."""
        for observer in self._observers:
            for port, entry in self._entries.items():
                if not port.inner:
                    self._entries[port] = observer.delivering(self._observed(port), entry)
        events = chain.from_iterable(block.names for block in self._blocks.values())
        names = dict(zip(self._entries.values(), events, strict=True))
        targets: dict[Terminal, list[QueueEntry]] = {}
        stopped = self._stopped()
        for wire in self._netlist.events:
            if wire.destination.inner or wire.destination.node not in stopped:
                targets.setdefault(wire.source, []).append(self._entries[wire.destination])
        if self._observers:
            names |= self._observe_outputs(targets)
        for block in self._blocks.values():
            block.lead(targets)
        return names

    def _observe_outputs(self, targets: dict[Terminal, list[QueueEntry]]) -> dict[QueueEntry, str]:
        """Lets observers see the events of outputs first; returns what they do then, with the names of the events."""
        observing = {}
        for number, node in self._netlist.nodes.items():
            for event in node.interface.event_outputs:
                port = Terminal(number, event.name)
                for observer in self._observers:
                    entry = observer.issued(self._observed(port, event.with_variables))
                    if entry is not None:
                        targets.setdefault(port, []).insert(0, entry)
                        observing[entry] = port_name(self._netlist, port)
        return observing

    def _observed(self, port: Terminal, published: Sequence[str] | None = None) -> ObservedEvent:
        """An event input, or an event output that publishes variables."""
        interface = self._netlist.nodes[port.node].interface
        if published is None:
            event = next(event for event in interface.event_inputs if event.name == port.name)
            names = [name for name in event.with_variables if self._is_sampled(Terminal(port.node, name))]
            variables = tuple(variable for variable in interface.inputs if variable.name in names)
        else:
            variables = tuple(variable for variable in interface.outputs if variable.name in published)
        member = self._blocks[port.node].member
        return ObservedEvent(member.instance, member.kind.block, port.name, variables)

    def _is_sampled(self, port: Terminal) -> bool:
        return port in self._netlist.data and not is_forced(self._netlist, port, self._operation)

    def _stopped(self) -> frozenset[int]:
        """The numbers of the nodes that get no events."""
        if not self._operation.stopped:
            return frozenset()
        return frozenset(n for n, node in self._netlist.nodes.items() if self._operation.stops(node.name))
