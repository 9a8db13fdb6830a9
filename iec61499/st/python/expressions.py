"""Typed expressions to Python expressions over local variables (or attributes, for conditions)."""

from __future__ import annotations

import builtins
import keyword
import math
import re
from collections.abc import Callable
from typing import Any, Final

from iec61499.st import typed
from iec61499.st.fragment import Fragment, bounds, combine, is_integral, quotient_bounds, remainder_bounds
from iec61499.st.functions import CLOCK
from iec61499.st.typed import COMPARISONS
from iec61499.types import LREAL, REAL, Aggregate, ArrayType, DataType, ElementaryType, StructType

# Python's precedence; walrus and conditional expressions are always put in parentheses
OR, AND, NOT, COMPARISON, BIT_OR, BIT_XOR, BIT_AND, SHIFT, SUM, PRODUCT, UNARY, ATOM = range(12)

_OPERATORS: Final = {
    "+": ("+", SUM), "-": ("-", SUM), "*": ("*", PRODUCT), "/": ("/", PRODUCT),
    "<": ("<", COMPARISON), ">": (">", COMPARISON), "<=": ("<=", COMPARISON), ">=": (">=", COMPARISON),
    "=": ("==", COMPARISON), "<>": ("!=", COMPARISON),
}  # fmt: skip
_LOGICAL: Final = {"AND": ("and", AND), "OR": ("or", OR), "XOR": ("!=", COMPARISON)}
_BITWISE: Final = {"AND": ("&", BIT_AND), "OR": ("|", BIT_OR), "XOR": ("^", BIT_XOR)}
_REAL_FUNCTIONS: Final = frozenset({"SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2"})
_TEXT_FUNCTIONS: Final = frozenset({"CONCAT", "LEFT", "RIGHT", "MID", "INSERT", "REPLACE", "DELETE"})
_DAY: Final = 86_400_000_000_000
_UNITS: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}


_TAKEN: Final = frozenset((*keyword.kwlist, *dir(builtins)))


def python_name(name: str) -> str:
    """The Python identifier of a variable.

    A plain name stays as it is. Names that Python or the generated code may take (keywords, built-in functions, outer
    underscores) and those of adapters (`PLUG.DT`) get two underscores, which no IEC identifier contains.
    """
    if name in _TAKEN or name[0] == "_" or name[-1] == "_" or "." in name:
        return "v__" + name.replace(".", "__")
    return name


def reaction_name(block: str, event: str) -> str:
    """The function with which a block inside another one reacts to an event."""
    return f"{block.replace('.', '__')}__on_{event}"


def wiring_name(event: str) -> str:
    """The attribute of an instance that holds the queue entries which an output event is connected to."""
    return "to__" + event.replace(".", "__")


class PythonExpressions:
    """Translates expressions.

    Attributes:
        raises: whether some fast form can raise where the exact one gives an infinity or a NaN.
        used: the names of the helpers that the code calls.
        known: the bounds of variables (loop counters) that are narrower than those of their types.
    """

    def __init__(self, variable: Callable[[str], str], exact: bool, instance: str) -> None:
        self._variable = variable
        self._instance = instance
        self._exact = exact
        self._temporaries = 0
        self.raises = False
        self.used: set[str] = set()
        self.known: dict[str, tuple[int, int]] = {}

    def temporary(self) -> str:
        """A fresh local name; no variable's name ends in a digit behind a leading underscore."""
        self._temporaries += 1
        return f"_{self._temporaries}"

    def helper(self, name: str) -> str:
        self.used.add(name)
        return name

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
        mask = (1 << data_type.bits) - 1
        if low == 0:
            return Fragment(f"{fragment.at_least(SHIFT)} & {mask}", BIT_AND, low, high)
        return Fragment(f"({fragment.at_least(SUM)} + {-low} & {mask}) - {-low}", SUM, low, high)

    def raw(self, node: typed.Expression) -> Fragment:
        """Code for the value, or for one congruent to it."""
        match node:
            case typed.Const(type=data_type, value=value):
                return self._constant(data_type, value)
            case typed.Load(type=data_type, name=name):
                return Fragment(self._variable(name), ATOM, *self.known.get(name, bounds(data_type)))
            case typed.Element(type=data_type, name=name, indices=indices, arrays=arrays):
                return Fragment(self._variable(name) + self.subscripts(indices, arrays), ATOM, *bounds(data_type))
            case typed.Convert(type=data_type, operand=operand):
                return self._convert(data_type, operand)
            case typed.Cast():
                return self._cast(node)
            case typed.Unary(type=data_type, operator="-", operand=operand):
                inner = self.raw(operand)
                return Fragment(f"-{inner.at_least(UNARY)}", UNARY, -inner.high, -inner.low)
            case typed.Unary(type=data_type, operand=operand):
                inner = self.value(operand)
                if data_type.kind == "bool":
                    return Fragment(f"not {inner.at_least(NOT)}", NOT)
                return Fragment(f"{inner.at_least(BIT_AND)} ^ {data_type.maximum}", BIT_XOR, *bounds(data_type))
            case typed.Binary():
                return self._binary(node)
            case typed.Call():
                return self._call(node)

    def subscripts(self, indices: tuple[typed.Expression, ...], arrays: tuple[Aggregate, ...]) -> str:
        """`[i][j]` with offsets from the lower bounds; checked where an index can lie outside."""
        return "".join(f"[{self._offset(i, array)}]" for i, array in zip(indices, arrays, strict=True))

    def _offset(self, node: typed.Expression, array: Aggregate) -> str:
        if isinstance(array, StructType):
            assert isinstance(node, typed.Const)
            return str(node.value)
        if isinstance(node, typed.Const):
            return str(node.value - array.lower)
        index = self.value(node)
        if not (array.lower <= index.low and index.high <= array.upper):
            return f"{self.helper('_index')}({index.text}, {array.lower}, {array.upper}, {where(node)})"
        if array.lower == 0:
            return index.text
        sign, offset = ("-", array.lower) if array.lower > 0 else ("+", -array.lower)
        return f"{index.at_least(SUM)} {sign} {offset}"

    def _constant(self, data_type: DataType, value: Any) -> Fragment:
        if isinstance(data_type, ArrayType):
            if value and all(repr(item) == repr(value[0]) for item in value) and not isinstance(value[0], list):
                return Fragment(f"[{value[0]!r}] * {len(value)}", PRODUCT)
            return Fragment(repr(value), ATOM)
        if isinstance(data_type, StructType):
            members = zip(data_type.members, value, strict=True)
            return Fragment(f"[{', '.join(self._constant(m.type, item).text for m, item in members)}]", ATOM)
        if isinstance(value, float) and not math.isfinite(value):
            name = self.helper("_nan" if value != value else "_inf")
            return Fragment(f"-{name}" if value < 0 else name, UNARY)
        negative = data_type.is_number and str(value).startswith("-")
        low_high = (value, value) if is_integral(data_type) else (0, 0)
        return Fragment(repr(value), UNARY if negative else ATOM, *low_high)

    def _convert(self, data_type: ElementaryType, operand: typed.Expression) -> Fragment:
        inner = self.value(operand)
        assert isinstance(operand.type, ElementaryType)
        if data_type.kind == "real":
            return inner if operand.type.kind == "real" else Fragment(f"float({inner.text})", ATOM)
        if operand.type.kind == "bool":
            return Fragment(f"int({inner.text})", ATOM, 0, 1)
        if data_type.limit and not 0 < operand.type.limit <= data_type.limit:
            return Fragment(f"{inner.at_least(ATOM)}[:{data_type.limit}]", ATOM)
        return inner

    def _binary(self, node: typed.Binary) -> Fragment:
        operator, left, right = node.operator, node.left, node.right
        assert isinstance(left.type, ElementaryType)
        if operator in COMPARISONS:
            if left.type.kind == "real":
                return self._infix(operator, *self._reals(left, right))
            return self._infix(operator, self.value(left), self.value(right))
        if operator in _LOGICAL:
            return self._logical(node)
        if node.type.kind == "real":
            result = self._real(operator, left, right)
            return self._round(result) if node.type == REAL else result
        if operator == "**":
            name = self.helper("_ipow")
            period = 1 << node.type.bits
            call = f"{name}({self.text(left)}, {self.text(right)}, {node.type.minimum}, {period})"
            return Fragment(call, ATOM, *bounds(node.type))
        if operator in ("+", "-", "*") and is_integral(right.type):
            # one that is narrower, as the number in TIME * INT, must wrap in its own type first
            a, b = (self.raw(n) if _bits(n) == node.type.bits else self.value(n) for n in (left, right))
            return self._infix(operator, a, b, *combine(operator, a, b))
        if isinstance(right.type, ElementaryType) and right.type.kind == "real":
            name = self.helper("_time_scale" if operator == "*" else "_time_div_real")
            return Fragment(f"{name}({self.text(left)}, {self.text(right)})", ATOM, *bounds(node.type))
        return self._division(operator, self.value(left), self.value(right))

    def _infix(self, operator: str, a: Fragment, b: Fragment, low: int = 0, high: int = 0) -> Fragment:
        symbol, level = _OPERATORS[operator]
        # comparisons chain in Python, so both sides are closed; the others associate to the left
        first = a.at_least(level + (level == COMPARISON))
        return Fragment(f"{first} {symbol} {b.at_least(level + 1)}", level, low, high)

    def _logical(self, node: typed.Binary) -> Fragment:
        table = _LOGICAL if node.type.kind == "bool" else _BITWISE
        symbol, level = table[node.operator]
        a, b = self.value(node.left), self.value(node.right)
        first = a.at_least(level + (level == COMPARISON))
        return Fragment(f"{first} {symbol} {b.at_least(level + 1)}", level, *bounds(node.type))

    def _reals(self, left: typed.Expression, right: typed.Expression) -> tuple[Fragment, Fragment]:
        """Both operands; an integer one stays as it is beside a float, since Python converts it exactly."""
        widened = [isinstance(n, typed.Convert) and is_integral(n.operand.type) for n in (left, right)]
        if widened == [True, False] and isinstance(left, typed.Convert):
            return self.value(left.operand), self.value(right)
        if widened == [False, True] and isinstance(right, typed.Convert):
            return self.value(left), self.value(right.operand)
        return self.value(left), self.value(right)

    def _real(self, operator: str, left: typed.Expression, right: typed.Expression) -> Fragment:
        if operator == "**":
            if isinstance(right, typed.Const) and right.value == 2:
                return self._square(self.value(left))
            self.raises = True
            return Fragment(f"{self.helper('_pow')}({self.text(left)}, {self.text(right)})", ATOM)
        a, b = self._reals(left, right)
        if operator != "/" or (isinstance(right, typed.Const) and right.value != 0):
            return self._infix(operator, a, b)
        self.raises = True
        if self._exact:
            return Fragment(f"{self.helper('_div')}({a.text}, {b.text})", ATOM)
        return self._infix(operator, a, b)

    def _square(self, base: Fragment) -> Fragment:
        """`x ** 2` is x * x, as in `fast_power`."""
        name, first = self._once(base)
        return Fragment(f"{first} * {name}", PRODUCT)

    def _once(self, fragment: Fragment) -> tuple[str, str]:
        """Code to repeat the fragment's value, and the code that computes it the first time."""
        if re.fullmatch(r"[\w.]+", fragment.text):
            return fragment.text, fragment.text
        name = self.temporary()
        return name, f"({name} := {fragment.text})"

    def _round(self, fragment: Fragment) -> Fragment:
        return Fragment(f"{self.helper('_f32')}({fragment.text})", ATOM)

    def _division(self, operator: str, a: Fragment, b: Fragment) -> Fragment:
        limits = (quotient_bounds if operator == "/" else remainder_bounds)(a, b)
        if a.low >= 0 and b.low > 0:
            return Fragment(
                f"{a.at_least(PRODUCT)} {'//' if operator == '/' else '%'} {b.at_least(UNARY)}", PRODUCT, *limits
            )
        name = self.helper("_idiv" if operator == "/" else "_imod")
        return Fragment(f"{name}({a.text}, {b.text})", ATOM, *limits)

    def _call(self, node: typed.Call) -> Fragment:
        name, arguments, data_type = node.function, node.arguments, node.type
        values = [self.value(argument) for argument in arguments]
        listed = ", ".join(value.text for value in values)
        limits = bounds(data_type)
        if name == CLOCK:
            return Fragment(f"{self._instance}.resource__.time", ATOM, *limits)
        if name in _REAL_FUNCTIONS:
            self.raises = True
            result = Fragment(f"{self.helper('_' + name.lower())}({listed})", ATOM)
            return self._round(result) if data_type == REAL else result
        if name == "ABS":
            largest = max(abs(values[0].low), abs(values[0].high))
            return Fragment(f"abs({listed})", ATOM, 0, largest)
        if name in ("MIN", "MAX"):
            (a, first), (b, second) = (self._once(v) for v in values)
            pick = min if name == "MIN" else max
            low, high = (pick(getattr(v, side) for v in values) for side in ("low", "high"))
            symbol = "<" if name == "MIN" else ">"
            return Fragment(f"({a} if {first} {symbol} {second} else {b})", ATOM, low, high)
        if name == "SEL":
            return Fragment(f"({values[2].text} if {values[0].text} else {values[1].text})", ATOM, *limits)
        if name in ("SHL", "SHR", "ROL", "ROR"):
            return self._shift(node, values)
        if name == "LEN":
            return Fragment(f"len({listed})", ATOM, 0, 1 << 31)
        if name == "FIND":
            return Fragment(f"{self.helper('_find')}({listed})", ATOM, 0, 1 << 31)
        if name in ("CHARACTER", "WITH_CHARACTER"):
            return Fragment(f"{self.helper('_' + name.lower())}({listed}, {where(node)})", ATOM)
        assert name in _TEXT_FUNCTIONS or name == "MUX", name
        return Fragment(f"{self.helper('_' + name.lower())}({listed})", ATOM, *limits)

    def _shift(self, node: typed.Call, values: list[Fragment]) -> Fragment:
        assert isinstance(node.type, ElementaryType)
        x, count = values
        low, high = bounds(node.type)
        fixed = node.arguments[1]
        if isinstance(fixed, typed.Const) and 0 <= fixed.value < node.type.bits:
            if node.function == "SHR":
                return Fragment(f"{x.at_least(SHIFT)} >> {count.text}", SHIFT, low, high)
            if node.function == "SHL":
                return Fragment(f"{x.at_least(SHIFT)} << {count.text}", SHIFT, low, high << fixed.value)
        name = self.helper("_" + node.function.lower())
        return Fragment(f"{name}({x.text}, {count.text}, {node.type.bits})", ATOM, low, high)

    def _cast(self, node: typed.Cast) -> Fragment:
        source, target, inner = node.operand.type, node.type, self.value(node.operand)
        assert isinstance(source, ElementaryType)
        text, limits = inner.text, bounds(target)
        if node.how in _UNITS:
            return self._time_in(node.how, target, inner)
        if node.how in ("to_bcd", "from_bcd"):
            return self.wrap(Fragment(f"{self.helper('_' + node.how)}({text})", ATOM, 0, 1 << 80), target)
        if source.kind == "date":
            return self._cast_date(source, target, inner)
        if "char" in (source.kind, target.kind):
            return self._cast_char(source, target, inner)
        if source.kind == target.kind == "string":
            return Fragment(f"{self.helper('_text_of' if source.name == 'STRING' else '_bytes_of')}({text})", ATOM)
        if source.kind == "string":
            return self._from_string(target, text)
        if target.kind == "string":
            return self._to_string(source, text)
        if source.kind == "real":
            if target.kind == "real":
                return self._round(inner) if target == REAL else inner
            if target.kind == "bits":
                code = "f" if source == REAL else "d"
                return Fragment(f"{self.helper('_to_bits')}({text}, '{code}')", ATOM, *limits)
            name = self.helper("_trunc" if node.how == "trunc" else "_round")
            return Fragment(f"{name}({text}, {target.minimum}, {(1 << target.bits) - 1})", ATOM, *limits)
        if target.kind == "real":
            if source.kind == "bits":
                code = "f" if target == REAL else "d"
                return Fragment(f"{self.helper('_from_bits')}({text}, '{code}')", ATOM)
            converted = Fragment(f"float({text})", ATOM)
            return self._round(converted) if target == REAL else converted
        if target.kind == "bool":
            return Fragment(f"{inner.at_least(BIT_OR)} != 0", COMPARISON)
        return Fragment(f"int({text})", ATOM, 0, 1) if source.kind == "bool" else inner

    def _cast_date(self, source: ElementaryType, target: ElementaryType, inner: Fragment) -> Fragment:
        if source.name.removeprefix("L") == target.name.removeprefix("L"):
            return inner
        time = Fragment(f"{inner.at_least(PRODUCT)} % {_DAY}", PRODUCT, 0, _DAY)
        if target.name.endswith("TOD"):
            return time
        return Fragment(f"{inner.at_least(SUM)} - {time.text}", SUM, inner.low - _DAY, inner.high)

    def _cast_char(self, source: ElementaryType, target: ElementaryType, inner: Fragment) -> Fragment:
        if source.kind == "bits":
            return Fragment(f"chr({inner.at_least(BIT_AND + 1)} & {(1 << target.bits) - 1})", ATOM)
        if target.kind == "bits":
            return self.wrap(Fragment(f"ord({inner.text})", ATOM, 0, 65535), target)
        if target.kind == "char":
            return Fragment(f"({inner.at_least(ATOM)}[:1] or chr(0))", ATOM)
        return inner

    def _time_in(self, unit: str, target: ElementaryType, inner: Fragment) -> Fragment:
        nanoseconds = _UNITS[unit]
        if target.kind != "real":
            return self._division("/", inner, Fragment(str(nanoseconds), ATOM, nanoseconds, nanoseconds))
        # the same operations as FORTE, so that the last bit agrees
        scale = f" / {1e9!r}" if unit == "s" else f" * {1e9 / nanoseconds / 1e9!r}"
        result = Fragment(f"{inner.at_least(PRODUCT)}{scale}", PRODUCT)
        return self._round(result) if target == REAL else result

    def _to_string(self, source: ElementaryType, text: str) -> Fragment:
        match source.kind:
            case "bool":
                return Fragment(f"('TRUE' if {text} else 'FALSE')", ATOM)
            case "real":
                return Fragment(f"{self.helper('_format')}({text}, {15 if source == LREAL else 6})", ATOM)
            case "time":
                return Fragment(f"{self.helper('_time_to_string')}({text})", ATOM)
        return Fragment(f"str({text})", ATOM)

    def _from_string(self, target: ElementaryType, text: str) -> Fragment:
        match target.kind:
            case "bool":
                return Fragment(f"{self.helper('_string_to_bool')}({text})", ATOM)
            case "real":
                result = Fragment(f"{self.helper('_string_to_real')}({text})", ATOM)
                return self._round(result) if target == REAL else result
            case "time":
                return Fragment(f"{self.helper('_string_to_time')}({text})", ATOM, *bounds(target))
        mask = (1 << target.bits) - 1
        call = f"{self.helper('_string_to_int')}({text}, {target.minimum}, {mask}, {target.name!r})"
        return Fragment(call, ATOM, *bounds(target))


def _bits(node: typed.Expression) -> int:
    assert isinstance(node.type, ElementaryType)
    return node.type.bits


def where(node: typed.Expression | typed.Statement) -> str:
    """A string constant with the node's position, for runtime errors."""
    return repr("|".join(str(part) for part in node.at))
