"""The blocks of a resource with their variables, found by name."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter
from typing import Any, Final

from iec61499 import model
from iec61499.errors import FunctionBlockError, choices
from iec61499.runtime.checks import Checks, EndOfTest
from iec61499.runtime.communication import CommunicationPort
from iec61499.runtime.compile import CompiledType, compile_type
from iec61499.runtime.linking.netlist import Node
from iec61499.st.python.expressions import python_name
from iec61499.types import ArrayType, DataType, StructType

UNCHANGED: Final = "machine code stays as it is while it runs: expected a resource that is stopped and built anew"
"""What is said when a resource is to be changed that machine code executes."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """The state of a resource between events: the values of all variables and charts, pending timers, time in ns."""

    time: int
    sequence: int
    timers: tuple[tuple[int, int, int], ...]
    values: tuple[tuple[Any, ...], ...]


class Blocks:
    """Instances of block types, in the order of the nodes of a netlist; values may be read and written at will.

    Attributes:
        checks: what TEST_CONDITION blocks have found; another object may be put in its place.
    """

    def __init__(self) -> None:
        self.checks = Checks()
        self._types: list[CompiledType] = []
        self._instances: list[Any] = []
        self._initial: list[tuple[Any, ...]] = []
        self._index: dict[str, int] = {}
        self._parameters: list[dict[str, model.Parameter]] = []

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

    def states(self) -> dict[str, dict[str, Any]]:
        """The values of all variables, by block and name."""
        return {
            name: {
                variable.name: getattr(self._instances[index], python_name(variable.name))
                for variable in _variables(self._types[index].block)
            }
            for name, index in self._index.items()
        }

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

    def enter_state(self, name: str, state: str) -> None:
        """Lets the chart of a block be in a state, without the state's actions.

        Raises:
            FunctionBlockError: there is no such block, or its chart has no state of that name.
        """
        index = self._find(name)
        states = [known.name for known in getattr(self._types[index].block, "states", ())]
        if state not in states or not isinstance(self._types[index].block, model.BasicFBType):
            raise FunctionBlockError(
                f"{name} has no state {state!r}: expected {choices(states) if states else 'none'}"
            )
        self._instances[index].state__ = states.index(state)

    def variable_type(self, name: str) -> DataType:
        """The type of a variable, `BLOCK.VARIABLE`. Raises FunctionBlockError as `read` does."""
        _, variable = self._locate(name)
        if variable is None:
            raise FunctionBlockError(f"{name} is the state of a chart and has no data type: expected a variable")
        return _data_type(variable)

    def reset_block(self, name: str) -> None:
        """Puts the variables and charts of a block, and of what is inside it, back to the beginning."""
        for index in self._inside(name):
            self._types[index].load(self._instances[index], self._initial[index])

    def _inside(self, name: str) -> list[int]:
        return [index for known, index in self._index.items() if known == name or known.startswith(f"{name}.")]

    def _compiled(self, node: Node) -> CompiledType:
        """The compiled type of a node: the one before if it is of the same type."""
        assert node.type is not None
        before = self._index.get(node.name)
        if before is not None and (self._types[before].block is node.type or self._types[before].block == node.type):
            return self._types[before]
        return compile_type(node.type)

    def _initial_state(self, node: Node, kind: CompiledType) -> tuple[Any, ...]:
        """The initial state of a node: the one before if neither type nor parameters have changed."""
        before = self._index.get(node.name)
        if before is not None and self._types[before] is kind:
            given = self._parameters[before]
            if given is node.parameters or given == node.parameters:
                return self._initial[before]
        return initial_state(node, kind)

    def _find(self, name: str) -> int:
        try:
            return self._index[name]
        except KeyError:
            raise FunctionBlockError(f"unknown block {name!r}: {_hint(name, list(self._index))}") from None

    def _owner(self, name: str) -> str:
        """The block of a port; further names are those of an adapter, or of blocks inside a basic one."""
        block = owner = name.rpartition(".")[0]
        while owner not in self._index and "." in owner:
            owner = owner.rpartition(".")[0]
        return owner if owner in self._index else block

    def _locate(self, name: str) -> tuple[int, model.Variable | None]:
        block = self._owner(name)
        variable = name.removeprefix(f"{block}.")
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


def initial_state(node: Node, kind: CompiledType) -> tuple[Any, ...]:
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


def located(error: Exception, event: str) -> FunctionBlockError:
    """The error as one of the block that got the event."""
    if isinstance(error, EndOfTest):
        return error
    if isinstance(error, FunctionBlockError):
        return FunctionBlockError(f"{event}: {error.message}", error.file, error.line, error.column)
    return FunctionBlockError(f"{event}: {type(error).__name__}: {error}")


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
