"""Checks whole algorithms and conditions: names, types, writability, loops."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from typing import Any, Final, TypeAlias

from iec61499 import types
from iec61499.errors import FunctionBlockError, choices
from iec61499.st import ast, typed
from iec61499.st.ast import fail
from iec61499.st.dataflow import needed_initialisations
from iec61499.st.expressions import ExpressionChecker
from iec61499.st.parts import with_part
from iec61499.st.scope import InnerBlock, Place, Scope
from iec61499.types import BOOL, ArrayType, DataType, ElementaryType, elements

_MAXIMUM_DEPTH: Final = 60
_MAXIMUM_LOOPS: Final = 15
"""Most loops inside one another; Python nests 20 blocks at most."""
_SELECTORS: Final = ("signed", "unsigned", "bits", "enum")
_MAXIMUM_LABELS: Final = 2_000
"""Most labels of one CASE; code for more is beyond what Python nests."""


Constants: TypeAlias = Mapping[str, tuple[DataType, Any]]


def check_algorithm(
    algorithm: ast.ParsedAlgorithm,
    scope: Mapping[str, DataType],
    writable: Set[str],
    constants: Constants | None = None,
    find_type: Callable[[str], DataType] = types.elementary,
    blocks: Sequence[InnerBlock] = (),
    absent: Mapping[str, str] | None = None,
) -> typed.CheckedAlgorithm:
    """Resolves names, types every expression and makes conversions explicit.

    Args:
        algorithm: the syntax tree.
        scope: the block's variables, as declared; the text may write them in any case.
        writable: the names of the variables that the algorithm may assign.
        constants: type and value of what cannot be assigned and is known, by name.
        find_type: finds the type of a declaration by its name; raises FunctionBlockError for an unknown one.
        blocks: the blocks inside this one, which the text may let react.
        absent: why there is no constant of a name.

    Raises:
        FunctionBlockError: the text is wrong; names file, line, column and what would have been valid.
    """
    checker = _AlgorithmChecker(Scope(scope, constants, blocks, absent), writable, find_type)
    initial = checker.declarations(algorithm.declarations)
    body = checker.body(algorithm.body)
    body = needed_initialisations(initial, body) + body
    used = {n.name for n in typed.walk(body) if isinstance(n, (typed.Load, typed.Element, typed.Store, typed.For))}
    return typed.CheckedAlgorithm(
        algorithm.name,
        body,
        {name: data_type for name, data_type in scope.items() if name in used},
        checker.temporaries,
    )


def check_expression(
    expression: ast.Expression,
    scope: Mapping[str, DataType],
    expected: ElementaryType = BOOL,
    constants: Constants | None = None,
    absent: Mapping[str, str] | None = None,
) -> typed.Expression:
    """The typed expression, converted to the expected type. Raises as `check_algorithm` does."""
    return ExpressionChecker(Scope(scope, constants, absent=absent)).checked(expression, expected)


class _AlgorithmChecker:
    def __init__(self, scope: Scope, writable: Set[str], find_type: Callable[[str], DataType]) -> None:
        self._scope = scope
        self._find_type = find_type
        self._expressions = ExpressionChecker(scope)
        self._writable = set(writable)
        self._depth = 0
        self._loops = 0
        self._elements = 0
        self._counters: dict[str, ast.Position] = {}
        self.temporaries: dict[str, DataType] = {}

    def declarations(self, declarations: tuple[ast.Declaration, ...]) -> typed.Body:
        """Adds the temporaries to the scope; gives the statements that initialise them."""
        return tuple(self._declaration(declaration) for declaration in declarations)

    def _declaration(self, declaration: ast.Declaration) -> typed.Statement:
        data_type = self._type(declaration.type_name)
        value = self._initial(declaration, data_type)
        self._scope.declare(declaration.at, declaration.name, data_type)
        self.temporaries[declaration.name] = data_type
        self._elements += elements(data_type)
        if self._elements > types.MAXIMUM_ELEMENTS:
            fail(
                declaration.at,
                f"the algorithm's own variables have {self._elements} elements: expected at most "
                f"{types.MAXIMUM_ELEMENTS}",
            )
        if not declaration.constant:
            self._writable.add(declaration.name)
        elif isinstance(value, typed.Const):
            self._scope.set_constant(declaration.name, data_type, value.value)
        return typed.Store(declaration.at, data_type, declaration.name, (), (), value)

    def _type(self, name: ast.TypeName) -> DataType:
        try:
            data_type = self._find_type(name.name)
            for bounds in reversed(name.bounds):
                data_type = ArrayType(data_type, self._constant(bounds.low), self._constant(bounds.high))
        except FunctionBlockError as error:
            fail(name.at, error.message)
        return data_type

    def _initial(self, declaration: ast.Declaration, data_type: DataType) -> typed.Expression:
        initial = declaration.initial
        if initial is None:
            return typed.Const(declaration.at, data_type, data_type.default)
        if not isinstance(initial, ast.Elements):
            return self._expressions.coerce(self._expressions.infer(initial), data_type)
        if not isinstance(data_type, ArrayType):
            fail(declaration.at, f"{declaration.name} is a {data_type}: a list starts an array only")
        return typed.Const(declaration.at, data_type, self._values(initial, data_type))

    def _values(self, given: ast.Elements, array: ArrayType) -> list[object]:
        """The value of an array; of one with several dimensions the elements may stand in one flat list."""
        element = array.element
        if isinstance(element, ArrayType) and not any(isinstance(item, ast.Elements) for item in given.items):
            flat = self._values(given, ArrayType(_innermost(element), 0, array.elements - 1))
            return _nested(iter(flat), array)
        values: list[object] = []
        for item in given.items:
            count, value = (item.count, item.value) if isinstance(item, ast.Repeated) else (1, item)
            if len(values) + count > array.length:
                fail(item.at, f"more values than the {array.length} elements of {array}")
            if isinstance(value, ast.Elements):
                if not isinstance(element, ArrayType):
                    fail(value.at, f"a list within the list: expected {element}")
                values += [self._values(value, element)] * count
                continue
            constant = self._expressions.coerce(self._expressions.infer(value), element)
            if not isinstance(constant, typed.Const):
                fail(value.at, "expected a constant")
            values += [constant.value] * count
        return array.wrap(values)

    def body(self, statements: tuple[ast.Statement, ...]) -> typed.Body:
        self._depth += 1
        if statements and self._depth > _MAXIMUM_DEPTH:
            fail(statements[0].at, f"statements are nested deeper than {_MAXIMUM_DEPTH} levels")
        checked = tuple(part for statement in statements for part in self._statements(statement))
        self._depth -= 1
        return checked

    def _invocation(self, node: ast.Invocation) -> typed.Body:
        """Stores to the block's inputs, its reaction, stores from its outputs."""
        block, event = self._reaction(node.block)
        before: list[typed.Statement] = []
        after: list[typed.Statement] = []
        for argument in node.arguments:
            at, ports = argument.at, block.outputs if argument.is_output else block.inputs
            port = next((name for name in ports if name.upper() == argument.name.upper()), None)
            if port is None:
                kind, expected = "output" if argument.is_output else "input", choices(ports) if ports else "none"
                fail(at, f"{block.name} has no {kind} {argument.name}: expected {expected}")
            own = ast.VariableAccess(at, block.name, (ast.Member(at, port),))
            if not argument.is_output:
                before.append(self._assignment(at, own, argument.value))
            if port in block.outputs:
                if not isinstance(argument.value, ast.VariableAccess):
                    fail(at, f"{argument.name} of {block.name} gives a value back: expected a variable")
                after.append(self._assignment(at, argument.value, own))
        return (*before, typed.Invoke(node.at, block.name, event), *after)

    def _reaction(self, access: ast.VariableAccess) -> tuple[InnerBlock, str]:
        """The block that an invocation names, and the event."""
        blocks = self._scope.blocks
        block, steps = blocks.get(access.name.upper()), access.steps
        if block is None and access.name.upper() == "THIS":
            fail(access.at, "calls of own algorithms by THIS are not supported: expected a state that executes them")
        if block is None and self._scope.reason(access.name):
            fail(access.at, f"{access.name}: {self._scope.reason(access.name)}")
        if block is None:
            expected = choices([known.name for known in blocks.values()]) if blocks else "none, as there is none"
            fail(access.at, f"unknown block {access.name}: expected {expected}")
        named = [step.name for step in steps if isinstance(step, ast.Member)]
        wanted = [name.upper() for name in named]
        event = next((name for name in block.events if not steps or [name.upper()] == wanted), None)
        if event is None or len(named) != len(steps):
            expected = choices(block.events) if block.events else "none"
            fail(access.at, f"{block.name} has no such event input: expected {expected}")
        return block, event

    def _assignment(self, at: ast.Position, target: ast.VariableAccess, value: ast.Expression) -> typed.Store:
        place = self._target(target)
        checked = self._expressions.coerce(self._expressions.infer(value), place.part or place.type)
        if place.part is not None:
            checked = with_part(at, place, checked)
        return typed.Store(at, place.type, place.name, place.indices, place.aggregates, checked)

    def _statements(self, node: ast.Statement) -> typed.Body:
        match node:
            case ast.Assignment(at, target, value):
                return (self._assignment(at, target, value),)
            case ast.Invocation():
                return self._invocation(node)
        return (self._control(node),)

    def _control(
        self, node: ast.If | ast.Case | ast.For | ast.While | ast.Repeat | ast.Exit | ast.Continue | ast.Return
    ) -> typed.Statement:
        match node:
            case ast.If(at, branches, otherwise):
                checked_branches = tuple(
                    typed.Branch(self._condition(b.condition), self.body(b.body)) for b in branches
                )
                return typed.If(at, checked_branches, self.body(otherwise))
            case ast.Case():
                return self._case(node)
            case ast.For():
                return self._for(node)
            case ast.While(at, condition, body):
                return typed.While(at, self._condition(condition), self._loop(body))
            case ast.Repeat(at, body, condition):
                return typed.Repeat(at, self._loop(body), self._condition(condition))
            case ast.Exit(at):
                self._demand_loop(at, "EXIT")
                return typed.Exit(at)
            case ast.Continue(at):
                self._demand_loop(at, "CONTINUE")
                return typed.Continue(at)
            case ast.Return(at):
                return typed.Return(at)

    def _condition(self, expression: ast.Expression) -> typed.Expression:
        return self._expressions.checked(expression, BOOL)

    def _target(self, target: ast.VariableAccess) -> Place:
        place = self._expressions.place(target)
        if place.name not in self._writable:
            expected = choices(sorted(self._writable)) if self._writable else "none, nothing is writable here"
            fail(target.at, f"{place.name} cannot be assigned here: expected {expected}")
        if place.name in self._counters:
            line = self._counters[place.name].line
            fail(target.at, f"{place.name} counts the FOR loop of line {line} and cannot be assigned inside it")
        return place

    def _case(self, node: ast.Case) -> typed.Case:
        selector = self._expressions.default(self._expressions.infer(node.selector))
        data_type = selector.type
        if not isinstance(data_type, ElementaryType) or data_type.kind not in _SELECTORS:
            fail(
                node.selector.at,
                f"CASE by {data_type} is not supported: expected an integer, bit string or enumeration",
            )
        count = sum(len(branch.labels) for branch in node.branches)
        if count > _MAXIMUM_LABELS:
            fail(node.at, f"CASE has {count} labels: expected at most {_MAXIMUM_LABELS}")
        branches = []
        for branch in node.branches:
            labels = tuple(self._label(label, data_type) for label in branch.labels)
            branches.append(typed.CaseBranch(labels, self.body(branch.body)))
        return typed.Case(node.at, selector, tuple(branches), self.body(node.otherwise))

    def _label(self, label: ast.Expression | ast.Range, data_type: ElementaryType) -> tuple[int, int]:
        if not isinstance(label, ast.Range):
            value = self._constant(label, data_type)
            return value, value
        low, high = self._constant(label.low, data_type), self._constant(label.high, data_type)
        if low > high:
            fail(label.at, f"range {low}..{high} is empty: expected low <= high")
        return low, high

    def _constant(self, expression: ast.Expression, data_type: ElementaryType = types.DINT) -> int:
        value = self._expressions.checked(expression, data_type)
        if isinstance(value, typed.Unary) and isinstance(value.operand, typed.Const):
            return -value.operand.value
        if not isinstance(value, typed.Const):
            fail(expression.at, "expected a constant")
        return value.value

    def _for(self, node: ast.For) -> typed.For:
        place = self._target(node.variable)
        name, data_type = place.name, place.type
        if place.indices or place.part or not isinstance(data_type, ElementaryType) or not data_type.is_integer:
            fail(node.variable.at, f"FOR counts with {data_type}: expected an integer variable without index")
        start = self._expressions.checked(node.start, data_type)
        stop = self._expressions.checked(node.stop, data_type)
        step: typed.Expression = typed.Const(node.at, data_type, 1)
        if node.step is not None:
            step = self._expressions.checked(node.step, data_type)
            if isinstance(step, typed.Const) and step.value == 0:
                fail(node.step.at, "BY 0 never ends: expected another step")
        self._counters[name] = node.at
        body = self._loop(node.body)
        del self._counters[name]
        return typed.For(node.at, data_type, name, start, stop, step, body)

    def _loop(self, statements: tuple[ast.Statement, ...]) -> typed.Body:
        self._loops += 1
        if statements and self._loops > _MAXIMUM_LOOPS:
            fail(statements[0].at, f"loops are nested deeper than {_MAXIMUM_LOOPS} levels")
        body = self.body(statements)
        self._loops -= 1
        return body

    def _demand_loop(self, at: ast.Position, name: str) -> None:
        if not self._loops:
            fail(at, f"{name} stands outside of a loop: expected FOR, WHILE or REPEAT around it")


def _innermost(data_type: DataType) -> DataType:
    return _innermost(data_type.element) if isinstance(data_type, ArrayType) else data_type


def _nested(flat: Iterator[object], array: ArrayType) -> list[object]:
    """The elements of a flat list in the order of the array's dimensions."""
    element = array.element
    return [_nested(flat, element) if isinstance(element, ArrayType) else next(flat) for _ in range(array.length)]
