"""A resource that executes a network: one queue of events, first in first out, and a clock that is told the time.

An event from outside and all events that follow from it are an event chain. A chain is bounded: in its events, in
those that wait, and in the iterations of its loops.
"""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, Final, NoReturn

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.library import Library
from iec61499.runtime.blocks import Blocks, Snapshot, located
from iec61499.runtime.communication import AttachedServer, LocalTransport, Transport
from iec61499.runtime.compile import CompiledType
from iec61499.runtime.entries import Member
from iec61499.runtime.linking.linker import Linker
from iec61499.runtime.linking.netlist import Node
from iec61499.runtime.operation import Operation, QueueEntry, Tracer, Undelivered, deliver_traced
from iec61499.runtime.wiring import Wiring
from iec61499.st.python.expressions import python_name, wiring_name
from iec61499.st.semantics import ITERATION_LIMIT

ACTIVATION_LIMIT: Final = 100_000
"""Most events that may follow from one; more are taken for an endless loop."""
QUEUE_LIMIT: Final = 50_000
"""Most events that may wait when one has been delivered; more are taken for an endless loop, too."""
BATCH: Final = 200
"""Events that are delivered between two looks at those limits."""
TICK: Final = 1_000_000
"""Shortest delay of a timed block, ns: the tick of a FORTE with its standard settings."""
SHOWN: Final = 1000
"""Most events that are delivered to find the names of an endless loop."""


def _iterations() -> Iterator[int]:
    return iter(range(ITERATION_LIMIT))


class Resource(Blocks):
    """A resource with its blocks, ready to start.

    Time is the resource's own, in ns from 0, and moves only by `advance`. One thread at a time may use a resource;
    between calls that run it, values may be read and written at will.

    Args:
        network: what runs, e.g. from `resource_network`.
        library: finds the block types that the network uses.
        transport: opens the channels of communication blocks that nothing is attached to; in process if not given.
        budget: makes the iterator from which all loops of an event chain draw their iterations; a loop that finds it
            at its end is an error. Without it every chain has `ITERATION_LIMIT`.

    Attributes:
        time: the resource's time, ns.
        transport: the transport in use.
        iterations: the iterator of the chain that runs.

    Raises:
        FunctionBlockError: the network or one of its types is wrong; names file and line.
    """

    def __init__(
        self,
        network: model.FBNetwork,
        library: Library,
        transport: Transport | None = None,
        budget: Callable[[], Iterator[int]] = _iterations,
    ) -> None:
        super().__init__()
        self.time = 0
        self.iterations = budget()
        self._budget = budget
        self._activations = 0
        self.transport: Transport = transport or LocalTransport()
        self._queue: deque[QueueEntry] = deque()
        self._timers: list[tuple[int, int, int]] = []
        self._sequence = 0
        self._stopped = False
        self._linker = Linker(library.find)
        self._wiring = Wiring(self._queue.extend)
        self._names: dict[QueueEntry, str] = {}
        self._operation = Operation()
        self.change(network)

    def change(
        self, network: model.FBNetwork, operation: Operation | None = None, anew: Collection[str] = ()
    ) -> None:
        """Makes another network run from the next event on, or the same one operated in another way.

        Blocks that have the same name and type in both keep their state, timers and channels; others begin with their
        initial values, but without an event of E_RESTART. When it fails, nothing has changed.

        Args:
            network: what runs from now on.
            operation: how it is operated; without it everything runs as it is drawn.
            anew: names of blocks that begin anew although there were some of their name and type.

        Raises:
            FunctionBlockError: the network or one of its types is wrong, or events wait.
        """
        if self._queue:
            raise FunctionBlockError("events wait in the queue: expected an idle resource")
        netlist = self._linker.link(network)
        nodes = tuple(netlist.nodes.values())
        types = [self._compiled(node) for node in nodes]
        initial = [self._initial_state(node, kind) for node, kind in zip(nodes, types, strict=True)]
        operated = operation or Operation()
        kept: dict[int, int] = {}
        instances = []
        for place, (node, kind, values) in enumerate(zip(nodes, types, initial, strict=True)):
            before = self._index.get(node.name)
            if before is not None and self._types[before] is kind and node.name not in anew:
                kept[before] = place
                instances.append(self._instances[before])
            else:
                instances.append(self._instance(node, kind))
                kind.load(instances[-1], values)
        members = dict(zip(netlist.nodes, map(Member, types, instances), strict=True))
        self._names = self._wiring.connect(netlist, members, operated)
        for before, instance in enumerate(self._instances):
            if before not in kept and hasattr(instance, "port__"):
                instance.port__.close()
        self._types, self._instances, self._initial = types, instances, initial
        self._operation = operated
        self._network = network
        self._parameters = [node.parameters for node in nodes]
        self._index = {node.name: place for place, node in enumerate(nodes)}
        self._timers[:] = [(due, order, kept[index]) for due, order, index in self._timers if index in kept]
        for name, value in operated.forced.items():
            super().write(name, value)

    def trace(self, tracer: Tracer) -> None:
        """Lets a tracer see the events from the next one on. Raises FunctionBlockError while events wait."""
        self.change(self._network, replace(self._operation, tracer=tracer))

    def write(self, name: str, value: Any) -> None:
        super().write(name, value)
        for observer in self._operation.all_observers():
            observer.written(self.time, name, value)

    def issue_recorded(self, block: str, event: str, values: Mapping[str, Any], time: int) -> None:
        """Lets a passive block issue an event with values, by the names of its outputs, before the events that wait.

        Args:
            block: the dotted name of the block.
            event: the name of the event output.
            values: the values of outputs.
            time: the time of the resource then, ns.
        """
        if not self._queue:
            self._end_chain()
        instance = self._instances[self._find(block)]
        self.time = time
        for name, value in values.items():
            setattr(instance, python_name(name), value)
        self._queue.extendleft(reversed(getattr(instance, wiring_name(event))))

    def deliver_next(self) -> bool:
        """Delivers one event; returns whether one waited. Raises FunctionBlockError as `run_until_idle`."""
        if not self._queue:
            return False
        self.run_batch(1)
        return True

    def halt_block(self, name: str) -> None:
        """Cancels the timers of a block and of what is inside it, and closes their channels."""
        for index in self._inside(name):
            self._halt(self._instances[index])

    def _halt(self, instance: Any) -> None:
        if getattr(instance, "due__", None) is not None:
            self.cancel(instance.name__)
            instance.due__ = None
        if hasattr(instance, "port__"):
            instance.port__.close()

    def trigger(self, event: str) -> None:
        """Queues an event at a block, `BLOCK.EVENT`: its event input gets it, or the receivers of its event output.

        A block that is stopped gets none.

        Raises:
            FunctionBlockError: there is no such event.
        """
        block = self._owner(event)
        name = event.removeprefix(f"{block}.")
        if self._operation.stops(block):
            return
        instance = self._instances[self._find(block)]
        interface = self._types[self._find(block)].block.interface
        if name in [port.name for port in interface.event_inputs]:
            self._queue.extend(entry for entry, known in self._names.items() if known == event)
        elif hasattr(instance, wiring_name(name)):
            self._queue.extend(getattr(instance, wiring_name(name)))
        else:
            valid = [port.name for port in (*interface.event_inputs, *interface.event_outputs)]
            raise FunctionBlockError(f"{block} has no event {name!r}: expected {choices(valid) if valid else 'none'}")

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
        self._drop_events()
        self._timers.clear()
        self._stopped = False
        for kind, instance, values in zip(self._types, self._instances, self._initial, strict=True):
            if hasattr(instance, "port__"):
                instance.port__.close()
            kind.load(instance, values)

    def start(self) -> None:
        """Issues COLD (WARM after `stop`) of every E_RESTART and runs until idle."""
        self.issue_start()
        self.run_until_idle()

    def stop(self) -> None:
        """Issues STOP of every E_RESTART, runs until idle and cancels the timers."""
        self.issue_stop()
        self.run_until_idle()
        self.halt()

    def issue_start(self) -> None:
        """Queues COLD (WARM after `halt`) of every E_RESTART."""
        self._restart("to__WARM" if self._stopped else "to__COLD")
        self._stopped = False

    def issue_stop(self) -> None:
        """Queues STOP of every E_RESTART."""
        self._restart("to__STOP")

    def halt(self) -> None:
        """Drops the events that wait and cancels the timers."""
        self._drop_events()
        for _, _, index in self._timers:
            self._instances[index].due__ = None
        self._timers.clear()
        self._stopped = True

    def _restart(self, targets: str) -> None:
        for kind, instance in zip(self._types, self._instances, strict=True):
            if kind.block.header.name == "E_RESTART":
                self._queue.extend(getattr(instance, targets))

    def _drop_events(self) -> None:
        self._queue.clear()
        if self._operation.tracer is not None:
            self._operation.tracer.end_chain(self.time)
        self._end_chain()

    def _end_chain(self) -> None:
        self._activations = 0
        self.iterations = self._budget()

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
        while self.run_batch():
            pass

    def run_batch(self, size: int = BATCH) -> bool:
        """Delivers at most `size` events of the chain that runs; returns whether more wait.

        Raises:
            FunctionBlockError: as `run_until_idle`.
        """
        queue = self._queue
        if self._operation.tracer is not None:
            try:
                return deliver_traced(queue, self._operation.tracer, size, self.time) and self._goes_on(size)
            except Undelivered as failure:
                self._drop_events()
                raise located(failure.error, self._names[failure.entry]) from None
            finally:
                if not queue:
                    self._end_chain()
        next_entry = queue.popleft
        for _ in range(size):
            if not queue:
                self._end_chain()
                return False
            entry = next_entry()
            try:
                entry()
            except Exception as error:
                self._drop_events()
                raise located(error, self._names[entry]) from None
        return self._goes_on(size)

    def _goes_on(self, delivered: int) -> bool:
        """Counts events of the chain that runs; more of them wait."""
        self._activations += delivered
        if self._activations < ACTIVATION_LIMIT and len(self._queue) < QUEUE_LIMIT:
            return True
        self.end_chain("endless loop of events")

    def end_chain(self, problem: str) -> NoReturn:
        """Raises FunctionBlockError with the problem and the events that keep the queue going, and drops them."""
        loop = self._loop()
        self._drop_events()
        raise FunctionBlockError(f"{problem}: {loop}")

    def _loop(self) -> str:
        """The events that keep the queue going, in the order in which they come."""
        names: dict[str, None] = {}
        for _ in range(min(len(self._queue) + len(self._names), SHOWN)):
            if self._queue:
                entry = self._queue.popleft()
                names[self._names[entry]] = None
                with suppress(Exception):
                    entry()  # the loop is what is wrong first
        shown = list(names)[:12]
        return " -> ".join(shown + ["..."] * (len(names) > len(shown)))

    def advance(self, duration: int) -> None:
        """Moves time on by `duration` ns; delivers what timed blocks issue meanwhile, each at its time."""
        target = self.time + duration
        while self.ring(target):
            self.run_until_idle()

    def ring(self, until: int) -> bool:
        """Moves time on to the first timed block that is due by `until` (ns) and queues the event that it issues.

        Returns whether there was one; if not, time has moved on to `until`.
        """
        if not self._timers or self._timers[0][0] > until:
            self.time = until
            return False
        self.time, _, index = heapq.heappop(self._timers)
        behaviour = self._types[index].behaviour
        assert behaviour is not None
        assert behaviour.fire is not None
        behaviour.fire(self._instances[index])
        return True

    def next_timer(self) -> int | None:
        """The time in ns at which a timed block will issue its event; None when none waits."""
        return self._timers[0][0] if self._timers else None

    def schedule(self, name: str, delay: int) -> int:
        """Lets a timed block's behaviour fire in `delay` ns, but no sooner than in a tick; returns the time, ns."""
        due = self.time + max(delay, TICK)
        heapq.heappush(self._timers, (due, self._sequence, self._index[name]))
        self._sequence += 1
        return due

    def cancel(self, name: str) -> None:
        """Forgets what is due for a timed block."""
        index = self._index[name]
        self._timers[:] = [timer for timer in self._timers if timer[2] != index]
        heapq.heapify(self._timers)

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
