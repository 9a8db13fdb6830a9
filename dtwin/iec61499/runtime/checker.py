"""Checks the Structured Text of a block type, algorithm by algorithm and condition by condition."""

from __future__ import annotations

from dtwin.errors import FunctionBlockError
from dtwin.iec61499 import model
from dtwin.iec61499.st import typed
from dtwin.iec61499.st.check import check_algorithm, check_expression
from dtwin.iec61499.st.parser import parse_algorithm, parse_expression
from dtwin.iec61499.types import DataType


class BlockChecker:
    """Checks the text of one basic or simple block, none of whose variables may have a generic type."""

    def __init__(self, block: model.BasicFBType | model.SimpleFBType) -> None:
        self._file = block.header.file
        self._scope: dict[str, DataType] = {}
        interface = block.interface
        for variable in (*interface.inputs, *interface.outputs, *block.internals):
            assert not isinstance(variable.type, model.GenericType)
            self._scope[variable.name] = variable.type
        self._writable = {variable.name for variable in (*interface.outputs, *block.internals)}

    def algorithm(self, algorithm: model.Algorithm) -> typed.CheckedAlgorithm:
        """The algorithm with every name resolved. Raises FunctionBlockError naming file, line and column."""
        source = algorithm.source
        try:
            tree = parse_algorithm(source.text, self._file, source.line if source.exact else 1, 1)
            return check_algorithm(tree, self._scope, self._writable)
        except FunctionBlockError as error:
            if source.exact:
                raise
            where = f"algorithm {algorithm.name}, line {error.line}, column {error.column}"
            raise FunctionBlockError(f"{where}: {error.message}", self._file, source.line) from None

    def guard(self, transition: model.ECTransition) -> typed.Expression:
        """The condition of a transition that has one. Raises FunctionBlockError naming file, line and column."""
        try:
            tree = parse_expression(transition.guard, self._file, 1, 1)
            return check_expression(tree, self._scope)
        except FunctionBlockError as error:
            where = f"condition {transition.guard!r}, column {error.column}"
            raise FunctionBlockError(f"{where}: {error.message}", self._file, transition.line) from None
