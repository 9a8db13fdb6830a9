"""Makes netlists that can run of networks, one after the other."""

from __future__ import annotations

from iec61499 import model
from iec61499.runtime.linking.flattening import Flattener
from iec61499.runtime.linking.generic_ports import check_types, generic_nodes, generic_wires, resolve
from iec61499.runtime.linking.netlist import Finder, Netlist, Node, Terminal, Wire
from iec61499.runtime.linking.typed_events import connect_triggers


def link(network: model.FBNetwork, find: Finder) -> Netlist:
    """The netlist of one network; its nodes have the numbers from 0 on. Raises as `Linker.link` does."""
    return Linker(find).link(network).numbered()


class Linker:
    """Lays networks out flat, one after the other, and gives their generic ports types.

    What the next network has in common with the one before is not done again: its nodes and wires are the same.

    Args:
        find: finds the types.
    """

    def __init__(self, find: Finder) -> None:
        self._flattener = Flattener(find)
        self._resolved: tuple[list[Node], list[Wire]] = [], []
        self._checked: dict[Terminal, Wire] = {}

    def link(self, network: model.FBNetwork) -> Netlist:
        """The netlist of a network, without generic types.

        Raises:
            FunctionBlockError: the network is wrong, as `Flattener.flatten`, `resolve` and `check_types` tell.
        """
        netlist = self._flattener.flatten(network)
        connect_triggers(netlist)
        generic = list(generic_nodes(netlist).values()), generic_wires(netlist)
        checked = self._checked
        if generic != self._resolved:
            self._resolved, checked = ([], []), {}
            resolve(netlist)
        check_types(netlist, [wire for port, wire in netlist.data.items() if checked.get(port) is not wire])
        self._resolved, self._checked = generic, netlist.data
        return netlist
