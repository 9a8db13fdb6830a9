"""Generates the queue entries of a network: one Python function without arguments for every event input.

An entry samples the block's inputs that are WITH the event, as straight attribute copies from the blocks they are
connected to, and executes the block. Composites have entries for their outer event inputs (sample, then queue the
entries inside) and for their inner event outputs (publish, then queue the entries outside).

Before its first publication an output is seen with its initial value, as IEC 61499-1 has it (4diac FORTE 2.0 shows
the default of the type instead). A variable in the WITH of no event is never sampled or published, as in FORTE.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import CodeType, MethodType
from typing import Any

from iec61499 import model
from iec61499.runtime.compile import CompiledType
from iec61499.runtime.linking.generic_ports import variable_at
from iec61499.runtime.linking.netlist import Netlist, Node, Terminal
from iec61499.runtime.operation import Operation, QueueEntry
from iec61499.st.python.expressions import python_name, wiring_name
from iec61499.types import ElementaryType


@dataclass(frozen=True, slots=True)
class Member:
    """A block that runs: its instance, and the type that it is an instance of."""

    kind: CompiledType
    instance: Any


@dataclass(frozen=True, slots=True)
class Entries:
    """The queue entries of one block.

    Attributes:
        member: the block.
        text: what was generated for them.
        code: what it was compiled to.
        space: the global names of the code; beside instances and handlers the entries that a composite queues.
        entries: the queue entries by the port that they deliver an event to, of a composite also from inside.
        names: the events that they deliver, `BLOCK.EVENT`, in their order.
        outputs: the ports that an event leaves by, and the name under which the block has the entries that it queues.
    """

    member: Member
    text: str
    code: CodeType
    space: dict[str, Any]
    entries: dict[Terminal, QueueEntry]
    names: tuple[str, ...]
    outputs: dict[Terminal, str]

    def lead(self, targets: Mapping[Terminal, Sequence[QueueEntry]]) -> None:
        """Lets the events that leave the block queue entries."""
        if isinstance(self.member.kind.block, model.CompositeFBType):
            for port, name in self.outputs.items():
                self.space[name] = tuple(targets.get(port, ()))
        else:
            for port, name in self.outputs.items():
                setattr(self.member.instance, name, tuple(targets.get(port, ())))


class EntryGenerator:
    """Generates the queue entries of blocks.

    Args:
        netlist: a network without generic types, whose connections fit.
        members: the blocks of the nodes, by their numbers.
        extend: appends entries to the resource's queue.
        operation: what is forced, and whether service interface blocks are passive.
    """

    def __init__(
        self,
        netlist: Netlist,
        members: Mapping[int, Member],
        extend: Callable[[Any], None],
        operation: Operation,
    ) -> None:
        self._netlist = netlist
        self._members = members
        self._extend = extend
        self._operation = operation
        self._space: dict[str, Any] = {}
        self._lines: list[str] = []
        self._functions: dict[Terminal, str] = {}
        self._entries: dict[Terminal, QueueEntry] = {}

    def entries(self, number: int, known: Entries | None) -> Entries:
        """The queue entries of the block of a number; `known` are those that it had."""
        self._space, self._lines = {"extend": self._extend}, []
        self._functions, self._entries = {}, {}
        node = self._netlist.nodes[number]
        for event in node.interface.event_inputs:
            self._input_entry(Terminal(number, event.name), node, event)
        if isinstance(node.type, model.CompositeFBType):
            for event in node.interface.event_outputs:
                self._composite_output(Terminal(number, event.name, inner=True), event)
        text = "\n".join(self._lines)
        code = known.code if known is not None and known.text == text else compile(text, "<wiring>", "exec")
        exec(code, self._space)
        entries = self._entries | {port: self._space[function] for port, function in self._functions.items()}
        names = tuple(f"{node.name}.{port.name}" for port in entries)
        return Entries(self._members[number], text, code, self._space, entries, names, _outputs(number, node))

    def _block(self, number: int) -> str:
        """The global name of the instance of a number."""
        name = f"b{number}"
        self._space[name] = self._members[number].instance
        return name

    def _input_entry(self, port: Terminal, node: Node, event: model.EventPort) -> None:
        samples = self._copies(event.with_variables, lambda name: Terminal(port.node, name))
        if isinstance(node.type, model.CompositeFBType):
            self._function(port, [*samples, f"extend({_targets_name(Terminal(port.node, port.name, inner=True))})"])
            return
        shared = self._shared(port.node, node)
        handler = self._members[port.node].kind.handlers[event.name]
        if self._operation.is_passive and isinstance(node.type, model.ServiceInterfaceFBType):
            handler = _sample_only
        if samples or shared:
            name = f"execute{_suffix(port)}"
            self._space[name] = handler
            taken = [f"{own} = {root}" for own, root in shared]
            given = [f"{root} = {own}" for own, root in shared]
            self._function(port, [*samples, *taken, f"{name}({self._block(port.node)})", *given])
        else:
            self._entries[port] = MethodType(handler, self._members[port.node].instance)

    def _attribute(self, port: Terminal) -> str:
        return f"{self._block(port.node)}.{python_name(port.name)}"

    def _shared(self, number: int, node: Node) -> list[tuple[str, str]]:
        """Every VAR_IN_OUT of a block that is connected, and the variable that it stands for while the block runs."""
        ports = [Terminal(number, name) for name in node.interface.in_outs]
        return [
            (self._attribute(port), self._attribute(self._root(port))) for port in ports if port in self._netlist.data
        ]

    def _root(self, port: Terminal) -> Terminal:
        """The variable that a VAR_IN_OUT stands for: the first of those that are connected one behind the other."""
        port = Terminal(port.node, port.name)
        passed = {port}
        while (wire := self._netlist.data.get(port)) is not None:
            port = Terminal(wire.source.node, wire.source.name)
            if port in passed:
                break
            passed.add(port)
        return port

    def _composite_output(self, port: Terminal, event: model.EventPort) -> None:
        publications = self._copies(event.with_variables, lambda name: Terminal(port.node, name, inner=True))
        self._function(port, [*publications, f"extend({_targets_name(Terminal(port.node, port.name))})"])

    def _function(self, port: Terminal, lines: list[str]) -> None:
        name = f"deliver{_suffix(port)}"
        self._lines += [f"def {name}():", *("    " + line for line in lines)]
        self._functions[port] = name

    def _copies(self, names: Sequence[str], destination: Callable[[str], Terminal]) -> list[str]:
        """Assignments to data inputs, or to outputs of a composite, from what they are connected to."""
        lines = []
        for name in names:
            port = destination(name)
            wire = self._netlist.data.get(port)
            if wire is not None and not self._is_forced(port):
                source = wire.source
                if source.name in self._netlist.nodes[source.node].interface.in_outs:
                    source = self._root(source)
                attribute = (
                    python_name(source.name)
                    if source.inner
                    else self._members[source.node].kind.published[source.name]
                )
                value = self._converted(
                    self._forced(source) or f"{self._block(source.node)}.{attribute}",
                    variable_at(self._netlist.nodes[source.node], source.name).type,
                    variable_at(self._netlist.nodes[port.node], name).type,
                )
                lines.append(f"{self._block(port.node)}.{python_name(name)} = {value}")
        return lines

    def _forced(self, source: Terminal) -> str:
        """The global name of the value that a port is forced to, "" if it is not."""
        if not self._is_forced(source):
            return ""
        constant = f"forced{_suffix(source)}"
        self._space[constant] = self._operation.forced[port_name(self._netlist, source)]
        return constant

    def _is_forced(self, port: Terminal) -> bool:
        return is_forced(self._netlist, port, self._operation)

    def _converted(self, value: str, source: model.VariableType, destination: model.VariableType) -> str:
        """The value with the implicit widening of the connection; most keep the Python value."""
        if (
            source == destination
            or not isinstance(destination, ElementaryType)
            or not isinstance(source, ElementaryType)
        ):
            return value
        if destination.kind == "real" and source.kind != "real":
            return f"{value} + 0.0"
        return f"{value} + 0" if source.kind == "bool" else value


def _outputs(number: int, node: Node) -> dict[Terminal, str]:
    leaving = [Terminal(number, event.name) for event in node.interface.event_outputs]
    if not isinstance(node.type, model.CompositeFBType):
        return {port: wiring_name(port.name) for port in leaving}
    leaving += [Terminal(number, event.name, inner=True) for event in node.interface.event_inputs]
    return {port: _targets_name(port) for port in leaving}


def port_name(netlist: Netlist, port: Terminal) -> str:
    """`BLOCK.PORT`."""
    return f"{netlist.nodes[port.node].name}.{port.name}"


def is_forced(netlist: Netlist, port: Terminal, operation: Operation) -> bool:
    """Whether a data port has a value that stays."""
    return bool(operation.forced) and port_name(netlist, port) in operation.forced


def _targets_name(source: Terminal) -> str:
    """The global name, in the space of a composite, of the entries that an event of it queues."""
    return f"to{_suffix(source)}"


def _suffix(port: Terminal) -> str:
    """What names of a port end with."""
    return f"{port.node}_{'inner' if port.inner else 'outer'}_{port.name.replace('.', '__')}"


def _sample_only(instance: Any) -> None:
    """What a passive block does."""
