"""E_TRIG: an event at every input of one event type that nothing is connected to, as in 4diac FORTE 3.

The type is given by a literal, so that the events are connections of CNF like any others.
"""

from __future__ import annotations

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.runtime.linking.netlist import Netlist, Node, Terminal, Wire
from iec61499.standard.events import TRIGGER
from iec61499.types import STRING


def connect_triggers(netlist: Netlist) -> None:
    """Connects CNF of every E_TRIG with the inputs that it triggers, before its other connections.

    Those are in the order of the blocks; what is inside composite blocks is theirs.

    Raises:
        FunctionBlockError: the type of an E_TRIG is connected or no text.
    """
    triggers = [number for number, node in netlist.nodes.items() if node.type is TRIGGER]
    if not triggers:
        return
    composites = {f"{node.name}." for node in netlist.nodes.values() if isinstance(node.type, model.CompositeFBType)}
    connected = {wire.destination for wire in netlist.events}
    waiting: dict[str, list[Terminal]] = {}
    for number, node in netlist.nodes.items():
        if number not in triggers and not any(node.name.startswith(prefix) for prefix in composites):
            for event in node.interface.event_inputs:
                port = Terminal(number, event.name)
                if port not in connected:
                    waiting.setdefault(event.type, []).append(port)
    for number in triggers:
        node = netlist.nodes[number]
        ends = waiting.get(_event_type(netlist, number, node), ())
        wires = [Wire(Terminal(number, "CNF"), end, node.file, node.line) for end in ends]
        netlist.events[:0] = wires


def _event_type(netlist: Netlist, number: int, node: Node) -> str:
    port = node.variables["EVENTTYPE"]
    wire = netlist.data.get(Terminal(number, port.name))
    if wire is not None:
        raise FunctionBlockError(
            f"{node.name}.{port.name} is connected: expected a literal such as 'EInit'", wire.file, wire.line
        )
    given = node.parameters.get(port.name)
    text = given.value if given is not None else port.initial
    return str(model.literal(text, STRING, node.file, given.line if given is not None else node.line))
