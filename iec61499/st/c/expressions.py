"""Typed expressions to C99 expressions. Those of a STRING are a `struct fb_text`, which points to the bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NoReturn

from iec61499.errors import FunctionBlockError
from iec61499.st import typed
from iec61499.st.ast import Position
from iec61499.st.c.names import c_name, c_type, check_supported, number, quoted
from iec61499.st.fragment import Fragment
from iec61499.st.functions import CLOCK
from iec61499.st.typed import COMPARISONS
from iec61499.types import LREAL, Aggregate, ArrayType, ElementaryType, StructType

_COMPARE: Final = {"=": "==", "<>": "!="}
_LOGICAL: Final = {"AND": "&&", "OR": "||", "XOR": "!="}
_BITWISE: Final = {"AND": "&", "OR": "|", "XOR": "^"}
_REAL_FUNCTIONS: Final = frozenset({"SQRT", "LN", "LOG", "EXP", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "ATAN2"})
_SHIFTS: Final = {"SHL": "shift_left", "SHR": "shift_right", "ROL": "rotate_left", "ROR": "rotate_right"}
_LOOSE, _TIGHT = range(2)
_UNITS: Final = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}


@dataclass(slots=True)
class Places:
    """The places in the source that faults of a unit name, by number."""

    found: dict[Position, int] = field(default_factory=dict)

    def number(self, at: Position) -> int:
        return self.found.setdefault(at, len(self.found))


def refuse(at: Position, what: str) -> NoReturn:
    """Raises FunctionBlockError: the C backend cannot do what is at a place."""
    raise FunctionBlockError(f"C: {what} is not supported", *at)


class CExpressions:
    """Translates expressions.

    Args:
        variable: the C lvalue of a variable.
        places: collects the places of faults.

    Attributes:
        locals: declarations that the expressions need above them.
        can_fail: whether an expression can find a fault.
    """

    def __init__(self, variable: Callable[[str], str], places: Places) -> None:
        self._variable = variable
        self._places = places
        self.locals: list[str] = []
        self.can_fail = False

    def place(self, at: Position) -> int:
        """The number of a place, for code that can find a fault there."""
        self.can_fail = True
        return self._places.number(at)

    def temporary(self, kind: str) -> str:
        """A fresh local variable of a C type."""
        name = f"fb_{len(self.locals)}"
        self.locals.append(f"{kind} {name}")
        return name

    def text(self, node: typed.Expression) -> str:
        """C that stands as an operand."""
        return self._code(node).at_least(_TIGHT)

    def open(self, node: typed.Expression) -> str:
        """C that stands alone, as an argument or behind `=`."""
        return self._code(node).text

    def _code(self, node: typed.Expression) -> Fragment:
        match node:
            case typed.Binary():
                return self._binary(node)
            case typed.Cast():
                return self._cast(node)
        return Fragment(self._primary(node), _TIGHT)

    def _primary(self, node: typed.Expression) -> str:
        match node:
            case typed.Const(at=at, type=data_type, value=value):
                if not isinstance(data_type, ElementaryType):
                    refuse(at, f"a constant {data_type} here")
                check_supported(data_type, at)
                return literal(value) if data_type.kind == "string" else number(value, data_type)
            case typed.Load():
                return self._loaded(node, self._variable(node.name))
            case typed.Element(name=name, indices=indices, arrays=arrays):
                return self._loaded(node, self._variable(name) + self.subscripts(indices, arrays))
            case typed.Convert():
                return self._convert(node)
            case typed.Unary():
                return self._unary(node)
            case typed.Call():
                return self._call(node)
        refuse(node.at, type(node).__name__)

    def subscripts(self, indices: tuple[typed.Expression, ...], arrays: tuple[Aggregate, ...]) -> str:
        """`[i].member[j]`, checked where an index can lie outside."""
        return "".join(self._subscript(i, array) for i, array in zip(indices, arrays, strict=True))

    def _subscript(self, node: typed.Expression, array: Aggregate) -> str:
        if isinstance(array, StructType):
            assert isinstance(node, typed.Const)
            return f".{c_name(array.members[node.value].name)}"
        assert isinstance(array, ArrayType)
        if isinstance(node, typed.Const):
            return f"[{node.value - array.lower}]"
        return f"[fb_index(run, {self.as_signed(node)}, {array.lower}, {array.upper}, {self.place(node.at)})]"

    def as_signed(self, node: typed.Expression) -> str:
        """An integer as int64_t; the greatest one for what is beyond it."""
        assert isinstance(node.type, ElementaryType)
        unsigned = node.type.bits == 64 and node.type.minimum == 0
        return f"fb_clamp({self.open(node)})" if unsigned else self.open(node)

    def _loaded(self, node: typed.Load | typed.Element, place: str) -> str:
        is_text = isinstance(node.type, ElementaryType) and node.type.kind == "string"
        return f"fb_view(&{place})" if is_text else place

    def _convert(self, node: typed.Convert) -> str:
        source, target = node.operand.type, node.type
        assert isinstance(source, ElementaryType)
        if target.kind == "string":
            text = (
                self.open(node.operand)
                if source.kind == "string"
                else self._to_string(source, self.open(node.operand))
            )
            if target.limit and not 0 < source.limit <= target.limit:
                return f"fb_cut({text}, {target.limit})"
            return text
        return f"({c_type(target)}){self.text(node.operand)}"

    def _unary(self, node: typed.Unary) -> str:
        inner, kind = self.text(node.operand), c_type(node.type)
        if node.operator == "-":
            if node.type.kind == "real":
                return f"-({inner})" if inner.startswith("-") else f"-{inner}"
            return f"({kind})(0u - (uint64_t){inner})"
        return f"!{inner}" if node.type.kind == "bool" else f"({kind})~{inner}"

    def _binary(self, node: typed.Binary) -> Fragment:
        operator, left, right = node.operator, node.left, node.right
        assert isinstance(left.type, ElementaryType)
        assert isinstance(right.type, ElementaryType)
        if operator in COMPARISONS:
            return Fragment(self._comparison(operator, left, right), _LOOSE)
        kind = c_type(node.type)
        if operator in _LOGICAL:
            if node.type.kind == "bool":
                return Fragment(f"{self.text(left)} {_LOGICAL[operator]} {self.text(right)}", _LOOSE)
            return Fragment(f"({kind})({self.text(left)} {_BITWISE[operator]} {self.text(right)})", _TIGHT)
        if node.type.kind == "real":
            return self._real(node)
        if operator == "**":
            return Fragment(self._power(node), _TIGHT)
        if node.type.kind == "time" and operator in "*/" and not (operator == "*" and right.type.kind != "real"):
            return Fragment(self._scaled_time(operator, left, right), _TIGHT)
        if operator in ("+", "-", "*"):
            wide = "(uint64_t)" if node.type.bits == 64 else "(int64_t)"
            return Fragment(f"({kind})({wide}{self.text(left)} {operator} {wide}{self.text(right)})", _TIGHT)
        function = "divide" if operator == "/" else "modulo"
        call = f"fb_{function}_{_signedness(left.type)}({self.open(left)}, {self.open(right)})"
        return Fragment(f"({kind}){call}", _TIGHT)

    def _comparison(self, operator: str, left: typed.Expression, right: typed.Expression) -> str:
        assert isinstance(left.type, ElementaryType)
        symbol = _COMPARE.get(operator, operator)
        if left.type.kind != "string":
            return f"{self.text(left)} {symbol} {self.text(right)}"
        if operator in _COMPARE:
            return f"{'!' if operator == '<>' else ''}fb_equal({self.open(left)}, {self.open(right)})"
        return f"fb_compare({self.open(left)}, {self.open(right)}) {symbol} 0"

    def _real(self, node: typed.Binary) -> Fragment:
        wide = node.type == LREAL
        a, b = (self._double(operand) for operand in (node.left, node.right))
        if node.operator == "**":
            result = Fragment(f"fb_power({a}, {b})", _TIGHT)
        elif node.operator != "/" or (isinstance(node.right, typed.Const) and node.right.value != 0):
            result = Fragment(f"{a} {node.operator} {b}", _LOOSE)
        else:
            result = Fragment(f"fb_divide({a}, {b})", _TIGHT)
        return result if wide else Fragment(f"(float){result.at_least(_TIGHT)}", _TIGHT)

    def _double(self, node: typed.Expression) -> str:
        return self.text(node) if node.type == LREAL else f"(double){self.text(node)}"

    def _power(self, node: typed.Binary) -> str:
        assert isinstance(node.left.type, ElementaryType)
        assert isinstance(node.right.type, ElementaryType)
        kind, base, exponent = c_type(node.type), self.text(node.left), self.open(node.right)
        if _signedness(node.right.type) == "signed" and _signedness(node.left.type) == "signed":
            return f"({kind})fb_raise_signed((int64_t){base}, {exponent})"
        if _signedness(node.right.type) == "signed":
            return f"({kind})fb_raise_unsigned((uint64_t){base}, {exponent})"
        return f"({kind})fb_raise((uint64_t){base}, {exponent})"

    def _scaled_time(self, operator: str, left: typed.Expression, right: typed.Expression) -> str:
        assert isinstance(right.type, ElementaryType)
        if right.type.kind == "real":
            function = "fb_time_scale" if operator == "*" else "fb_time_divide_real"
            return f"{function}({self.open(left)}, {self._double(right)})"
        function = "fb_time_divide_unsigned" if _signedness(right.type) == "unsigned" else "fb_divide_signed"
        return f"{function}({self.open(left)}, {self.open(right)})"

    def _call(self, node: typed.Call) -> str:
        name, arguments = node.function, node.arguments
        if not isinstance(node.type, ElementaryType):
            refuse(node.at, f"{name} of {node.type}")
        check_supported(node.type, node.at)
        kind = c_type(node.type)
        if name == CLOCK:
            refuse(node.at, name)
        if name in _REAL_FUNCTIONS:
            call = f"fb_{name.lower()}({', '.join(self._double(argument) for argument in arguments)})"
            return call if node.type == LREAL else f"(float){call}"
        if name == "ABS":
            return self._absolute(node)
        if name in ("MIN", "MAX"):
            listed = ", ".join(self.open(argument) for argument in arguments)
            text = f"fb_{name.lower()}_{_group(node.type)}({listed})"
            return text if node.type.kind == "string" or node.type == LREAL else f"({kind}){text}"
        if name == "SEL":
            choice, first, second = (self.text(argument) for argument in arguments)
            text = f"{choice} ? {second} : {first}"
            return f"({text})" if node.type.kind == "string" else f"({kind})({text})"
        if name == "MUX":
            return self._multiplex(node)
        if name in _SHIFTS:
            value, count = self.open(arguments[0]), self.as_signed(arguments[1])
            return f"({kind})fb_{_SHIFTS[name]}({value}, {count}, {node.type.bits})"
        if name == "LEN":
            return f"({kind}){self.open(arguments[0])}.length"
        if name == "FIND":
            return f"({kind})fb_find({self.open(arguments[0])}, {self.open(arguments[1])})"
        if name == "CHARACTER":
            whole, position = arguments
            return f"fb_character(run, {self.open(whole)}, {self.as_signed(position)}, {self.place(node.at)})"
        return self._text_function(node)

    def _absolute(self, node: typed.Call) -> str:
        assert isinstance(node.type, ElementaryType)
        inner = self.open(node.arguments[0])
        if node.type.kind == "real":
            return f"fabs({inner})" if node.type == LREAL else f"fabsf({inner})"
        return f"({c_type(node.type)})fb_abs({inner})" if _signedness(node.type) == "signed" else inner

    def _multiplex(self, node: typed.Call) -> str:
        """All values are computed, as a function's arguments are."""
        assert isinstance(node.type, ElementaryType)
        text = node.type.kind == "string"
        kind = "struct fb_text" if text else c_type(node.type)
        selector, *values = node.arguments
        names = [self.temporary("int64_t"), *(self.temporary(kind) for _ in values)]
        codes = [self.as_signed(selector), *(self.open(value) for value in values)]
        stores = ", ".join(f"{name} = {code}" for name, code in zip(names, codes, strict=True))
        first, *rest = names[1:]
        choice = first
        for number_, name in enumerate(rest, 1):
            choice = f"({names[0]} < {number_} ? {choice} : {name})"
        result = f"({stores}, {choice})"
        return result if text else f"({kind}){result}"

    def _text_function(self, node: typed.Call) -> str:
        name = node.function.lower()
        if name not in ("left", "right", "mid", "concat", "insert", "replace", "delete", "with_character"):
            refuse(node.at, node.function)
        codes = [
            self.open(a) if isinstance(a.type, ElementaryType) and not a.type.is_integer else self.as_signed(a)
            for a in node.arguments
        ]
        if name in ("left", "right", "mid"):
            return f"fb_{name}({', '.join(codes)})"
        scratch = self.temporary("struct fb_string")
        return f"fb_{name}(run, &{scratch}, {', '.join(codes)}, {self.place(node.at)})"

    def _cast(self, node: typed.Cast) -> Fragment:
        source, target = node.operand.type, node.type
        assert isinstance(source, ElementaryType)
        check_supported(source, node.at)
        check_supported(target, node.at)
        inner = self.text(node.operand)
        if node.how in _UNITS:
            return self._time_in(_UNITS[node.how], target, inner)
        if source.kind == "date":
            return _date(source, target, inner)
        if target.kind == "bool" and source.kind != "string":
            return Fragment(f"{inner} != 0", _LOOSE)
        return Fragment(self._converted(node, source, target, inner), _TIGHT)

    def _converted(self, node: typed.Cast, source: ElementaryType, target: ElementaryType, inner: str) -> str:
        kind = c_type(target)
        if node.how in ("to_bcd", "from_bcd"):
            return f"({kind})fb_{'to' if node.how == 'to_bcd' else 'from'}_decimal({inner})"
        if target.kind == "string":
            return self._to_string(source, inner)
        if source.kind == "string":
            return self._from_string(node, target, inner)
        if source.kind == "real" and target.kind != "real":
            return self._from_real(node, source, target, inner)
        if target.kind == "real" and source.kind == "bits":
            return f"fb_{'double' if target == LREAL else 'float'}_of({inner})"
        if target.kind == "real" and source.kind != "real" and target != LREAL:
            return f"(float)(double){inner}"
        return f"({kind}){inner}"

    def _from_real(self, node: typed.Cast, source: ElementaryType, target: ElementaryType, inner: str) -> str:
        if target.kind == "bits":
            return f"fb_bits_of_{c_type(source)}({inner})"
        number_ = self._double(node.operand)
        whole = number_ if node.how == "trunc" else f"fb_half_even({number_})"
        unsigned = "_unsigned" if target.bits == 64 and target.minimum == 0 else ""
        return f"({c_type(target)})fb_truncate{unsigned}({whole})"

    def _time_in(self, nanoseconds: int, target: ElementaryType, inner: str) -> Fragment:
        kind = c_type(target)
        if target.kind != "real":
            return Fragment(f"({kind})({inner} / {nanoseconds})", _TIGHT)
        # the same operations as FORTE, so that the last bit agrees
        scale = f"/ {1e9!r}" if nanoseconds == 1_000_000_000 else f"* {1e9 / nanoseconds / 1e9!r}"
        result = f"(double){inner} {scale}"
        return Fragment(result, _LOOSE) if target == LREAL else Fragment(f"(float)({result})", _TIGHT)

    def _to_string(self, source: ElementaryType, inner: str) -> str:
        if source.kind == "bool":
            return f"fb_of_bool({inner})"
        if source.kind == "string":
            return inner
        scratch = self.temporary("struct fb_string")
        if source.kind == "real":
            return f"fb_of_real(&{scratch}, {inner}, {15 if source == LREAL else 6})"
        if source.kind == "time":
            return f"fb_of_time(&{scratch}, {inner})"
        return f"fb_of_{'char' if source.kind == 'char' else _signedness(source)}(&{scratch}, {inner})"

    def _from_string(self, node: typed.Cast, target: ElementaryType, inner: str) -> str:
        kind = c_type(target)
        match target.kind:
            case "bool":
                return f"fb_to_bool({inner})"
            case "real":
                return f"fb_to_real({inner})" if target == LREAL else f"(float)fb_to_real({inner})"
            case "char":
                return f"fb_first_char({inner})"
            case "time":
                refuse(node.at, f"a conversion of a STRING to {target}")
        signed = "true" if target.minimum < 0 else "false"
        return f"({kind})fb_to_integer({inner}, {target.bits}, {signed}, {literal(target.name)})"


def literal(value: str) -> str:
    """A constant text."""
    return f"fb_literal({quoted(value)}, {len(value)})"


def _date(source: ElementaryType, target: ElementaryType, inner: str) -> Fragment:
    if source.name.removeprefix("L") == target.name.removeprefix("L"):
        return Fragment(inner, _TIGHT)
    time = f"fb_time_of_day({inner})"
    date = f"(int64_t)((uint64_t){inner} - (uint64_t){time})"
    return Fragment(time if target.name.endswith("TOD") else date, _TIGHT)


def _signedness(data_type: ElementaryType) -> str:
    return "signed" if data_type.minimum < 0 else "unsigned"


def _group(data_type: ElementaryType) -> str:
    if data_type.kind in ("real", "string"):
        return {"real": "real", "string": "text"}[data_type.kind]
    return _signedness(data_type)
