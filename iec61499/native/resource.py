"""A resource that runs as machine code in this process, with the results of `Resource` to the bit."""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from struct import Struct
from struct import error as StructError
from typing import Any, Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from iec61499 import model
from iec61499.errors import CommunicationError, FunctionBlockError, choices
from iec61499.library import Library
from iec61499.native import memory
from iec61499.native.build import NAME, machine_code
from iec61499.native.clock import queue_size
from iec61499.native.layout import CHART, Place, is_server
from iec61499.native.recorder import NativeRecorder
from iec61499.native.tracing import traced_events
from iec61499.runtime.blocks import checked_value
from iec61499.trace.ctf import TraceWriter
from iec61499.types import LREAL, DataType, ElementaryType

_FAULT: Final = Struct("iiqqqi")
_CLOCK: Final = Struct("iiqqqi0q").size
_FINE, _INDEX, _LOOP, _STEP, _TEXT, _CHART, _EVENTS, _QUEUE, _CLOSED, _ANSWER, _CHARACTER, _HOST = range(12)


class NativeResource:
    """A resource of basic, simple and composite blocks with E_RESTART, SERVER and timed blocks, in machine code.

    A STRING has at most 254 bytes here, and 1024 events may wait, or twice as many as there are connections of
    events. What would be more is an error.

    Args:
        network: what runs, e.g. from `resource_network`.
        library: finds the block types that the network uses.
        writer: writes a trace of all events; without it none is recorded.

    Attributes:
        address: the address of the unit in memory, for machine code that calls `function`.

    Raises:
        FunctionBlockError: the network or one of its types is wrong, or needs what C cannot do; names file and line.
        NativeError: machine code cannot be made here, or cannot record the events.
    """

    hosted = False
    """Whether a host does what services do."""

    def __init__(self, network: model.FBNetwork, library: Library, writer: TraceWriter | None = None) -> None:
        self._layout, self._library = machine_code(network, library, writer is not None, self.hosted)
        size = ctypes.c_size_t.in_dll(self._library, f"{NAME}__size").value
        self._memory = ctypes.create_string_buffer(size)
        self._view = memoryview(self._memory).cast("B")
        self.address = ctypes.addressof(self._memory)
        self._places = {place.name: place for place in self._layout.variables}
        self._numbers = {node.name: number for number, node in self._layout.netlist.nodes.items()}
        nodes = () if self.hosted else self._layout.netlist.nodes.values()
        servers = [node.name for node in nodes if is_server(node)]
        self._offsets, self._flags = memory.offsets(self._library, NAME, self._layout.variables, servers)
        self._reals = self._view[: size - size % 8].cast("d")
        self._places_of_reals = {
            place.name: self._offsets[place.name] // 8 for place in self._layout.variables if place.type == LREAL
        }
        self._stopped = False
        self._function(f"{NAME}__initialise", None)(self.address)
        self._recorder = None
        if writer is not None:
            self._recorder = NativeRecorder(writer, traced_events(self._layout))
            self._recorder.start(self.states())
            self._function(f"{NAME}__trace", None, 2)(self.address, self._recorder.address)

    @property
    def traced(self) -> bool:
        """Whether events are recorded."""
        return self._recorder is not None

    def function(self, name: str) -> int:
        """The address of a function of the unit, whose first argument is `address`."""
        found = ctypes.cast(getattr(self._library, f"{NAME}__{name}"), ctypes.c_void_p).value
        assert found is not None
        return found

    def offset(self, name: str) -> int:
        """Where a variable is in the unit, in bytes. Raises FunctionBlockError as `read` does."""
        return self._offsets[self._find(name).name]

    def numbers(self) -> NDArray[np.float64]:
        """The unit in memory as LREAL, of which the one at `offset` is a variable; it changes as the unit runs."""
        return np.frombuffer(self._view, np.float64, len(self._view) // 8)

    def _function(self, name: str, result: Any, arguments: int = 1) -> Any:
        function = getattr(self._library, name)
        function.restype = result
        function.argtypes = [ctypes.c_void_p] * arguments
        return function

    def start(self) -> None:
        """Issues COLD (WARM after `stop`) of every E_RESTART and runs until idle."""
        self._issue("warm" if self._stopped else "cold")
        self._stopped = False

    def stop(self) -> None:
        """Issues STOP of every E_RESTART, runs until idle and cancels the timers."""
        self._issue("stop")
        self._function(f"{NAME}__halt", None)(self.address)
        self._stopped = True

    @property
    def time(self) -> int:
        """The resource's time, ns."""
        return int.from_bytes(self._view[_CLOCK : _CLOCK + 8], sys.byteorder, signed=True)

    def next_timer(self) -> int | None:
        """The time in ns at which a timed block will issue its event; None when none waits."""
        due: int = self._function(f"{NAME}__due", ctypes.c_int64)(self.address)
        return None if due < 0 else due

    def advance(self, duration: int) -> None:
        """Moves time on by ns; delivers what timed blocks issue meanwhile, each at its time."""
        function = self._function(f"{NAME}__advance", ctypes.c_int32, 2)
        function.argtypes = [ctypes.c_void_p, ctypes.c_int64]
        self.check(function(self.address, self.time + duration))

    def trigger(self, event: str) -> None:
        """Delivers an event to a block, `BLOCK.EVENT`, and runs until idle. Raises FunctionBlockError."""
        events = self._layout.event_names
        if event not in events:
            raise FunctionBlockError(f"there is no event input {event}: expected one of {', '.join(events[:20])}")
        function = getattr(self._library, f"{NAME}__trigger")
        function.argtypes = [ctypes.c_void_p, ctypes.c_uint16]
        self.check(function(self.address, events.index(event)))

    def run_until_idle(self) -> None:
        """Delivers events until none waits. Raises FunctionBlockError."""
        self._issue("run")

    def _issue(self, event: str) -> None:
        self.check(self._function(f"{NAME}__{event}", ctypes.c_int32)(self.address))

    def names(self) -> tuple[str, ...]:
        """The blocks, with dotted names, composites before what they contain."""
        return tuple(self._numbers)

    def block_type(self, name: str) -> model.FBType:
        """The type of a block, its generic ports resolved. Raises FunctionBlockError for an unknown name."""
        found = self._layout.netlist.nodes[self._numbers[name]].type if name in self._numbers else None
        if found is None:
            raise FunctionBlockError(f"unknown block {name!r}: expected {choices(self.names())}")
        return found

    def read(self, name: str) -> Any:
        """The value of a variable, `BLOCK.VARIABLE`; `BLOCK.$ECC` is the name of the chart's state.

        Raises:
            FunctionBlockError: there is no such block or variable.
        """
        place = self._find(name)
        value = memory.read(self._view, self._offsets[name], place.type)
        if not name.endswith(CHART):
            return value
        block = self.block_type(name.rpartition(".")[0])
        assert isinstance(block, model.BasicFBType)
        return block.states[value].name

    def reader(self, names: Sequence[str]) -> Callable[[], tuple[Any, ...]]:
        """A function that reads several variables at once, fast enough for every tick.

        Raises:
            FunctionBlockError: there is no such block or variable.
        """
        places = [self._find(name) for name in names]
        if all(memory.is_plain(place.type) for place in places):
            return memory.together([self._offsets[n] for n in names], [place.type for place in places], self._view)
        return lambda: tuple(self.read(name) for name in names)

    def write(self, name: str, value: Any) -> None:
        """Sets a variable.

        Raises:
            FunctionBlockError: there is no such block or variable, or the value is not of its type.
        """
        if type(value) is float and self._recorder is None and name in self._places_of_reals:
            self._reals[self._places_of_reals[name]] = value
            return
        place = self._find(name)
        if name.endswith(CHART):
            raise FunctionBlockError(f"{name} is the state of a chart and cannot be written: expected a variable")
        try:
            checked = checked_value(value, place.type, name)
        except ValueError as error:
            raise FunctionBlockError(str(error)) from None
        memory.write(self._view, self._offsets[name], place.type, checked)
        if self._recorder is not None:
            self._recorder.written(name, value)

    def recall(self, values: Mapping[str, Any]) -> None:
        """Sets variables, and charts (`BLOCK.$ECC`) to states, as `read` has told them. Raises FunctionBlockError."""
        for name, value in values.items():
            if not name.endswith(CHART):
                self.write(name, value)
                continue
            place, block = self._find(name), self.block_type(name.rpartition(".")[0])
            states = [state.name for state in block.states] if isinstance(block, model.BasicFBType) else []
            if value not in states:
                raise FunctionBlockError(f"{name}: expected {choices(states)}, got {value!r}")
            memory.write(self._view, self._offsets[name], place.type, states.index(value))

    def states(self) -> dict[str, dict[str, Any]]:
        """The values of all variables, by block and name."""
        found: dict[str, dict[str, Any]] = {name: {} for name in self.names()}
        for name, place in self._places.items():
            block, _, variable = self._split(name)
            if variable != CHART:
                found[block][variable] = memory.read(self._view, self._offsets[name], place.type)
        return found

    def _split(self, name: str) -> tuple[str, str, str]:
        """A block and its variable, which may be one of an adapter (`PLUG.DT`)."""
        block, dot, variable = name.rpartition(".")
        if block in self._numbers:
            return block, dot, variable
        owner, dot, adapter = block.rpartition(".")
        return owner, dot, f"{adapter}.{variable}"

    def variable_type(self, name: str) -> DataType:
        """The type of a variable, `BLOCK.VARIABLE`. Raises FunctionBlockError as `read` does."""
        return self._find(name).type

    def server(self, name: str) -> NativeServer:
        """Attaches to a SERVER block, so that values are exchanged with it by calls.

        Raises:
            FunctionBlockError: there is no such block, or it is no server.
        """
        server = self.port(name)
        self._view[self._flags[name][1]] = 1
        return server

    def port(self, name: str) -> NativeServer:
        """The outer side of a SERVER block, which nothing is attached to. Raises FunctionBlockError as `server`."""
        node = self._layout.netlist.nodes[self._layout.server(name)]
        request = [variable.type for variable in node.interface.outputs if variable.name.startswith("RD_")]
        answer = [variable.type for variable in node.interface.inputs if variable.name.startswith("SD_")]
        member = self._layout.members[self._layout.server(name)]
        exchange = self._function(f"{NAME}__exchange__{member}", ctypes.c_int32, 3 if answer else 2)
        deliver = self._function(f"{NAME}__deliver__{member}", ctypes.c_int32, 2)
        return NativeServer(
            self, name, memory.elementary(name, request), memory.elementary(name, answer), exchange, deliver
        )

    def snapshot(self) -> bytes:
        """The state, to go back to."""
        return bytes(self._view)

    def restore(self, snapshot: bytes) -> None:
        """Goes back to a state of this resource. Whether SERVER blocks are open is not part of the state."""
        flags = [(place, self._view[place]) for pair in self._flags.values() for place in pair]
        self._view[:] = snapshot
        for place, value in flags:
            self._view[place] = value

    def check(self, problem: int, server: str = "") -> None:
        """Raises what a function of the unit has returned: FunctionBlockError, or CommunicationError of a server."""
        if problem != _FINE:
            self._raise(problem, server)

    def _raise(self, problem: int, server: str) -> NoReturn:
        _, place, value, low, high, event = _FAULT.unpack_from(self._view)
        if problem == _CLOSED:
            raise CommunicationError(f"{server} is not initialised: expected INIT with QI = TRUE first")
        if problem == _ANSWER:
            raise CommunicationError(f"{server} answered {value} times to one request: expected one RSP")
        what = {
            _INDEX: f"index {value}: expected {low} to {high}",
            _CHARACTER: f"character {value}: {f'expected {low} to {high}' if high else 'the text is empty'}",
            _LOOP: "loop did not end within 10000000 iterations",
            _STEP: "BY 0 never ends: expected another step",
            _TEXT: "text of more than 254 bytes, which machine code cannot hold",
            _CHART: "more than 10000 transitions without an event: the chart never comes to rest",
            _EVENTS: "endless loop of events",
            _QUEUE: f"more than {queue_size(self._layout)} events wait, which machine code cannot hold",
            _HOST: "a service failed",
        }[problem]
        raise FunctionBlockError(f"{self._layout.event_names[event]}: {what}", *self._position(place))

    def _position(self, place: int) -> tuple[str, int, int]:
        table = ctypes.addressof(ctypes.c_char.in_dll(self._library, f"{NAME}__places"))
        file, line, column = Struct("Pii").unpack(ctypes.string_at(table + 16 * place, 16))
        return ctypes.string_at(file).decode("utf-8", "replace"), line, column

    def _find(self, name: str) -> Place:
        try:
            return self._places[name]
        except KeyError:
            block = name.rpartition(".")[0]
            if block not in self._numbers:
                raise FunctionBlockError(f"unknown block {block!r}: expected {choices(self.names())}") from None
            raise FunctionBlockError(f"{block} has no variable {name.rpartition('.')[2]!r}") from None


class NativeServer:
    """A client's view of a SERVER block in machine code: one exchange a call.

    Attributes:
        receives: the types of the values that it receives.
        sends: the types of the values that it answers with.
        answer: the last answer as C lays it out.
    """

    def __init__(
        self,
        resource: NativeResource,
        name: str,
        receives: tuple[ElementaryType, ...],
        sends: tuple[ElementaryType, ...],
        exchange: Callable[..., int],
        deliver: Callable[..., int],
    ) -> None:
        self.receives = receives
        self.sends = sends
        self._name = name
        self._resource = resource
        self._request = Struct("".join(memory.formats(kind) for kind in receives))
        self._answer = Struct("".join(memory.formats(kind) for kind in sends))
        # C leaves free what follows the last value up to the next multiple of 8
        request = ctypes.create_string_buffer(self._request.size + 16 - self._request.size % 8)
        answer = ctypes.create_string_buffer(self._answer.size + 8)
        self._buffers = request, answer
        self.answer: NDArray[np.uint8] = np.frombuffer(memoryview(answer).cast("B"), np.uint8)
        self._pack = partial(self._request.pack_into, request, 0)
        self._unpack = partial(self._answer.unpack_from, answer, 0)
        addresses = [resource.address, ctypes.addressof(request), ctypes.addressof(answer)][: 3 if sends else 2]
        self._call = partial(exchange, *addresses)
        self._put = partial(deliver, *addresses[:2])
        self._texts = [k for k in reversed(range(len(receives))) if not memory.is_plain(receives[k])]
        self._text_answers = [kind for kind in sends if not memory.is_plain(kind)]

    def exchange(self, values: Sequence[Any]) -> tuple[Any, ...]:
        """Delivers values at RD_1, ... with IND, runs the resource, and returns what RSP sent from SD_1, ...

        Raises:
            CommunicationError: the block is not initialised, the values are others than it receives, or RSP did not
                come exactly once.
            FunctionBlockError: an error inside a block.
        """
        self._write(values)
        problem = self._call()
        if problem:
            self._resource.check(problem, self._name)
        return self.last()

    def last(self) -> tuple[Any, ...]:
        """The values of the last answer."""
        return self._unpack() if not self._text_answers else self._from_texts()

    def requests(self, messages: Sequence[Sequence[Any]]) -> NDArray[np.uint8]:
        """Messages as the block's function reads them, a row each. Raises CommunicationError as `exchange`."""
        rows = []
        for values in messages:
            self._write(values)
            rows.append(np.frombuffer(self._buffers[0].raw, np.uint8))
        return np.array(rows)

    def deliver(self, values: Sequence[Any]) -> None:
        """Puts values out at RD_1, ... and queues IND; the resource then has to run. Raises CommunicationError."""
        self._write(values)
        self._resource.check(self._put(), self._name)

    def _write(self, values: Sequence[Any]) -> None:
        try:
            self._pack(*(values if not self._texts else self._with_texts(values)))
        except StructError as error:
            raise CommunicationError(
                f"{self._name} got {len(values)} values, expected {len(self.receives)}: {error}"
            ) from None

    def _with_texts(self, values: Sequence[Any]) -> list[Any]:
        flat = list(values)
        if len(flat) == len(self.receives):
            for k in self._texts:
                flat[k : k + 1] = memory.text_to(flat[k]) if self.receives[k].kind == "string" else (ord(flat[k]),)
        return flat

    def _from_texts(self) -> tuple[Any, ...]:
        found = iter(self._unpack())
        values = []
        for kind in self.sends:
            value = next(found)
            if kind.kind == "string":
                value = memory.text_from(value, next(found))
            values.append(chr(value) if kind.kind == "char" else value)
        return tuple(values)
