"""Types of expressions: syntax tree to typed tree.

Untyped constants take the type of what they meet, constants alone are folded (`1 / 2` is the integer 0),
and values widen implicitly as in IEC 61131-3, figure 12; everything else is an error at its position.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

from iec61499.errors import choices
from iec61499.st import ast, typed
from iec61499.st.ast import fail
from iec61499.st.constants import (
    FOLDABLE,
    FOLDABLE_INTEGERS,
    adapt,
    adapt_text,
    is_character,
    is_untyped,
    unify_texts,
)
from iec61499.st.functions import (
    CLOCK,
    CLOCK_UNITS,
    EXTENSIBLE,
    FUNCTIONS,
    GROUPS,
    OPERATOR_FUNCTIONS,
    Function,
    common_type,
    conversion,
    in_order,
    instead_of,
    widens,
)
from iec61499.st.parts import read_part
from iec61499.st.scope import Place, Scope
from iec61499.st.typed import COMPARISONS
from iec61499.types import (
    BOOL,
    CHAR,
    DINT,
    DWORD,
    ELEMENTARY,
    LINT,
    LREAL,
    REAL,
    TIME,
    ULINT,
    WCHAR,
    DataType,
    ElementaryType,
)

_LOGICAL: Final = frozenset({"AND", "OR", "XOR"})
_MAXIMUM_DEPTH: Final = 150


class ExpressionChecker:
    """Checks expressions against the variables in scope (names compare without case, as in the standard)."""

    def __init__(self, scope: Scope) -> None:
        self._scope = scope
        self._depth = 0

    def checked(self, expression: ast.Expression, expected: ElementaryType) -> typed.Expression:
        """The expression with the expected type."""
        return self.coerce(self.infer(expression), expected)

    def place(self, access: ast.VariableAccess) -> Place:
        """What the text names. Raises FunctionBlockError for an unknown name or a wrong index."""
        return self._scope.place(access, self._index)

    def _index(self, expression: ast.Expression) -> typed.Expression:
        checked = self.default(self.infer(expression))
        if not isinstance(checked.type, ElementaryType) or not checked.type.is_integer:
            fail(expression.at, f"index is {checked.type}: expected an integer")
        return checked

    def infer(self, node: ast.Expression) -> typed.Expression:
        """The typed expression; constants stay untyped until they meet a type."""
        if self._depth > _MAXIMUM_DEPTH:
            fail(node.at, f"expression is nested deeper than {_MAXIMUM_DEPTH} levels")
        self._depth += 1
        try:
            return self._infer(node)
        finally:
            self._depth -= 1

    def _infer(self, node: ast.Expression) -> typed.Expression:
        match node:
            case ast.Literal(at, value, type_name):
                if type_name and type_name not in ELEMENTARY:
                    return self._scope.value(node)
                if type_name:
                    return typed.Const(at, ELEMENTARY[type_name], value)
                kind = BOOL if isinstance(value, bool) else LREAL if isinstance(value, float) else DINT
                return typed.Const(at, kind, value, untyped=kind is not BOOL)
            case ast.VariableAccess(at):
                constant = self._scope.constant(node)
                if constant is not None:
                    return constant
                place = self.place(node)
                return place.load(at) if place.part is None else read_part(at, place)
            case ast.Unary(at, operator, operand):
                return self._unary(at, operator, self.infer(operand))
            case ast.Binary(at, operator, left, right):
                return self._binary(at, operator, self.infer(left), self.infer(right))
            case ast.Call(at, function):
                return self._call(at, function, [self.infer(argument) for argument in in_order(node)])

    def _unary(self, at: ast.Position, operator: str, operand: typed.Expression) -> typed.Expression:
        if operator == "NOT":
            self._demand(self.default(operand), "ANY_BIT", "NOT")
            operand = self.default(operand)
        else:
            if self._elementary(operand).kind not in ("signed", "unsigned", "real", "time"):
                fail(at, f"{operator} needs a number or TIME, got {operand.type}")
            if operator == "+":
                return operand
            if isinstance(operand, typed.Const) and (operand.untyped or self._elementary(operand).kind == "real"):
                return typed.Const(at, operand.type, -operand.value, operand.untyped)
        return typed.Unary(at, self._elementary(operand), operator, operand)

    def _binary(
        self, at: ast.Position, operator: str, left: typed.Expression, right: typed.Expression
    ) -> typed.Expression:
        folded = self._fold(at, operator, left, right)
        if folded is not None:
            return folded
        if operator == "**":
            return typed.Binary(at, *self._power(operator, left, right))
        kinds = {self._elementary(left).kind, self._elementary(right).kind}
        if "time" in kinds and operator in ("*", "/") and kinds != {"time"}:
            return self._scale_time(at, operator, left, right)
        if "date" in kinds and operator in ("+", "-"):
            return self._date_sum(at, operator, left, right)
        left, right = self._unify(at, operator, [left, right])
        common = self._elementary(left)
        if operator in COMPARISONS:
            if common.kind in ("bool", "enum") and operator not in ("=", "<>"):
                fail(at, f"{operator} does not order {common}: expected = or <>")
            return typed.Binary(at, BOOL, operator, left, right)
        if operator in _LOGICAL:
            self._demand(left, "ANY_BIT", operator)
        elif operator == "MOD":
            self._demand(left, "ANY_INT", operator)
        elif not (common.kind in ("time", "bits") and operator in ("+", "-")):
            # sums of bit strings are those of unsigned numbers, as OSCAT and other older libraries have them
            self._demand(left, "ANY_NUM", operator)
            if common.kind == "real" and isinstance(left, typed.Const) and isinstance(right, typed.Const):
                return self._fold_reals(at, common, operator, left, right)
        return typed.Binary(at, common, operator, left, right)

    def _fold_reals(
        self, at: ast.Position, common: ElementaryType, operator: str, left: typed.Const, right: typed.Const
    ) -> typed.Expression:
        """The constant, or the operation when its result is not finite."""
        if operator != "/" or right.value != 0:
            value = common.wrap(FOLDABLE[operator](left.value, right.value))
            if math.isfinite(value):
                return typed.Const(at, common, value)
        return typed.Binary(at, common, operator, left, right)

    def _power(
        self, operator: str, left: typed.Expression, right: typed.Expression
    ) -> tuple[ElementaryType, str, typed.Expression, typed.Expression]:
        """`**` computes in LREAL, or in REAL when both operands fit it; of integers in the type of the base."""
        for operand in (left, right):
            self._demand(operand, "ANY_NUM", operator)
        base = self._elementary(left)
        if base.is_integer and self._elementary(right).is_integer and not is_untyped(left):
            return base, operator, left, self.default(right)
        both = all(t == REAL or widens(t, REAL) for t in (self._elementary(left), self._elementary(right)))
        target = REAL if REAL in (left.type, right.type) and both else LREAL
        if left.type == REAL and isinstance(right, typed.Const) and right.untyped:
            target = REAL
        return target, operator, self.coerce(left, target), self.coerce(right, target)

    def _scale_time(
        self, at: ast.Position, operator: str, left: typed.Expression, right: typed.Expression
    ) -> typed.Expression:
        """`TIME * number`, `number * TIME` or `TIME / number`."""
        if operator == "*" and self._elementary(right).kind == "time":
            left, right = right, left
        if self._elementary(left).kind != "time":
            fail(at, f"{operator} does not divide a number by {right.type}")
        factor = self.default(right)
        self._demand(factor, "ANY_NUM", operator)
        if self._elementary(factor).kind == "real":
            factor = self.coerce(factor, LREAL)
        return typed.Binary(at, self._elementary(left), operator, left, factor)

    def _date_sum(
        self, at: ast.Position, operator: str, left: typed.Expression, right: typed.Expression
    ) -> typed.Expression:
        """`DATE - DATE` is a TIME, `DT + TIME` a DT; a TOD goes on from midnight, and a DATE has no time of day."""
        first, second = self._elementary(left), self._elementary(right)
        if operator == "-" and first == second:
            return typed.Binary(at, TIME, operator, left, right)
        if (first.kind, second.kind) != ("date", "time"):
            fail(at, f"{operator} cannot combine {first} and {second}: expected a date and a TIME")
        moment = ELEMENTARY["LDT" if first.name.startswith("L") else "DT"]
        moved = typed.Binary(at, moment, operator, left, right)
        return moved if first == moment else typed.Cast(at, first, moved, "to")

    def _fold(
        self, at: ast.Position, operator: str, left: typed.Expression, right: typed.Expression
    ) -> typed.Expression | None:
        """The untyped constant that an operation on two of them gives; None when it is not one."""
        if not (isinstance(left, typed.Const) and left.untyped and isinstance(right, typed.Const) and right.untyped):
            return None
        a, b = left.value, right.value
        if max(abs(a), abs(b)) > ULINT.maximum or (b == 0 and operator in ("/", "MOD")):
            return None
        foldable = FOLDABLE_INTEGERS if isinstance(a, int) and isinstance(b, int) else FOLDABLE
        if operator not in foldable:
            return None
        value = foldable[operator](a, b)
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return typed.Const(at, LREAL if isinstance(value, float) else DINT, value, untyped=True)

    def _call(self, at: ast.Position, name: str, arguments: list[typed.Expression]) -> typed.Expression:
        if name in OPERATOR_FUNCTIONS:
            return self._operator_call(at, name, arguments)
        if name.startswith("TO_") and name[3:] in ELEMENTARY:
            self._count(at, name, arguments, 1, 1)
            arguments = [self.default(arguments[0])]
            if self._elementary(arguments[0]).name == name[3:]:
                return arguments[0]
            name = f"{self._elementary(arguments[0]).name}_{name}"
        if name in ("CONCAT_DATE_TOD", "CONCAT_LDATE_LTOD"):
            self._count(at, name, arguments, 2, 2)
            long = "L" if name.startswith("CONCAT_L") else ""
            day, time = (
                self.coerce(a, ELEMENTARY[long + n]) for a, n in zip(arguments, ("DATE", "TOD"), strict=True)
            )
            return typed.Binary(at, ELEMENTARY[f"{long}DT"], "+", day, time)
        cast = conversion(name)
        if cast is not None:
            source, target, how = cast
            self._count(at, name, arguments, 1, 1)
            operand = self.coerce(arguments[0], source)
            if target.kind == "real" and source.is_number and isinstance(operand, typed.Const):
                return typed.Const(at, target, target.wrap(operand.value))
            return typed.Cast(at, target, operand, how)
        if name in (CLOCK, "TIME"):
            self._count(at, name, arguments, 0, 0)
            return typed.Call(at, TIME, CLOCK, ())
        if name in CLOCK_UNITS and not self._scope.reason(name):
            self._count(at, name, arguments, 0, 0)
            count = typed.Cast(at, ULINT, typed.Call(at, TIME, CLOCK, ()), CLOCK_UNITS[name])
            return typed.Cast(at, DWORD, count, "to")
        function = FUNCTIONS.get(name)
        if function is None:
            fail(at, self._scope.reason(name) or f"unknown function {name}: expected {instead_of(name)}")
        arguments, result = self._arguments(at, name, function, arguments)
        if name == "MOVE":
            return arguments[0]
        if name == "TRUNC":
            return typed.Cast(at, DINT if arguments[0].type == REAL else LINT, arguments[0], "trunc")
        if name in ("MIN", "MAX", "CONCAT"):
            folded = arguments[0]
            for argument in arguments[1:]:
                folded = typed.Call(at, result, name, (folded, argument))
            return folded
        if name == "LIMIT":
            low, value, high = arguments
            return typed.Call(at, result, "MIN", (typed.Call(at, result, "MAX", (value, low)), high))
        return typed.Call(at, result, name, tuple(arguments))

    def _operator_call(self, at: ast.Position, name: str, arguments: list[typed.Expression]) -> typed.Expression:
        self._count(at, name, arguments, 2, None if name in EXTENSIBLE else 2)
        operator = OPERATOR_FUNCTIONS[name]
        if operator in COMPARISONS:
            results = [self._binary(at, operator, left, right) for left, right in pairwise(arguments)]
            operator = "AND"
        else:
            results = arguments
        folded = results[0]
        for result in results[1:]:
            folded = self._binary(at, operator, folded, result)
        return folded

    def _arguments(
        self, at: ast.Position, name: str, function: Function, arguments: list[typed.Expression]
    ) -> tuple[list[typed.Expression], ElementaryType]:
        """The arguments with their parameters' types, and the type of the result."""
        count = len(function.parameters)
        self._count(at, name, arguments, count, None if function.variadic else count)
        common = [i for i in range(len(arguments)) if min(i, count - 1) in function.common]
        group = function.parameters[function.common[0]]
        values = self._unify(at, name, [self._to_group(arguments[i], group) for i in common])
        for i, value in zip(common, values, strict=True):
            self._demand(value, group, name)
            arguments[i] = value
        for i, argument in enumerate(arguments):
            if i not in common:
                arguments[i] = self.default(argument)
                self._demand(arguments[i], function.parameters[min(i, count - 1)], name)
        return arguments, function.result or self._elementary(values[0])

    def _to_group(self, argument: typed.Expression, group: str) -> typed.Expression:
        """Integers become LREAL where a function asks for reals."""
        data_type = self._elementary(argument)
        if group == "ANY_REAL" and data_type.is_integer:
            return self.coerce(argument, LREAL)
        return argument

    def _unify(self, at: ast.Position, name: str, values: Sequence[typed.Expression]) -> list[typed.Expression]:
        """The values, all converted to their common type."""
        values = unify_texts(values)
        known = [self._elementary(v) for v in values if not (isinstance(v, typed.Const) and v.untyped)]
        target = known[0] if known else None
        for data_type in known[1:]:
            target = self._common(at, name, target, data_type)
        for value in values:
            if isinstance(value, typed.Const) and value.untyped and (target is None or adapt(value, target) is None):
                own = self._elementary(self.default(value))
                target = own if target is None else self._common(at, name, target, own)
        assert target is not None
        if target.limit:
            target = ELEMENTARY[target.name]
        return [self.coerce(value, target) for value in values]

    def _common(
        self, at: ast.Position, name: str, first: ElementaryType | None, second: ElementaryType
    ) -> ElementaryType:
        assert first is not None
        common = common_type(first, second)
        if common is None:
            hint = f"{first}_TO_{second} or {second}_TO_{first}"
            possible = [f for f in hint.split(" or ") if conversion(f)]
            advice = f"; convert with {choices(possible)}" if possible else ""
            if name in COMPARISONS and first == BOOL:
                advice = "; two comparisons are joined by AND"
            fail(at, f"{name} cannot combine {first} and {second}: expected operands of one type{advice}")
        return common

    def coerce(self, value: typed.Expression, target: DataType) -> typed.Expression:
        """The value as target; widening is implicit, everything else an error."""
        if isinstance(value, typed.Const) and value.untyped and isinstance(target, ElementaryType):
            adapted = adapt(value, target)
            if adapted is not None:
                return adapted
            if isinstance(value.value, int) and (target.is_integer or target.kind in ("bits", "bool")):
                fail(
                    value.at, f"{value.value} is out of range: expected {target} {target.minimum} to {target.maximum}"
                )
            value = self.default(value)
        if value.type == target:
            return value
        if isinstance(value, typed.Const) and is_character(value.value) and target in (CHAR, WCHAR):
            return typed.Const(value.at, target, value.value)
        text = adapt_text(value, target) if isinstance(value, typed.Const) else None
        if text is not None:
            return text
        if isinstance(value.type, ElementaryType) and isinstance(target, ElementaryType):
            if widens(value.type, target):
                if isinstance(value, typed.Const):
                    return typed.Const(value.at, target, target.wrap(value.value))
                return typed.Convert(value.at, target, value)
            name = f"{value.type}_TO_{target}"
            if conversion(name):
                fail(value.at, f"{value.type} does not fit {target}: expected {target}, or convert with {name}")
        fail(value.at, f"got {value.type}, expected {target}")

    def default(self, value: typed.Expression) -> typed.Expression:
        """An untyped constant with the type it has alone: DINT (LINT, ULINT when larger) or LREAL."""
        if not isinstance(value, typed.Const) or not value.untyped:
            return value
        candidates = (LREAL,) if isinstance(value.value, float) else (DINT, LINT, ULINT)
        for candidate in candidates:
            adapted = adapt(value, candidate)
            if adapted is not None:
                return adapted
        fail(value.at, f"{value.value} is out of range: expected {LINT.minimum} to {ULINT.maximum}")

    def _elementary(self, value: typed.Expression) -> ElementaryType:
        if not isinstance(value.type, ElementaryType):
            fail(value.at, f"{value.type} cannot be computed with: expected one of its elements")
        return value.type

    def _demand(self, value: typed.Expression, group: str, name: str) -> None:
        kind = self._elementary(value).kind
        if kind not in GROUPS[group]:
            advice = "; texts are joined by CONCAT" if name == "+" and kind == "string" else ""
            fail(value.at, f"{name} expects {group}, got {value.type}{advice}")

    def _count(
        self, at: ast.Position, name: str, arguments: Sequence[object], minimum: int, maximum: int | None
    ) -> None:
        if len(arguments) < minimum or (maximum is not None and len(arguments) > maximum):
            expected = f"{minimum}" if maximum == minimum else f"at least {minimum}"
            fail(at, f"{name} takes {expected} argument{'s' * (expected != '1')}, got {len(arguments)}")
