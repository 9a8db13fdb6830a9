"""A resource in machine code whose services this process has: communication, hardware, and what else is no chart.

Machine code samples the inputs of such a block at its event and asks the host, which does what the embedded runtime
does: the same handler, on an object whose variables are those of the unit in memory. So sockets, OPC UA and MQTT are
the same for both, and what they say is the same.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterable, Sequence
from struct import Struct
from typing import Any, Final, NoReturn

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.native import memory
from iec61499.native.resource import NAME, NativeResource
from iec61499.native.services import is_hosted
from iec61499.runtime.blocks import UNCHANGED, checked_value, located
from iec61499.runtime.checks import Checks
from iec61499.runtime.communication import LocalTransport, Transport
from iec61499.runtime.compile import CompiledType, compile_type
from iec61499.runtime.linking.netlist import Node
from iec61499.st.python.expressions import python_name, wiring_name

_EVENT: Final = Struct("iiqqq").size
_WAITING: Final = Struct("iiqqqi0qqPIH").size
"""Where the number of the event that is delivered, and how many wait, are in the unit."""
_HOST: Final = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.c_int32)
Handler = Callable[[], None]


class HostedResource(NativeResource):
    """A resource in machine code with all services of the embedded runtime.

    It has what `device.runner` asks of a resource; its network stays as it is. A text that comes from outside has at
    most 254 bytes.

    Args:
        network: what runs.
        library: finds the block types that the network uses.
        transport: opens the channels of communication blocks; in process if not given.

    Attributes:
        transport: the transport in use.
        checks: what TEST_CONDITION blocks have found.

    Raises:
        FunctionBlockError: the network or one of its types is wrong, or needs what C cannot do; names file and line.
        NativeError: machine code cannot be made here.
    """

    hosted = True

    def __init__(self, network: model.FBNetwork, library: Library, transport: Transport | None = None) -> None:
        super().__init__(network, library)
        self.transport: Transport = transport or LocalTransport()
        self.checks = Checks()
        self._problem: Exception | None = None
        self._issued = self._typed("issue", ctypes.c_int32, ctypes.c_int32)
        self._pushed = self._typed("push", ctypes.c_int32, ctypes.c_uint16)
        self._rung = self._typed("ring", ctypes.c_int32, ctypes.c_int64)
        self._ran = self._typed("run", ctypes.c_int32)
        self._due = self._typed("due", ctypes.c_int64)
        self._services: list[tuple[CompiledType, Any]] = []
        self._handlers: dict[int, Handler] = {}
        nodes = self._layout.netlist.nodes
        for number, node in nodes.items():
            if node.type is not None and is_hosted(node.type):
                self._add(number, node)
        self._callback = _HOST(self._asked)
        self._initialise()

    def _typed(self, name: str, result: Any, *arguments: Any) -> Any:
        function = self._function(f"{NAME}__{name}", result)
        function.argtypes = [ctypes.c_void_p, *arguments]
        return function

    def _initialise(self) -> None:
        self._function(f"{NAME}__initialise", None)(self.address)
        self._typed("host", None, _HOST)(self.address, self._callback)

    def _add(self, number: int, node: Node) -> None:
        """Makes the object that stands for a block of the host."""
        assert node.type is not None
        kind = compile_type(node.type)
        assert kind.behaviour is not None
        instance = _instance_class(self, node)()
        instance.name__ = node.name
        instance.resource__ = self
        instance.extend__ = self._extend
        first = self._layout.outputs[number]
        for k, event in enumerate(node.interface.event_outputs):
            setattr(instance, wiring_name(event.name), (first + k,))
        for name, value in kind.behaviour.state.items():
            setattr(instance, name, value)
        if kind.behaviour.prepare is not None:
            kind.behaviour.prepare(instance)
        self._services.append((kind, instance))
        for port, entry in self._layout.entries.items():
            if port.node == number:
                self._handlers[entry] = _bound(kind.behaviour.handlers.get(port.name), instance)

    def _extend(self, outputs: Iterable[int]) -> None:
        for output in outputs:
            self.check(self._issued(self.address, output))

    def _asked(self, entry: int) -> int:
        try:
            self._handlers[entry]()
        except Exception as error:
            self._problem = error
            return 1
        return 0

    def _raise(self, problem: int, server: str) -> NoReturn:
        error, self._problem = self._problem, None
        if error is not None:
            event = int.from_bytes(self._view[_EVENT : _EVENT + 4], sys.byteorder, signed=True)
            raise located(error, self._layout.event_names[event]) from None
        super()._raise(problem, server)

    @property
    def is_idle(self) -> bool:
        """Whether no event waits in the queue."""
        return not int.from_bytes(self._view[_WAITING : _WAITING + 2], sys.byteorder)

    def trigger(self, event: str) -> None:
        """Queues an event at a block, `BLOCK.EVENT`: its event input gets it, or the receivers of its event output.

        Raises FunctionBlockError when there is no such event.
        """
        if event in self._layout.event_names:
            self.check(self._pushed(self.address, self._layout.event_names.index(event)))
            return
        block, _, name = event.rpartition(".")
        outputs = [port.name for port in self.block_type(block).interface.event_outputs]
        if name not in outputs:
            raise FunctionBlockError(f"{block} has no event {name!r}")
        self._extend([self._layout.outputs[self._numbers[block]] + outputs.index(name)])

    def start(self) -> None:
        self.issue_start()
        self.run_until_idle()

    def stop(self) -> None:
        self.issue_stop()
        self.run_until_idle()
        self.halt()

    def issue_start(self) -> None:
        """Queues COLD (WARM after `halt`) of every E_RESTART."""
        self._restart("WARM" if self._stopped else "COLD")
        self._stopped = False

    def issue_stop(self) -> None:
        """Queues STOP of every E_RESTART."""
        self._restart("STOP")

    def _restart(self, event: str) -> None:
        for number, node in self._layout.netlist.nodes.items():
            if node.type is not None and node.type.header.name == "E_RESTART":
                outputs = [port.name for port in node.interface.event_outputs]
                self._extend([self._layout.outputs[number] + outputs.index(event)])

    def halt(self) -> None:
        """Drops the events that wait and cancels the timers."""
        self._function(f"{NAME}__halt", None)(self.address)
        self._stopped = True

    def reset(self) -> None:
        """Puts every variable, chart, timer and channel back to the beginning; time stays."""
        now = self.time
        for kind, instance in self._services:
            if hasattr(instance, "port__"):
                instance.port__.close()
            assert kind.behaviour is not None
            for name, value in kind.behaviour.state.items():
                setattr(instance, name, value)
        self._initialise()
        self._rung(self.address, now)
        self._stopped = False

    def run_until_idle(self) -> None:
        self.run_batch()

    def run_batch(self, size: int = 0) -> bool:
        """Delivers all events that wait; so none waits any more. Raises FunctionBlockError."""
        self.check(self._ran(self.address))
        return False

    def ring(self, until: int) -> bool:
        """Moves time on to the first timed block that is due by `until` (ns) and queues the event that it issues.

        Returns whether there was one; if not, time has moved on to `until`.
        """
        return bool(self._rung(self.address, until))

    def next_timer(self) -> int | None:
        due: int = self._due(self.address)
        return None if due < 0 else due

    def advance(self, duration: int) -> None:
        target = self.time + duration
        while self.ring(target):
            self.run_batch()

    def end_chain(self, problem: str) -> NoReturn:
        """Raises FunctionBlockError with the problem, and drops the events that wait."""
        self.halt()
        raise FunctionBlockError(problem)

    def check(self, problem: int, server: str = "") -> None:
        if problem:
            self._view[:4] = bytes(4)
            self._raise(problem, server)

    def snapshot(self) -> NoReturn:
        raise FunctionBlockError("a resource whose services are outside machine code has no snapshot")

    def change(self, *_: Any) -> NoReturn:
        raise FunctionBlockError(UNCHANGED)

    halt_block = reset_block = enter_state = change


def _bound(handler: Callable[[Any], None] | None, instance: Any) -> Handler:
    if handler is None:
        return lambda: None
    return lambda: handler(instance)


def _instance_class(resource: HostedResource, node: Node) -> Callable[[], Any]:
    """A class whose attributes are the variables of a block of the unit."""
    variables: Sequence[model.Variable] = (*node.interface.inputs, *node.interface.outputs)
    members = {python_name(v.name): _variable(resource, f"{node.name}.{v.name}") for v in variables}
    return type("Hosted", (), members)


def _variable(resource: HostedResource, name: str) -> property:
    view, offset, kind = resource._view, resource._offsets[name], resource._places[name].type

    def get(_: Any) -> Any:
        return memory.read(view, offset, kind)

    def put(_: Any, value: Any) -> None:
        memory.write(view, offset, kind, checked_value(value, kind, name))

    return property(get, put)
