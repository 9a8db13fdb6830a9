"""Typed expressions to Lua expressions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any, Final

from iec61499.st import typed
from iec61499.st.ast import fail
from iec61499.st.fragment import Fragment, bounds, combine, is_integral, quotient_bounds, remainder_bounds
from iec61499.st.typed import COMPARISONS
from iec61499.types import (
    BOOL,
    LREAL,
    REAL,
    STRING,
    Aggregate,
    ArrayType,
    DataType,
    ElementaryType,
    StructType,
    bytes_of,
    text_of,
)

# Lua's precedence
OR, AND, COMPARISON, CONCATENATION, SUM, PRODUCT, UNARY, ATOM = range(8)

_OPERATORS: Final = {
    "+": ("+", SUM), "-": ("-", SUM), "*": ("*", PRODUCT), "/": ("/", PRODUCT),
    "<": ("<", COMPARISON), ">": (">", COMPARISON), "<=": ("<=", COMPARISON), ">=": (">=", COMPARISON),
    "=": ("==", COMPARISON), "<>": ("~=", COMPARISON),
}  # fmt: skip
_LOGICAL: Final = {"AND": ("and", AND), "OR": ("or", OR), "XOR": ("~=", COMPARISON)}
_EXACT: Final = 1 << 53
_PLAIN: Final = re.compile(r"[\w .:]*", re.ASCII)
_NARROWER: Final = {"LINT": "DINT", "ULINT": "UDINT", "LWORD": "DWORD"}


def refuse(data_type: DataType, node: Any) -> None:
    """Raises for types whose values a Lua number does not hold."""
    while isinstance(data_type, ArrayType):
        data_type = data_type.element
    if isinstance(data_type, StructType):
        fail(node.at, f"structure {data_type} is not available in Lua: expected variables of elementary types")
    if data_type.kind == "enum":
        fail(node.at, f"enumeration {data_type} is not available on 4diac FORTE: expected a UINT")
    if is_integral(data_type) and data_type.bits == 64:
        other = _NARROWER.get(data_type.name, "LREAL seconds or DINT ticks")
        fail(node.at, f"{data_type} has 64 bit and a number in Lua holds integers of 53 bit: expected {other}")


class LuaExpressions:
    """Translates expressions; `used` collects the names of the helpers the code calls."""

    def __init__(self, variable: Callable[[str], str]) -> None:
        self._variable = variable
        self.used: set[str] = set()

    def helper(self, name: str) -> str:
        self.used.add(name)
        return name

    def call(self, name: str, *arguments: object) -> str:
        return f"{self.helper(name)}({', '.join(str(argument) for argument in arguments)})"

    def value(self, node: typed.Expression) -> Fragment:
        """Code for the value, wrapped into its type."""
        return self.wrap(self.raw(node), node.type)

    def text(self, node: typed.Expression) -> str:
        return self.value(node).text

    def wrap(self, fragment: Fragment, data_type: DataType) -> Fragment:
        """The fragment, brought into the range of an integral type when it can lie outside."""
        if not isinstance(data_type, ElementaryType) or not is_integral(data_type):
            return fragment
        low, high = data_type.minimum, data_type.maximum
        if low <= fragment.low and fragment.high <= high:
            return fragment
        period = 1 << data_type.bits
        if low == 0:
            return Fragment(f"{fragment.at_least(PRODUCT)} % {period}", PRODUCT, low, high)
        return Fragment(f"({fragment.at_least(SUM)} + {-low}) % {period} - {-low}", SUM, low, high)

    def raw(self, node: typed.Expression) -> Fragment:
        """Code for the value, or for one congruent to it and below 2^53."""
        refuse(node.type, node)
        match node:
            case typed.Const(type=data_type, value=value):
                return self._constant(data_type, value)
            case typed.Load(type=data_type, name=name):
                return Fragment(self._variable(name), ATOM, *bounds(data_type))
            case typed.Element(type=data_type, name=name, indices=indices, arrays=arrays):
                return Fragment(self._variable(name) + self.subscripts(indices, arrays), ATOM, *bounds(data_type))
            case typed.Convert(type=data_type, operand=operand):
                return self._convert(data_type, operand)
            case typed.Cast():
                return self._cast(node)
            case typed.Unary(operator="-", operand=operand):
                inner = self.raw(operand)
                if is_integral(node.type):
                    zero = Fragment("0", ATOM)
                    return self._folded(self._infix("-", zero, inner, -inner.high, -inner.low), node.type)
                # two signs in a row would start a comment
                return Fragment(f"-{inner.at_least(ATOM)}", UNARY)
            case typed.Unary(type=data_type, operand=operand):
                inner = self.value(operand)
                if data_type.kind == "bool":
                    return Fragment(f"not {inner.at_least(UNARY)}", UNARY)
                return Fragment(f"{data_type.maximum} - {inner.at_least(PRODUCT)}", SUM, *bounds(data_type))
            case typed.Binary():
                return self._binary(node)
            case typed.Call():
                return self._call(node)

    def subscripts(self, indices: tuple[typed.Expression, ...], arrays: tuple[Aggregate, ...]) -> str:
        """`[i][j]`, counted from 1; checked where an index can lie outside."""
        return "".join(f"[{self._offset(i, array)}]" for i, array in zip(indices, arrays, strict=True))

    def _offset(self, node: typed.Expression, array: Aggregate) -> str:
        refuse(array, node)
        assert isinstance(array, ArrayType)
        if isinstance(node, typed.Const):
            return str(node.value - array.lower + 1)
        return self.call("_index", self.text(node), array.lower, array.upper, where(node))

    def _constant(self, data_type: DataType, value: Any) -> Fragment:
        if isinstance(data_type, ArrayType):
            return Fragment("{" + ", ".join(self._constant(data_type.element, v).text for v in value) + "}", ATOM)
        match value:
            case bool():
                return Fragment("true" if value else "false", ATOM)
            case str() if data_type.name == "CHAR":
                return Fragment(f'"\\{ord(value):03d}"', ATOM)
            case str():
                # a STRING has its bytes already, and the text of a WSTRING is UTF-8 in Lua
                text = text_of(value) if data_type == STRING and bytes_of(text_of(value)) == value else value
                return Fragment(quote(text), ATOM)
            case float():
                return self._real_constant(value)
        return Fragment(str(value), UNARY if value < 0 else ATOM, value, value)

    def _real_constant(self, value: float) -> Fragment:
        if value != value:
            return Fragment("(0/0)", ATOM)
        if math.isinf(value):
            return Fragment("-math.huge" if value < 0 else "math.huge", UNARY if value < 0 else ATOM)
        if value == 0 and math.copysign(1.0, value) < 0:
            return Fragment("(-1 / math.huge)", ATOM)  # Lua 5.1 takes the constant -0.0 for 0.0
        return Fragment(repr(value), UNARY if value < 0 else ATOM)

    def _convert(self, data_type: ElementaryType, operand: typed.Expression) -> Fragment:
        inner = self.value(operand)
        if data_type.kind == "real" and is_integral(operand.type):
            return Fragment(f"{inner.at_least(SUM)} + 0.0", SUM)
        if isinstance(operand.type, ElementaryType) and operand.type.kind == "bool":
            return Fragment(f"({inner.at_least(AND)} and 1 or 0)", ATOM, 0, 1)
        if data_type.limit:
            return Fragment(f"string.sub({inner.text}, 1, {data_type.limit})", ATOM)
        return inner

    def _binary(self, node: typed.Binary) -> Fragment:
        operator, left, right = node.operator, node.left, node.right
        if operator in COMPARISONS:
            return self._infix(operator, self.value(left), self.value(right))
        if operator in _LOGICAL:
            a, b = self.value(left), self.value(right)
            if node.type.kind != "bool":
                return Fragment(self.call(f"_{operator.lower()}", a.text, b.text), ATOM, *bounds(node.type))
            symbol, level = _LOGICAL[operator]
            return Fragment(f"{a.at_least(level)} {symbol} {b.at_least(level + 1)}", level)
        if operator == "**" and is_integral(node.type):
            fail(node.at, "** of integers is not available in Lua: expected a product, or LREAL")
        if node.type.kind == "real":
            result = self._real(operator, left, right)
            return self._rounded(result) if node.type == REAL else result
        if operator in ("+", "-", "*"):
            return self._integer(operator, node.type, left, right)
        return self._division(operator, self.value(left), self.value(right))

    def _integer(
        self, operator: str, data_type: ElementaryType, left: typed.Expression, right: typed.Expression
    ) -> Fragment:
        a, b = self.raw(left), self.raw(right)
        if max(map(abs, combine(operator, a, b))) > _EXACT:
            a, b = self.wrap(a, data_type), self.wrap(b, data_type)
        low, high = combine(operator, a, b)
        if max(abs(low), abs(high)) > _EXACT:
            return Fragment(self.call("_mul", a.text, b.text), ATOM, 0, (1 << 32) - 1)
        return self._folded(self._infix(operator, a, b, low, high), data_type)

    def _folded(self, fragment: Fragment, data_type: ElementaryType) -> Fragment:
        """An integral fragment with one possible value becomes it: Lua 5.1 would fold 0 * -1 to -0.0."""
        if not is_integral(data_type) or fragment.low != fragment.high:
            return fragment
        return self._constant(data_type, fragment.low)

    def _infix(self, operator: str, a: Fragment, b: Fragment, low: int = 0, high: int = 0) -> Fragment:
        symbol, level = _OPERATORS[operator]
        return Fragment(f"{a.at_least(level)} {symbol} {b.at_least(level + 1)}", level, low, high)

    def _real(self, operator: str, left: typed.Expression, right: typed.Expression) -> Fragment:
        a, b = self.value(left), self.value(right)
        if operator != "**":
            return self._infix(operator, a, b)
        if isinstance(right, typed.Const) and right.value == 2 and isinstance(left, typed.Load):
            return Fragment(f"{a.text} * {a.text}", PRODUCT)
        return Fragment(self.call("_pow", a.text, b.text), ATOM)

    def _rounded(self, fragment: Fragment) -> Fragment:
        return Fragment(self.call("_f32", fragment.text), ATOM)

    def _division(self, operator: str, a: Fragment, b: Fragment) -> Fragment:
        limits = (quotient_bounds if operator == "/" else remainder_bounds)(a, b)
        if a.low >= 0 and b.low > 0:
            if operator == "MOD":
                return Fragment(f"{a.at_least(PRODUCT)} % {b.at_least(UNARY)}", PRODUCT, *limits)
            return Fragment(self.call("_floor", f"{a.at_least(PRODUCT)} / {b.at_least(UNARY)}"), ATOM, *limits)
        return Fragment(self.call("_idiv" if operator == "/" else "_imod", a.text, b.text), ATOM, *limits)

    def _call(self, node: typed.Call) -> Fragment:
        name, data_type = node.function, node.type
        values = [self.value(argument) for argument in node.arguments]
        texts = [value.text for value in values]
        limits = bounds(data_type)
        match name:
            case "ABS":
                largest = max(abs(values[0].low), abs(values[0].high))
                return Fragment(self.call("_abs", *texts), ATOM, 0, largest)
            case "CONCAT":
                return Fragment(" .. ".join(value.at_least(CONCATENATION) for value in values), CONCATENATION)
            case "LEN":
                return Fragment(f"#{values[0].at_least(ATOM)}", UNARY, 0, 1 << 31)
            case "CHARACTER" | "WITH_CHARACTER":
                if node.arguments[0].type != STRING:
                    fail(
                        node.at, f"a character of a {node.arguments[0].type} is not available in Lua: expected STRING"
                    )
                return Fragment(self.call(f"_{name.lower()}", *texts, where(node)), ATOM)
            case "FIND":
                return Fragment(self.call("_find", *texts), ATOM, 0, 1 << 31)
            case "SEL":
                # only the selected value is computed, as in the other backends
                choice, first, second = (value.at_least(COMPARISON) for value in values)
                if data_type == BOOL:  # a value of false would let Lua's `and` go on to the other one
                    return Fragment(f"({choice} and {{{second}}} or {{{first}}})[1]", ATOM)
                return Fragment(f"({choice} and {second} or {first})", ATOM, *limits)
            case "SHL" | "SHR" | "ROL" | "ROR":
                assert isinstance(data_type, ElementaryType)
                return Fragment(self.call(f"_{name.lower()}", *texts, data_type.bits), ATOM, *limits)
        result = Fragment(self.call(f"_{name.lower()}", *texts), ATOM, *limits)
        computed = name not in ("MIN", "MAX", "MUX")
        return self._rounded(result) if computed and data_type == REAL else result

    def _cast(self, node: typed.Cast) -> Fragment:
        source, target, inner = node.operand.type, node.type, self.value(node.operand)
        assert isinstance(source, ElementaryType)
        text, period = inner.text, 1 << target.bits
        if node.how in ("to_bcd", "from_bcd") or "char" in (source.kind, target.kind):
            fail(node.at, f"conversion of {source} to {target} is not available in Lua: expected arithmetic")
        match source.kind, target.kind:
            case "string", "string":
                return inner
            case "string", "bool":
                return Fragment(self.call("_string_to_bool", text), ATOM)
            case "string", "real":
                number = Fragment(self.call("_string_to_real", text), ATOM)
                return self._rounded(number) if target == REAL else number
            case "string", _:
                return Fragment(
                    self.call("_string_to_int", text, target.minimum, period, quote(target.name)),
                    ATOM,
                    *bounds(target),
                )
            case "bool", "string":
                return Fragment(f'({inner.at_least(AND)} and "TRUE" or "FALSE")', ATOM)
            case "real", "string":
                form = '"%.15g"' if source == LREAL else '"%.6g"'
                return Fragment(self.call("_format", text, form), ATOM)
            case _, "string":
                return Fragment(f'string.format("%d", {text})', ATOM)
            case ("real", "bits") | ("bits", "real"):
                fail(node.at, f"{source}_TO_{target} keeps the bits and is not available in Lua: expected arithmetic")
            case "real", "real":
                return self._rounded(inner) if target == REAL else inner
            case "real", _:
                name = "_trunc" if node.how == "trunc" else "_round"
                return Fragment(self.call(name, text, target.minimum, period), ATOM, *bounds(target))
            case "bool", "real":
                return Fragment(f"({inner.at_least(AND)} and 1.0 or 0.0)", ATOM)
            case "bool", _:
                return Fragment(f"({inner.at_least(AND)} and 1 or 0)", ATOM, 0, 1)
            case _, "bool":
                return Fragment(f"{inner.at_least(CONCATENATION)} ~= 0", COMPARISON)
            case _, "real":
                converted = Fragment(f"{inner.at_least(SUM)} + 0.0", SUM)
                return self._rounded(converted) if target == REAL else converted
        return inner


def where(node: typed.Expression | typed.Statement) -> str:
    """A Lua string with the node's line and column, for runtime errors."""
    return quote(f"{node.at.line}:{node.at.column}")


def quote(text: str) -> str:
    """A Lua string of the text's UTF-8 bytes; words stand in long brackets, which XML need not escape."""
    if _PLAIN.fullmatch(text):
        return f"[[{text}]]"
    encoded = (chr(b) if 32 <= b < 127 and b not in b'"\\' else f"\\{b:03d}" for b in text.encode())
    return '"' + "".join(encoded) + '"'
