"""Checks the Structured Text of a block type, algorithm by algorithm and condition by condition."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.st import typed
from iec61499.st.check import check_algorithm, check_expression
from iec61499.st.parser import parse_algorithm, parse_expression
from iec61499.st.scope import InnerBlock
from iec61499.types import ArrayType, DataType, ElementaryType, StructType, elementary


class BlockChecker:
    """Checks the text of one basic or simple block, none of whose variables may have a generic type."""

    def __init__(self, block: model.BasicFBType | model.SimpleFBType) -> None:
        self._file = block.header.file
        self._scope: dict[str, DataType] = {}
        interface = block.interface
        own = "calls of own algorithms are not supported: expected a state that executes it"
        self._absent = {**{algorithm.name: own for algorithm in block.algorithms}, **dict(block.absent)}
        self._constants: dict[str, tuple[DataType, Any]] = {}
        for variable in (*interface.inputs, *interface.outputs, *block.internals, *block.constants):
            assert not isinstance(variable.type, model.GenericType)
            self._scope[variable.name] = variable.type
            if variable.constant:
                self._constants[variable.name] = variable.type, model.initial_value(variable, self._file)
        assigned = (*interface.outputs, *block.internals)
        self._writable = {variable.name for variable in assigned if not variable.constant}
        self._blocks = tuple(self._inner(inner) for inner in block.blocks)
        self._types = {t.name.upper(): t for data_type in self._scope.values() for t in _derived(data_type)}

    def _inner(self, inner: model.InnerBlock) -> InnerBlock:
        """What the text may know of a block inside: it reads its ports and writes its inputs."""
        interface = inner.type.interface
        inputs = tuple(variable.name for variable in interface.inputs)
        outputs = tuple(variable.name for variable in interface.outputs)
        for variable in getattr(inner.type, "internals", ()):
            del self._scope[f"{inner.name}.{variable.name}"]
        self._writable -= {f"{inner.name}.{v.name}" for v in getattr(inner.type, "internals", ())}
        self._writable -= {f"{inner.name}.{name}" for name in outputs if name not in inputs}
        events = tuple(event.name for event in interface.event_inputs)
        return InnerBlock(inner.name, events, inputs, outputs)

    def algorithm(self, algorithm: model.Algorithm) -> typed.CheckedAlgorithm:
        """The algorithm with every name resolved. Raises FunctionBlockError naming file, line and column."""
        source = algorithm.source
        try:
            tree = parse_algorithm(source.text, self._file, source.line if source.exact else 1, 1)
            return check_algorithm(
                tree, self._scope, self._writable, self._constants, self._find_type, self._blocks, self._absent
            )
        except FunctionBlockError as error:
            if source.exact:
                raise
            where = f"algorithm {algorithm.name}, line {error.line}, column {error.column}"
            raise FunctionBlockError(f"{where}: {error.message}", self._file, source.line) from None

    def _find_type(self, name: str) -> DataType:
        """A type that a declaration in an algorithm names: an elementary one, or one of those that the block has."""
        return self._types.get(name.rpartition("::")[2].upper()) or elementary(name)

    def guard(self, transition: model.ECTransition) -> typed.Expression:
        """The condition of a transition that has one. Raises FunctionBlockError naming file, line and column."""
        try:
            tree = parse_expression(transition.guard, self._file, 1, 1)
            return check_expression(tree, self._scope, constants=self._constants, absent=self._absent)
        except FunctionBlockError as error:
            where = f"condition {transition.guard!r}, column {error.column}"
            raise FunctionBlockError(f"{where}: {error.message}", self._file, transition.line) from None


def _derived(data_type: DataType) -> Iterator[StructType | ElementaryType]:
    """The structures and enumerations that a type consists of."""
    if isinstance(data_type, ArrayType):
        yield from _derived(data_type.element)
    elif isinstance(data_type, StructType):
        yield data_type
        for member in data_type.members:
            yield from _derived(member.type)
    elif data_type.kind == "enum":
        yield data_type
