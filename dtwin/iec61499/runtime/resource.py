"""A resource that executes a network: one queue of events, first in first out, and a clock that is told the time."""

from __future__ import annotations

import difflib
import heapq
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any, Final

from dtwin.errors import FunctionBlockError, choices
from dtwin.iec61499 import model
from dtwin.iec61499.library import Library
from dtwin.iec61499.runtime.communication import AttachedServer, CommunicationPort, Transport
from dtwin.iec61499.runtime.compile import CompiledType, compile_type
from dtwin.iec61499.runtime.generic_ports import check_types, resolve
from dtwin.iec61499.runtime.local_transport import LocalTransport
from dtwin.iec61499.runtime.netlist import Node, flatten
from dtwin.iec61499.runtime.wiring import QueueEntry, checked_value, queue_entries
from dtwin.iec61499.st.python.expressions import python_name
from dtwin.iec61499.types import DataType

ACTIVATION_LIMIT: Final = 100_000
"""Most events that may follow from one; more are taken for an endless loop."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of a resource between events: the values of all variables and charts, pending timers, time in ns."""

    time: int
    sequence: int
    timers: tuple[tuple[int, int, int], ...]
    values: tuple[tuple[Any, ...], ...]


class Resource:
    """A resource with its blocks, ready to start.

    Time is the resource's own, in ns from 0, and moves only by `advance`. One thread at a time may use a resource;
    between calls that run it, values may be read and written at will.

    Args:
        network: what runs, e.g. from `resource_network`.
        library: finds the block types that the network uses.
        transport: opens the channels of communication blocks that nothing is attached to; in process if not given.

    Attributes:
        time: the resource's time, ns.
        transport: the transport in use.

    Raises:
        FunctionBlockError: the network or one of its types is wrong; names file and line.
    """

    def __init__(self, network: model.FBNetwork, library: Library, transport: Transport | None = None) -> None:
        self.time = 0
        self.transport: Transport = transport or LocalTransport()
        self._queue: deque[QueueEntry] = deque()
        self._timers: list[tuple[int, int, int]] = []
        self._sequence = 0
        self._stopped = False
        netlist = flatten(network, library.find)
        resolve(netlist)
        check_types(netlist)
        self._types = [compile_type(node.type) for node in netlist.nodes if node.type is not None]
        self._instances = [self._instance(node, kind) for node, kind in zip(netlist.nodes, self._types, strict=True)]
        self._index = {node.name: number for number, node in enumerate(netlist.nodes)}
        self._initial = [_initial(node, kind) for node, kind in zip(netlist.nodes, self._types, strict=True)]
        self._names = queue_entries(netlist, self._types, self._instances, self._queue.extend)
        self.reset()

    def _instance(self, node: Node, kind: CompiledType) -> Any:
        instance = kind.instance_class()
        instance.name__ = node.name
        instance.resource__ = self
        instance.extend__ = self._queue.extend
        if kind.behaviour is not None and kind.behaviour.prepare is not None:
            kind.behaviour.prepare(instance)
        return instance

    def reset(self) -> None:
        """Puts every variable, chart and timer back to the beginning; time stays."""
        self._queue.clear()
        self._timers.clear()
        self._stopped = False
        for kind, instance, values in zip(self._types, self._instances, self._initial, strict=True):
            if hasattr(instance, "port__"):
                instance.port__.close()
            kind.load(instance, values)

    def start(self) -> None:
        """Issues COLD (WARM after `stop`) of every E_RESTART and runs until idle."""
        self._restart("to__WARM" if self._stopped else "to__COLD")
        self._stopped = False

    def stop(self) -> None:
        """Issues STOP of every E_RESTART, runs until idle and cancels the timers."""
        self._restart("to__STOP")
        for _, _, index in self._timers:
            self._instances[index].due__ = None
        self._timers.clear()
        self._stopped = True

    def _restart(self, targets: str) -> None:
        for kind, instance in zip(self._types, self._instances, strict=True):
            if kind.block.header.name == "E_RESTART":
                self._queue.extend(getattr(instance, targets))
        self.run_until_idle()

    @property
    def is_idle(self) -> bool:
        """Whether no event waits in the queue."""
        return not self._queue

    def run_until_idle(self) -> None:
        """Delivers events until the queue is empty.

        Raises:
            FunctionBlockError: an endless loop of events, which it names, or an error inside a block; the queue is
                empty afterwards.
        """
        queue = self._queue
        next_entry = queue.popleft
        for _ in range(ACTIVATION_LIMIT):
            if not queue:
                return
            entry = next_entry()
            try:
                entry()
            except FunctionBlockError as error:
                queue.clear()
                message = f"{self._names[entry]}: {error.message}"
                raise FunctionBlockError(message, error.file, error.line, error.column) from None
        loop = self._loop()
        queue.clear()
        raise FunctionBlockError(f"endless loop of events: {loop}")

    def _loop(self) -> str:
        """The events that keep the queue going, in the order in which they come."""
        names: dict[str, None] = {}
        for _ in range(len(self._queue) + len(self._names)):
            if self._queue:
                entry = self._queue.popleft()
                names[self._names[entry]] = None
                entry()
        shown = list(names)[:12]
        return " -> ".join(shown + ["..."] * (len(names) > len(shown)))

    def advance(self, duration: int) -> None:
        """Moves time on by `duration` ns; delivers what timed blocks issue meanwhile, each at its time."""
        target = self.time + duration
        timers = self._timers
        fired = 0
        while timers and timers[0][0] <= target:
            due, _, index = heapq.heappop(timers)
            fired = fired + 1 if due == self.time else 0
            if fired > ACTIVATION_LIMIT:
                raise FunctionBlockError(f"endless loop of events without delay at {self._instances[index].name__}")
            self.time = due
            behaviour = self._types[index].behaviour
            assert behaviour is not None
            assert behaviour.fire is not None
            behaviour.fire(self._instances[index])
            self.run_until_idle()
        self.time = target

    def next_timer(self) -> int | None:
        """The time in ns at which a timed block will issue its event; None when none waits."""
        return self._timers[0][0] if self._timers else None

    def schedule(self, name: str, delay: int) -> int:
        """Lets a timed block's behaviour fire in `delay` ns; returns the time at which it is due, ns."""
        due = self.time + delay
        heapq.heappush(self._timers, (due, self._sequence, self._index[name]))
        self._sequence += 1
        return due

    def cancel(self, name: str) -> None:
        """Forgets what is due for a timed block."""
        index = self._index[name]
        self._timers[:] = [timer for timer in self._timers if timer[2] != index]
        heapq.heapify(self._timers)

    def names(self) -> tuple[str, ...]:
        """The blocks, with dotted names, composites before what they contain."""
        return tuple(self._index)

    def block_type(self, name: str) -> model.FBType:
        """The type of a block, its generic ports resolved. Raises FunctionBlockError for an unknown name."""
        return self._types[self._find(name)].block

    def read(self, name: str) -> Any:
        """The value of a variable, `BLOCK.VARIABLE`; `BLOCK.$ECC` is the name of the chart's state.

        Raises:
            FunctionBlockError: there is no such block or variable.
        """
        index, variable = self._locate(name)
        if variable is None:
            block = self._types[index].block
            assert isinstance(block, model.BasicFBType)
            return block.states[self._instances[index].state__].name
        return getattr(self._instances[index], python_name(variable.name))

    def reader(self, names: Sequence[str]) -> Callable[[], tuple[Any, ...]]:
        """A function that reads several variables of one block at once, fast enough for every tick.

        Raises:
            FunctionBlockError: there is no such block or variable, or they are of more than one block.
        """
        places = [self._locate(name) for name in names]
        variables = [python_name(variable.name) for _, variable in places if variable is not None]
        if len({index for index, _ in places}) != 1 or len(variables) != len(names) or len(names) < 2:
            raise FunctionBlockError(f"expected at least two variables of one block, got {', '.join(names)}")
        return partial(attrgetter(*variables), self._instances[places[0][0]])

    def write(self, name: str, value: Any) -> None:
        """Sets a variable.

        A connected input keeps the value until it is sampled. An output may be seen by the blocks connected to it
        before the next event publishes it.

        Raises:
            FunctionBlockError: there is no such block or variable, or the value is not of its type.
        """
        index, variable = self._locate(name)
        if variable is None:
            raise FunctionBlockError(f"{name} is the state of a chart and cannot be written: expected a variable")
        try:
            checked = checked_value(value, _data_type(variable), name)
        except ValueError as error:
            raise FunctionBlockError(str(error)) from None
        setattr(self._instances[index], python_name(variable.name), checked)

    def variable_type(self, name: str) -> DataType:
        """The type of a variable, `BLOCK.VARIABLE`. Raises FunctionBlockError as `read` does."""
        _, variable = self._locate(name)
        if variable is None:
            raise FunctionBlockError(f"{name} is the state of a chart and has no data type: expected a variable")
        return _data_type(variable)

    def port(self, name: str) -> CommunicationPort:
        """The outer side of a communication block.

        Raises:
            FunctionBlockError: there is no such block, or it does not communicate.
        """
        instance = self._instances[self._find(name)]
        if not hasattr(instance, "port__"):
            ports = [i.name__ for i in self._instances if hasattr(i, "port__")]
            valid = choices(ports) if ports else "a communication block, and there is none"
            raise FunctionBlockError(f"{name} does not communicate: expected {valid}")
        found: CommunicationPort = instance.port__
        return found

    def server(self, name: str) -> AttachedServer:
        """Attaches to a SERVER block, so that values are exchanged with it by calls.

        Raises:
            FunctionBlockError: there is no such block, or it is no server.
        """
        return AttachedServer(self.port(name), self.run_until_idle)

    def snapshot(self) -> Snapshot:
        """The state, to go back to. Raises FunctionBlockError while events wait."""
        if self._queue:
            raise FunctionBlockError("events wait in the queue: expected an idle resource")
        values = tuple(kind.save(i) for kind, i in zip(self._types, self._instances, strict=True))
        return Snapshot(self.time, self._sequence, tuple(self._timers), values)

    def restore(self, snapshot: Snapshot) -> None:
        """Goes back to a state of this resource, or takes over that of another one made from the same network.

        Whether communication blocks are open is not part of the state.
        """
        self._queue.clear()
        self.time = snapshot.time
        self._sequence = snapshot.sequence
        self._timers[:] = snapshot.timers
        for kind, instance, values in zip(self._types, self._instances, snapshot.values, strict=True):
            kind.load(instance, values)

    def _find(self, name: str) -> int:
        try:
            return self._index[name]
        except KeyError:
            raise FunctionBlockError(f"unknown block {name!r}: {_hint(name, list(self._index))}") from None

    def _locate(self, name: str) -> tuple[int, model.Variable | None]:
        block, _, variable = name.rpartition(".")
        index = self._find(block)
        kind = self._types[index].block
        if variable == "$ECC" and isinstance(kind, model.BasicFBType):
            return index, None
        variables = {v.name: v for v in _variables(kind)}
        if variable not in variables:
            raise FunctionBlockError(f"{block} has no variable {variable!r}: {_hint(variable, list(variables))}")
        return index, variables[variable]


def _variables(kind: model.FBType) -> tuple[model.Variable, ...]:
    internals = kind.internals if isinstance(kind, model.BasicFBType | model.SimpleFBType) else ()
    return (*kind.interface.inputs, *kind.interface.outputs, *internals)


def _data_type(variable: model.Variable) -> DataType:
    assert not isinstance(variable.type, model.GenericType)
    return variable.type


def _initial(node: Node, kind: CompiledType) -> tuple[Any, ...]:
    """The state of an instance at the beginning: the type's initial values and the instance's parameters."""
    values = dict(kind.initial)
    for variable in node.interface.inputs:
        parameter = node.parameters.get(variable.name)
        if parameter is not None:
            literal = model.literal(parameter.value, _data_type(variable), node.file, parameter.line)
            values[python_name(variable.name)] = literal
    return tuple(values.values())


def _hint(name: str, valid: Sequence[str]) -> str:
    close = difflib.get_close_matches(name, valid, n=5, cutoff=0.5) or list(valid[:20])
    return f"expected {choices(close)}" if close else "there is none"
