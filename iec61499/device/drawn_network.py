"""A network that device management draws request by request: blocks, connections, values given to ports."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any, Final, Literal

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.literals import format_literal, parse_literal
from iec61499.management.protocol import ManagedBlock, ManagedConnection, ManagementError
from iec61499.st.functions import widens
from iec61499.types import (
    DataType,
    ElementaryType,
    bytes_of,
    text_of,
)

Side = Literal["inputs", "outputs", "internals"]
SIDES: Final[tuple[Side, ...]] = ("inputs", "outputs", "internals")
_UNFIT: Final = re.compile("[\x00-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")
"""Characters that an attribute of XML does not hand on as they are: control characters, and what is no character."""


class DrawnNetwork:
    """A network to start; every method raises ManagementError with FORTE's reason when it cannot do what it is asked.

    Args:
        owner: the name of the resource, for errors.
        library: finds the block types that requests name.
        network: what is there at first.

    Attributes:
        presets: literals that outputs and internal variables begin with, by `BLOCK.VARIABLE`.
    """

    def __init__(self, owner: str, library: Library, network: model.FBNetwork) -> None:
        self.presets: dict[str, str] = {}
        self._owner = owner
        self._library = library
        self._network = network
        self._blocks = {block.name: block for block in network.blocks}
        self._events = {(c.source, c.destination): c for c in network.events}
        self._data = {c.destination: c for c in network.data}

    def copy(self) -> DrawnNetwork:
        """The same network, to draw on."""
        copied = DrawnNetwork(self._owner, self._library, self.network())
        copied.presets = dict(self.presets)
        return copied

    def variables(self, block: str) -> tuple[str, ...]:
        """The names `BLOCK.VARIABLE` of the ports and internal variables of a block."""
        found = self._type(f"{block}.")[0]
        known = (*found.interface.inputs, *found.interface.outputs, *getattr(found, "internals", ()))
        return tuple(dict.fromkeys(f"{block}.{variable.name}" for variable in known))

    def given(self, block: str) -> set[str]:
        """The variables, `BLOCK.VARIABLE`, of a block that were given a value to begin with."""
        values = {f"{block}.{parameter.name}" for parameter in self._blocks[block].parameters}
        return values | {name for name in self.presets if name.rpartition(".")[0] == block}

    def __contains__(self, block: str) -> bool:
        return block in self._blocks

    def blocks(self) -> tuple[ManagedBlock, ...]:
        return tuple(ManagedBlock(block.name, block.type_name) for block in self._blocks.values())

    def connections(self) -> tuple[ManagedConnection, ...]:
        return tuple(
            ManagedConnection(c.source, c.destination) for c in (*self._events.values(), *self._data.values())
        )

    def network(self) -> model.FBNetwork:
        """What START runs."""
        events, data = tuple(self._events.values()), tuple(self._data.values())
        return replace(self._network, blocks=tuple(self._blocks.values()), events=events, data=data)

    def create_block(self, name: str, type_name: str) -> None:
        if not name or name in self._blocks:
            raise ManagementError("INVALID_STATE", f"{self._owner} has a block {name!r} already")
        try:
            found = self._library.find(type_name)
        except FunctionBlockError as error:
            raise ManagementError("UNSUPPORTED_TYPE", str(error)) from None
        if isinstance(found, model.SubApplicationType):
            raise ManagementError("UNSUPPORTED_TYPE", f"{type_name} is a subapplication type")
        self._blocks[name] = model.Block(name, type_name)

    def delete_block(self, name: str) -> None:
        """Deletes a block and its connections."""
        self.expect_block(name)
        del self._blocks[name]
        self.presets = {key: value for key, value in self.presets.items() if key.rpartition(".")[0] != name}
        self._events = {key: c for key, c in self._events.items() if name not in _blocks_of(c)}
        self._data = {key: c for key, c in self._data.items() if name not in _blocks_of(c)}

    def connect(self, source: str, destination: str) -> None:
        connection = model.Connection(source, destination)
        if self._are_events(source, destination):
            if (source, destination) in self._events:
                raise ManagementError("INVALID_STATE", f"{source} is connected to {destination} already")
            self._events[source, destination] = connection
            return
        given, wanted = self._placed(source, "outputs")[0].type, self._placed(destination, "inputs")[0].type
        if destination in self._data:
            raise ManagementError("INVALID_STATE", f"{destination} has a source already")
        if given != wanted and not _fits(given, wanted):
            raise ManagementError("INVALID_OPERATION", f"{source} is {given}, {destination} is {wanted}")
        self._data[destination] = connection

    def disconnect(self, source: str, destination: str) -> None:
        if self._are_events(source, destination):
            found = self._events.pop((source, destination), None)
        else:
            self._placed(source, "outputs")
            self._placed(destination, "inputs")
            found = self._data.get(destination)
            if found is not None and found.source == source:
                del self._data[destination]
            else:
                found = None
        if found is None:
            raise ManagementError("INVALID_STATE", f"{source} is not connected to {destination}")

    def write(self, name: str, literal: str) -> None:
        """Gives a variable the value that it begins with."""
        block, _, port = name.rpartition(".")
        variable, side = self._placed(name, *SIDES)
        given = literal
        if not isinstance(variable.type, model.GenericType):
            given = format_literal(value_of(literal, variable.type), variable.type)
        if side == "inputs":
            parameters = {p.name: p for p in self._blocks[block].parameters} | {port: model.Parameter(port, given)}
            self._blocks[block] = replace(self._blocks[block], parameters=tuple(parameters.values()))
        else:
            self.presets[name] = given

    def read(self, name: str) -> str:
        """The value that a variable begins with, printed as FORTE does: strings without quotes."""
        block, _, port = name.rpartition(".")
        variable = self._placed(name, *SIDES)[0]
        given = {parameter.name: parameter.value for parameter in self._blocks[block].parameters}
        text = given.get(port) or self.presets.get(name) or variable.initial
        if isinstance(variable.type, model.GenericType):
            return text
        return printed(value_of(text, variable.type) if text else variable.type.default, variable.type)

    def type_of(self, name: str) -> DataType:
        """The data type of the variable `BLOCK.VARIABLE`."""
        kind = self._placed(name, *SIDES)[0].type
        if isinstance(kind, model.GenericType):
            raise ManagementError("INVALID_STATE", f"{name} has no type before the resource runs")
        return kind

    def state_number(self, name: str, state: str) -> int:
        """The number of the state of a chart, `BLOCK.$ECC`; the block may be inside a composite one."""
        block = self._inner(name.rpartition(".")[0])
        assert isinstance(block, model.BasicFBType)
        return [known.name for known in block.states].index(state)

    def is_event(self, name: str) -> bool:
        """Whether `BLOCK.PORT` is an event input or output; the block may be inside a composite one."""
        path, _, port = name.rpartition(".")
        block = self._inner(path)
        if block is None:
            return False
        return port in [event.name for event in (*block.interface.event_inputs, *block.interface.event_outputs)]

    def _inner(self, path: str) -> model.LibraryElement | None:
        """The type of a block, also inside composite ones; None if there is no such block."""
        names = path.split(".")
        outer = next((n for n in range(len(names), 0, -1) if ".".join(names[:n]) in self._blocks), 0)
        if not outer:
            return None
        element = self._library.find(self._blocks[".".join(names[:outer])].type_name)
        for name in names[outer:]:
            inside = {block.name: block for block in getattr(element, "network", model.FBNetwork()).blocks}
            if name not in inside:
                return None
            element = self._library.find(inside[name].type_name)
        return element

    def expect_block(self, name: str) -> None:
        if name not in self._blocks:
            raise ManagementError("NO_SUCH_OBJECT", f"{self._owner} has no block {name!r}")

    def _type(self, end: str) -> tuple[model.LibraryElement, str]:
        """The type of the block in `BLOCK.PORT`, and the port."""
        block, _, port = end.rpartition(".")
        self.expect_block(block)
        return self._library.find(self._blocks[block].type_name), port

    def _are_events(self, source: str, destination: str) -> bool:
        (sender, output), (receiver, event_input) = self._type(source), self._type(destination)
        ends = (
            output in [event.name for event in sender.interface.event_outputs],
            event_input in [event.name for event in receiver.interface.event_inputs],
        )
        if any(ends) and not all(ends):
            raise ManagementError("NO_SUCH_OBJECT", f"no events at both {source} and {destination}")
        return all(ends)

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


def value_of(literal: str, kind: DataType) -> Any:
    """The value of a literal; the quotes of texts may be missing or of the other kind, as FORTE accepts them."""
    if isinstance(kind, ElementaryType) and kind.kind == "string":
        literal = literal.removeprefix(f"{kind.name}#") or literal
        quote = "'" if kind.name == "STRING" else '"'
        bare = literal[:1] not in ("'", '"') or literal[-1:] != literal[:1] or len(literal) < 2
        if bare or literal[0] != quote:
            text = literal if bare else literal[1:-1]
            return kind.wrap(bytes_of(text) if kind.name == "STRING" else text)
    try:
        return parse_literal(literal, kind)
    except FunctionBlockError as error:
        raise ManagementError("BAD_PARAMS", str(error)) from None


def printed(value: Any, kind: DataType) -> str:
    """A value as FORTE prints it: strings without quotes, but one that would not read back so as a literal."""
    if isinstance(kind, ElementaryType) and kind.kind == "string":
        bare = text_of(value) if kind.name == "STRING" else str(value)
        if not _UNFIT.search(bare) and value_of(bare, kind) == value:
            return bare
    try:
        return format_literal(value, kind)
    except FunctionBlockError:
        # infinities and NaN have no literal
        return str(value)
