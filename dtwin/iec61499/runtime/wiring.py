"""Generates the queue entries of a network: one Python function without arguments for every event input.

An entry samples the block's inputs that are WITH the event, as straight attribute copies from the blocks they are
connected to, and executes the block. Composites have entries for their outer event inputs (sample, then queue the
entries inside) and for their inner event outputs (publish, then queue the entries outside).

Before its first publication an output is seen with its initial value, as IEC 61499-1 has it (4diac FORTE 2.0 shows
the default of the type instead). A variable in the WITH of no event is never sampled or published, as in FORTE.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import CodeType, MethodType
from typing import Any

from dtwin.iec61499 import model
from dtwin.iec61499.runtime.compile import CompiledType
from dtwin.iec61499.runtime.generic_ports import variable_at
from dtwin.iec61499.runtime.netlist import Netlist, Node, Terminal
from dtwin.iec61499.runtime.operation import ObservedEvent, Operation, QueueEntry
from dtwin.iec61499.st.python.expressions import python_name, wiring_name
from dtwin.iec61499.types import ArrayType, DataType, ElementaryType, StructType


def queue_entries(
    netlist: Netlist,
    types: Sequence[CompiledType],
    instances: Sequence[Any],
    extend: Callable[[Any], None],
    operation: Operation,
    codes: dict[str, CodeType],
) -> dict[QueueEntry, str]:
    """Connects the instances; returns the queue entries, each with the event that it delivers (`BLOCK.EVENT`).

    Args:
        netlist: a network without generic types, whose connections fit.
        types: the nodes' compiled types, in the order of the nodes.
        instances: the nodes' instances, in the order of the nodes.
        extend: appends entries to the resource's queue.
        operation: what is stopped, forced and observed.
        codes: what was compiled for the network before, by its text; afterwards what was for this one.
    """
    return _Wiring(netlist, types, instances, extend, operation).entries(codes)


class _Wiring:
    def __init__(
        self,
        netlist: Netlist,
        types: Sequence[CompiledType],
        instances: Sequence[Any],
        extend: Callable[[Any], None],
        operation: Operation,
    ) -> None:
        self._netlist = netlist
        self._operation = operation
        self._types = types
        self._instances = instances
        self._space: dict[str, Any] = {"extend": extend}
        self._lines: list[str] = []
        self._functions: dict[Terminal, str] = {}
        self._entries: dict[Terminal, QueueEntry] = {}
        self._observing: dict[QueueEntry, str] = {}

    def entries(self, codes: dict[str, CodeType]) -> dict[QueueEntry, str]:
        compiled = {}
        for number, instance in enumerate(self._instances):
            self._space[f"b{number}"] = instance
        for number, node in enumerate(self._netlist.nodes):
            for event in node.interface.event_inputs:
                self._input_entry(Terminal(number, event.name), node, event)
            if isinstance(node.type, model.CompositeFBType):
                for event in node.interface.event_outputs:
                    self._composite_output(Terminal(number, event.name, inner=True), event)
            text = "\n".join(self._lines)
            self._lines.clear()
            compiled[text] = codes.get(text) or compile(text, "<wiring>", "exec")
            exec(compiled[text], self._space)
        codes.clear()
        codes.update(compiled)
        for port, function in self._functions.items():
            self._entries[port] = self._space[function]
        for observer in self._operation.all_observers():
            for port, entry in self._entries.items():
                if not port.inner:
                    self._entries[port] = observer.delivering(self._observed(port), entry)
        self._connect()
        return {entry: self._name(port) for port, entry in self._entries.items()} | self._observing

    def _observed(self, port: Terminal, published: Sequence[str] | None = None) -> ObservedEvent:
        """An event input, or an event output that publishes variables."""
        interface = self._netlist.nodes[port.node].interface
        if published is None:
            event = next(event for event in interface.event_inputs if event.name == port.name)
            names = [name for name in event.with_variables if self._is_sampled(Terminal(port.node, name))]
            variables = tuple(variable for variable in interface.inputs if variable.name in names)
        else:
            variables = tuple(variable for variable in interface.outputs if variable.name in published)
        return ObservedEvent(self._instances[port.node], self._types[port.node].block, port.name, variables)

    def _is_sampled(self, port: Terminal) -> bool:
        return port in self._netlist.data and not self._is_forced(port)

    def _input_entry(self, port: Terminal, node: Node, event: model.EventPort) -> None:
        samples = self._copies(event.with_variables, lambda name: Terminal(port.node, name))
        if isinstance(node.type, model.CompositeFBType):
            self._function(port, [*samples, f"extend({self._targets(Terminal(port.node, port.name, inner=True))})"])
            return
        shared = self._shared(port.node, node)
        handler = self._types[port.node].handlers[event.name]
        if self._operation.is_passive and isinstance(node.type, model.ServiceInterfaceFBType):
            handler = _sample_only
        if samples or shared:
            name = f"execute{_suffix(port)}"
            self._space[name] = handler
            taken = [f"{own} = {root}" for own, root in shared]
            given = [f"{root} = {own}" for own, root in shared]
            self._function(port, [*samples, *taken, f"{name}(b{port.node})", *given])
        else:
            self._entries[port] = MethodType(handler, self._instances[port.node])

    def _shared(self, number: int, node: Node) -> list[tuple[str, str]]:
        """Every VAR_IN_OUT of a block that is connected, and the variable that it stands for while the block runs."""
        ports = [Terminal(number, name) for name in node.interface.in_outs]
        return [(_attribute(port), _attribute(self._root(port))) for port in ports if port in self._netlist.data]

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
        self._function(port, [*publications, f"extend({self._targets(Terminal(port.node, port.name))})"])

    def _function(self, port: Terminal, lines: list[str]) -> None:
        name = f"deliver{_suffix(port)}"
        self._lines += [f"def {name}():", *("    " + line for line in lines)]
        self._functions[port] = name

    def _targets(self, source: Terminal) -> str:
        """The global name of the entries that an event of a composite queues."""
        return f"to{_suffix(source)}"

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
                    python_name(source.name) if source.inner else self._types[source.node].published[source.name]
                )
                value = self._converted(
                    self._forced(source) or f"b{source.node}.{attribute}",
                    variable_at(self._netlist.nodes[source.node], source.name).type,
                    variable_at(self._netlist.nodes[port.node], name).type,
                )
                lines.append(f"b{port.node}.{python_name(name)} = {value}")
        return lines

    def _name(self, port: Terminal) -> str:
        return f"{self._netlist.nodes[port.node].name}.{port.name}"

    def _forced(self, source: Terminal) -> str:
        """The global name of the value that a port is forced to, "" if it is not."""
        if not self._is_forced(source):
            return ""
        constant = f"forced{_suffix(source)}"
        self._space[constant] = self._operation.forced[self._name(source)]
        return constant

    def _is_forced(self, port: Terminal) -> bool:
        return bool(self._operation.forced) and self._name(port) in self._operation.forced

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

    def _is_stopped(self, port: Terminal) -> bool:
        return self._operation.stops(self._netlist.nodes[port.node].name)

    def _connect(self) -> None:
        targets: dict[Terminal, list[QueueEntry]] = {}
        for wire in self._netlist.events:
            if wire.destination.inner or not self._is_stopped(wire.destination):
                targets.setdefault(wire.source, []).append(self._entries[wire.destination])
        for number, node in enumerate(self._netlist.nodes):
            composite = isinstance(node.type, model.CompositeFBType)
            for event in node.interface.event_outputs:
                port = Terminal(number, event.name)
                for observer in self._operation.all_observers():
                    entry = observer.issued(self._observed(port, event.with_variables))
                    if entry is None:
                        continue
                    targets.setdefault(port, []).insert(0, entry)
                    self._observing[entry] = self._name(port)
                if composite:
                    self._space[self._targets(port)] = tuple(targets.get(port, ()))
                else:
                    setattr(self._instances[number], wiring_name(event.name), tuple(targets.get(port, ())))
            for event in node.interface.event_inputs if composite else ():
                port = Terminal(number, event.name, inner=True)
                self._space[self._targets(port)] = tuple(targets.get(port, ()))


def _suffix(port: Terminal) -> str:
    """What names of a port end with; it stays the same for a node that others are put behind."""
    return f"{port.node}_{'inner' if port.inner else 'outer'}_{port.name.replace('.', '__')}"


def _attribute(port: Terminal) -> str:
    return f"b{port.node}.{python_name(port.name)}"


def _sample_only(instance: Any) -> None:
    """What a passive block does."""


def checked_value(value: Any, data_type: DataType, where: str) -> Any:
    """A Python value for a variable of that type.

    Raises:
        ValueError: another kind of value, or out of range.
    """
    if isinstance(data_type, ArrayType):
        if not isinstance(value, list | tuple) or len(value) != data_type.length:
            raise ValueError(f"{where}: expected {data_type.length} values for {data_type}, got {value!r}")
        return [checked_value(item, data_type.element, where) for item in value]
    if isinstance(data_type, StructType):
        if not isinstance(value, list | tuple) or len(value) != len(data_type.members):
            raise ValueError(f"{where}: expected {len(data_type.members)} values for {data_type}, got {value!r}")
        return [
            checked_value(item, m.type, f"{where}.{m.name}") for item, m in zip(value, data_type.members, strict=True)
        ]
    kinds: dict[str, tuple[type, ...]] = {"char": (str,), "bool": (bool,), "real": (float, int), "string": (str,)}
    if not isinstance(value, kinds.get(data_type.kind, (int,))) or (
        isinstance(value, bool) and data_type.kind != "bool"
    ):
        raise ValueError(f"{where}: expected a value of {data_type}, got {value!r}")
    wrapped = data_type.wrap(value)
    if isinstance(wrapped, int) and wrapped != value:
        raise ValueError(f"{where}: expected {data_type.minimum} to {data_type.maximum} for {data_type}, got {value}")
    return wrapped
