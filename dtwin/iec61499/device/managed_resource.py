"""A resource as device management sees it: a network put together request by request, then started.

States and reasons are those of 4diac FORTE 2.0, with one difference: the network of a running or stopped resource
cannot be changed (INVALID_STATE); kill and reset or delete the resource first.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Literal, Protocol

from dtwin.errors import DtwinError, FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.library import Library
from dtwin.iec61499.management.protocol import ManagedBlock, ManagedConnection, ManagementError, RequestAction
from dtwin.iec61499.st.functions import widens
from dtwin.iec61499.types import (
    STRING,
    WSTRING,
    DataType,
    ElementaryType,
    format_literal,
    parse_literal,
)

ResourceState = Literal["IDLE", "RUNNING", "STOPPED", "KILLED"]
Side = Literal["inputs", "outputs", "internals"]
_MOVES: Final[dict[RequestAction, tuple[tuple[ResourceState, ...], ResourceState]]] = {
    "START": (("IDLE", "STOPPED"), "RUNNING"),
    "STOP": (("RUNNING",), "STOPPED"),
    "KILL": (("RUNNING",), "KILLED"),
    "RESET": (("STOPPED", "KILLED"), "IDLE"),
}
"""For every action the states that it is possible in, and the state that it leads to."""
WATCHES: Final = 256
"""Most ports of a resource that are watched at once."""


class Running(Protocol):
    """A network made to run."""

    def start(self) -> None:
        """Issues the COLD event of E_RESTART."""

    def pause(self) -> None:
        """Stops after the STOP event of E_RESTART."""

    def resume(self) -> None:
        """Starts again with the WARM event of E_RESTART."""

    def close(self) -> None:
        """Ends it and lets go of its sockets and timers."""

    def read(self, name: str) -> Any: ...
    def write(self, name: str, value: Any) -> None: ...
    def type_of(self, name: str) -> DataType: ...


Launcher = Callable[[model.FBNetwork, Callable[[], None]], Running]
"""Makes a network run; calls the function given with it when an error has ended it."""


class ManagedResource:
    """One resource; every method raises ManagementError with FORTE's reason when it cannot do what it is asked.

    Args:
        name: the resource's name.
        type_name: the resource's type, which a QUERY tells.
        library: finds the block types that requests name.
        launch: makes a network run; raises FunctionBlockError or CommunicationError when it cannot.
        network: a network from a file, which can be started, stopped, read and written, but not changed; None for one
            that requests put together.
    """

    def __init__(
        self,
        name: str,
        type_name: str,
        library: Library,
        launch: Launcher,
        network: model.FBNetwork | None = None,
    ) -> None:
        self.name = name
        self.type_name = type_name
        self.state: ResourceState = "IDLE"
        self._library = library
        self._launch = launch
        self._running: Running | None = None
        self._blocks: dict[str, model.Block] = {}
        self._parameters: dict[tuple[str, str], str] = {}
        self._presets: dict[str, str] = {}
        self._events: dict[tuple[str, str], model.Connection] = {}
        self._data: dict[str, model.Connection] = {}
        self._watched: dict[str, None] = {}
        self._network = network
        if network is None:
            self.create_block("START", "E_RESTART")
        else:
            self._blocks = {block.name: block for block in network.blocks}
            self._events = {(c.source, c.destination): c for c in network.events}
            self._data = {c.destination: c for c in network.data}

    def blocks(self) -> tuple[ManagedBlock, ...]:
        return tuple(ManagedBlock(block.name, block.type_name) for block in self._blocks.values())

    def connections(self) -> tuple[ManagedConnection, ...]:
        return tuple(
            ManagedConnection(c.source, c.destination) for c in (*self._events.values(), *self._data.values())
        )

    def create_block(self, name: str, type_name: str) -> None:
        self._expect_idle(f"create {name}")
        if not name or name in self._blocks:
            raise ManagementError("INVALID_STATE", f"{self.name} has a block {name!r} already")
        try:
            found = self._library.find(type_name)
        except FunctionBlockError as error:
            raise ManagementError("UNSUPPORTED_TYPE", str(error)) from None
        if isinstance(found, model.SubApplicationType):
            raise ManagementError("UNSUPPORTED_TYPE", f"{type_name} is a subapplication type")
        self._blocks[name] = model.Block(name, type_name)

    def delete_block(self, name: str) -> None:
        """Deletes a block and its connections."""
        self._expect_idle(f"delete {name}")
        if name not in self._blocks:
            raise ManagementError("NO_SUCH_OBJECT", f"{self.name} has no block {name!r}")
        del self._blocks[name]
        self._watched = {port: None for port in self._watched if port.rpartition(".")[0] != name}
        self._parameters = {key: value for key, value in self._parameters.items() if key[0] != name}
        self._presets = {key: value for key, value in self._presets.items() if key.rpartition(".")[0] != name}
        self._events = {key: c for key, c in self._events.items() if name not in _blocks_of(c)}
        self._data = {key: c for key, c in self._data.items() if name not in _blocks_of(c)}

    def connect(self, source: str, destination: str) -> None:
        self._expect_idle(f"connect {source}")
        connection = model.Connection(source, destination)
        if self._is_event(source, destination):
            if (source, destination) in self._events:
                raise ManagementError("INVALID_STATE", f"{source} is connected to {destination} already")
            self._events[source, destination] = connection
            return
        given, wanted = self._variable(source, "outputs").type, self._variable(destination, "inputs").type
        if destination in self._data:
            raise ManagementError("INVALID_STATE", f"{destination} has a source already")
        if given != wanted and not _fits(given, wanted):
            raise ManagementError("INVALID_OPERATION", f"{source} is {given}, {destination} is {wanted}")
        self._data[destination] = connection

    def disconnect(self, source: str, destination: str) -> None:
        self._expect_idle(f"disconnect {source}")
        if self._is_event(source, destination):
            found = self._events.pop((source, destination), None)
        else:
            self._variable(source, "outputs")
            self._variable(destination, "inputs")
            found = self._data.get(destination)
            if found is not None and found.source == source:
                del self._data[destination]
            else:
                found = None
        if found is None:
            raise ManagementError("INVALID_STATE", f"{source} is not connected to {destination}")

    def write(self, name: str, literal: str) -> None:
        """Gives a variable a value: at once when the resource has been started, else for its start."""
        if self._running is not None:
            running = self._running
            value = _value(literal, _found(lambda: running.type_of(name), name))
            _found(lambda: running.write(name, value), name)
            return
        block, _, port = name.rpartition(".")
        variable, side = self._placed(name, "inputs", "outputs", "internals")
        given = literal
        if not isinstance(variable.type, model.GenericType):
            given = format_literal(_value(literal, variable.type), variable.type)
        if side == "inputs":
            self._parameters[block, port] = given
        else:
            self._presets[name] = given

    def read(self, name: str) -> str:
        """The value of a port, printed as FORTE does: strings without quotes."""
        if self._running is not None:
            running = self._running
            return _printed(_found(lambda: running.read(name), name), _found(lambda: running.type_of(name), name))
        block, _, port = name.rpartition(".")
        variable = self._variable(name, "inputs", "outputs", "internals")
        text = self._parameters.get((block, port)) or self._presets.get(name) or variable.initial
        if isinstance(variable.type, model.GenericType):
            return text
        return _printed(_value(text, variable.type) if text else variable.type.default, variable.type)

    def watch(self, name: str) -> None:
        """Adds a port to those that `watched` reads."""
        self.read(name)
        if len(self._watched) >= WATCHES and name not in self._watched:
            raise ManagementError("OVERFLOW", f"{self.name} watches {WATCHES} ports already")
        self._watched[name] = None

    def unwatch(self, name: str) -> None:
        if name not in self._watched:
            raise ManagementError("NO_SUCH_OBJECT", f"{self.name} does not watch {name}")
        del self._watched[name]

    def watched(self) -> dict[str, str]:
        """The values of all watched ports, as `read` prints them."""
        return {name: self.read(name) for name in self._watched}

    def change_state(self, action: RequestAction) -> None:
        """START, STOP, KILL or RESET."""
        sources, target = _MOVES[action]
        if self.state not in sources:
            raise ManagementError("INVALID_STATE", f"{self.name} is {self.state}: cannot {action}")
        if action == "START":
            self._start()
        elif action == "STOP" and self._running is not None:
            self.state = target
            self._running.pause()
        else:
            self.state = target
            self.close()

    def close(self) -> None:
        """Ends what runs."""
        if self._running is not None:
            self._running.close()
            self._running = None

    def _start(self) -> None:
        if self._running is not None:
            self.state = "RUNNING"
            self._running.resume()
            return
        try:
            running = self._launch(self.network(), self._ended)
        except DtwinError as error:
            raise ManagementError("INVALID_OPERATION", f"{self.name} cannot start: {error}") from None
        try:
            for name, literal in self._presets.items():
                running.write(name, _value(literal, running.type_of(name)))
        except DtwinError as error:
            running.close()
            raise ManagementError("INVALID_OPERATION", f"{self.name} cannot start: {error}") from None
        self._running = running
        self.state = "RUNNING"
        running.start()

    def _ended(self) -> None:
        self._running = None
        self.state = "KILLED"

    def network(self) -> model.FBNetwork:
        """What START runs."""
        if self._network is not None:
            return self._network
        given: dict[str, list[model.Parameter]] = {}
        for (block, port), literal in self._parameters.items():
            given.setdefault(block, []).append(model.Parameter(port, literal))
        blocks = [
            model.Block(block.name, block.type_name, tuple(given.get(block.name, ())))
            for block in self._blocks.values()
        ]
        events, data = tuple(self._events.values()), tuple(self._data.values())
        return model.FBNetwork(tuple(blocks), (), events, data, self.name)

    def _expect_idle(self, what: str) -> None:
        if self._network is not None:
            raise ManagementError("INVALID_STATE", f"{self.name} comes from {self._network.file}: cannot {what}")
        if self.state != "IDLE":
            raise ManagementError("INVALID_STATE", f"{self.name} is {self.state}: cannot {what}")

    def _type(self, end: str) -> tuple[model.LibraryElement, str]:
        """The type of the block in `BLOCK.PORT`, and the port."""
        block, _, port = end.rpartition(".")
        if block not in self._blocks:
            raise ManagementError("NO_SUCH_OBJECT", f"{self.name} has no block {block!r}")
        return self._library.find(self._blocks[block].type_name), port

    def _is_event(self, source: str, destination: str) -> bool:
        (sender, output), (receiver, event_input) = self._type(source), self._type(destination)
        ends = (
            output in [event.name for event in sender.interface.event_outputs],
            event_input in [event.name for event in receiver.interface.event_inputs],
        )
        if any(ends) and not all(ends):
            raise ManagementError("NO_SUCH_OBJECT", f"no events at both {source} and {destination}")
        return all(ends)

    def _variable(self, end: str, *sides: Side) -> model.Variable:
        return self._placed(end, *sides)[0]

    def _placed(self, end: str, *sides: Side) -> tuple[model.Variable, Side]:
        """The variable `BLOCK.VARIABLE`, and on which of the sides it is."""
        block, name = self._type(end)
        variables = {
            "inputs": block.interface.inputs,
            "outputs": block.interface.outputs,
            "internals": getattr(block, "internals", ()),
        }
        for side in sides:
            for variable in variables[side]:
                if variable.name == name:
                    return variable, side
        raise ManagementError("NO_SUCH_OBJECT", f"{end} is no data port here")


def _blocks_of(connection: model.Connection) -> tuple[str, str]:
    return connection.source.rpartition(".")[0], connection.destination.rpartition(".")[0]


def _fits(source: model.VariableType, destination: model.VariableType) -> bool:
    if isinstance(source, model.GenericType) or isinstance(destination, model.GenericType):
        return True
    if isinstance(source, ElementaryType) and isinstance(destination, ElementaryType):
        return widens(source, destination)
    return False


def _found(ask: Callable[[], Any], name: str) -> Any:
    try:
        return ask()
    except FunctionBlockError as error:
        raise ManagementError("NO_SUCH_OBJECT", f"{name}: {error}") from None


def _value(literal: str, kind: DataType) -> Any:
    """The value of a literal; the quotes of texts may be missing or of the other kind, as FORTE accepts them."""
    if kind in (STRING, WSTRING):
        quote = "'" if kind == STRING else '"'
        if literal[:1] not in ("'", '"') or literal[-1:] != literal[:1] or len(literal) < 2:
            return literal
        if literal[0] != quote:
            return literal[1:-1]
    try:
        return parse_literal(literal, kind)
    except FunctionBlockError as error:
        raise ManagementError("BAD_PARAMS", str(error)) from None


def _printed(value: Any, kind: DataType) -> str:
    if kind in (STRING, WSTRING):
        return str(value)
    try:
        return format_literal(value, kind)
    except FunctionBlockError:
        # infinities and NaN have no literal
        return str(value)
