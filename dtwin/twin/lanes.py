"""Numbers side by side in a wide register: what the kernels of the arm do with one number they do with all of them.

A kernel that is given `Lanes` in place of a float is compiled to vector instructions. Each lane has the bits that the
same operations give for one number: IEEE 754 operations know nothing of their neighbours, and none is contracted or
reordered. Where registers are narrower than this the compiler takes several.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, lower_builtin, lower_cast, models, register_model

WIDTH: Final = 8
"""Number of lanes of `load`."""


class _Lanes(types.Type):
    """The type of a number of floats of 64 or 32 bits."""

    def __init__(self, width: int, bits: int = 64) -> None:
        self.width, self.bits = width, bits
        super().__init__(name=f"Lanes{width}x{bits}")

    @property
    def one(self) -> types.Float:
        """The type of what is in a lane."""
        return types.float64 if self.bits == 64 else types.float32


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: _Lanes) -> None:
        super().__init__(manager, kind, _vector(kind))


def _vector(kind: _Lanes) -> ir.VectorType:
    return ir.VectorType(ir.DoubleType() if kind.bits == 64 else ir.FloatType(), kind.width)


@lower_cast(types.Float, _Lanes)
def _everywhere(context: Any, builder: Any, given: Any, wanted: Any, value: Any) -> Any:
    """The same number in all lanes."""
    return _gathered(builder, [context.cast(builder, value, given, wanted.one)] * wanted.width)


def _gathered(builder: Any, values: Sequence[Any]) -> Any:
    found = ir.Constant(ir.VectorType(values[0].type, len(values)), ir.Undefined)
    for lane, value in enumerate(values):
        found = builder.insert_element(found, value, ir.IntType(32)(lane))
    return found


def _picked(builder: Any, vector: Any, first: int, count: int) -> Any:
    """Lanes of a vector from the first on; those beyond its end are undefined."""
    kind = ir.VectorType(ir.IntType(32), count)
    return builder.shuffle_vector(
        vector, ir.Constant(vector.type, ir.Undefined), kind(list(range(first, first + count)))
    )


@intrinsic
def abreast(typing: Any, first: Any, second: Any, third: Any) -> Any:
    """Three floats, or three Lanes, as Lanes: what is to be done with each of them is done at once."""

    def generate(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
        if isinstance(kind.args[0], types.Float):
            return _gathered(builder, arguments)
        width = kind.args[0].width
        every = ir.VectorType(ir.IntType(32), 3 * width)(list(range(3 * width)))
        two = builder.shuffle_vector(*arguments[:2], ir.VectorType(ir.IntType(32), 2 * width)(list(range(2 * width))))
        return builder.shuffle_vector(two, _picked(builder, arguments[2], 0, 2 * width), every)

    return _Lanes(3 * (1 if isinstance(first, types.Float) else first.width))(first, second, third), generate


@intrinsic
def apart(typing: Any, lanes: Any) -> Any:
    """What `abreast` put together."""
    width = lanes.width // 3

    def generate(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
        if width == 1:
            parts = [builder.extract_element(arguments[0], ir.IntType(32)(k)) for k in range(3)]
        else:
            parts = [_picked(builder, arguments[0], k * width, width) for k in range(3)]
        return context.make_tuple(builder, kind.return_type, parts)

    return types.UniTuple(types.float64 if width == 1 else _Lanes(width), 3)(lanes), generate


def _define(function: Callable[..., Any], count: int, emit: Callable[..., Any]) -> None:
    """Lets kernels call a function of `count` numbers, one at least of them Lanes; the others may be floats."""

    class Template(AbstractTemplate):
        key = function

        def generic(self, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
            kinds = {each for each in arguments if isinstance(each, _Lanes)}
            floats = sum(isinstance(each, types.Float) for each in arguments)
            if len(kinds) != 1 or len(arguments) != count or named:
                return None
            (kind,) = kinds
            return signature(kind, *[kind] * count) if floats + arguments.count(kind) == count else None

    infer_global(function)(Template)
    lower_builtin(function, *(_Lanes for _ in range(count)))(emit)


def _instruction(name: str) -> Callable[..., Any]:
    return lambda context, builder, signature, arguments: getattr(builder, name)(*arguments)


def _fma(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
    vector, name = arguments[0].type, f"llvm.fma.v{kind.return_type.width}f{kind.return_type.bits}"
    declared = ir.FunctionType(vector, [vector] * 3)
    return builder.call(cgutils.get_or_insert_function(builder.module, declared, name), arguments)


def _tanh(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
    """Lane by lane, by the function that one number has."""
    one = signature(types.float64, types.float64)
    tanh = context.get_function(math.tanh, one)
    given = [builder.extract_element(arguments[0], ir.IntType(32)(lane)) for lane in range(kind.return_type.width)]
    return _gathered(builder, [tanh(builder, [value]) for value in given])


for _operator, _name in (
    (operator.add, "fadd"),
    (operator.iadd, "fadd"),
    (operator.sub, "fsub"),
    (operator.isub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define(_operator, 2, _instruction(_name))
_define(operator.neg, 1, _instruction("fneg"))
_define(math.tanh, 1, _tanh)


def fused(a: float, b: float, c: float) -> float:
    """a b + c rounded once, lane by lane (IEEE 754-2008, 5.4.1): for kernels, one at least of them Lanes.

    The bits are the same everywhere: it is asked for by name, no compiler decides where it stands.
    """
    raise NotImplementedError


_define(fused, 3, _fma)


def memory(width: int, bits: int = 64) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Functions for kernels that read and write Lanes: `load` and `store` for arrays, (n, width), of such floats."""
    lanes_of = _Lanes(width, bits)

    def place(context: Any, builder: Any, kind: Any, array: Any, row: Any) -> Any:
        data = context.make_array(kind)(context, builder, array).data
        first = builder.mul(row, ir.IntType(64)(width))
        return builder.bitcast(builder.gep(data, [first]), _vector(lanes_of).as_pointer())

    @intrinsic
    def load(typing: Any, array: Any, row: Any) -> Any:
        """A row of a contiguous array, (n, width), as Lanes."""

        def generate(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
            return builder.load(place(context, builder, kind.args[0], *arguments), align=bits // 8)

        return lanes_of(array, types.int64), generate

    @intrinsic
    def store(typing: Any, array: Any, row: Any, lanes: Any) -> Any:
        """Writes Lanes to a row of a contiguous array, (n, width)."""

        def generate(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
            builder.store(arguments[2], place(context, builder, kind.args[0], *arguments[:2]), align=bits // 8)
            return context.get_dummy_value()

        return types.void(array, types.int64, lanes_of), generate

    return load, store


load, store = memory(WIDTH)


@intrinsic
def widened(typing: Any, lanes: Any) -> Any:
    """Lanes of 32 bits as lanes of 64 bits."""

    def generate(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
        return builder.fpext(arguments[0], _vector(kind.return_type))

    return _Lanes(lanes.width)(lanes), generate


@intrinsic
def turned(typing: Any, sine: Any, cosine: Any, quarters: Any) -> Any:
    """Sine and cosine of an angle further by a number of quarter turns, of a float or Lanes.

    The number is what is left in the last bits of `quarters` when a whole number and 1.5 2^52 are added: an odd one
    swaps the two, and the next bit turns their signs. Nothing is converted, so that nothing waits.
    """

    def generate(context: Any, builder: Any, kind: Any, arguments: Any) -> Any:
        real = arguments[0].type
        vector = isinstance(real, ir.VectorType)
        whole = ir.VectorType(ir.IntType(64), real.count) if vector else ir.IntType(64)

        def constant(value: int) -> Any:
            return ir.Constant(whole, [value] * real.count if vector else value)

        def signed(value: Any, number: Any) -> Any:
            sign = builder.shl(builder.and_(number, constant(2)), constant(62))
            return builder.bitcast(builder.xor(builder.bitcast(value, whole), sign), real)

        number = builder.bitcast(arguments[2], whole)
        swaps = builder.icmp_unsigned("!=", builder.and_(number, constant(1)), constant(0))
        parts = (
            signed(builder.select(swaps, arguments[1], arguments[0]), number),
            signed(builder.select(swaps, arguments[0], arguments[1]), builder.add(number, constant(1))),
        )
        return context.make_tuple(builder, kind.return_type, parts)

    return types.UniTuple(sine, 2)(sine, sine, sine), generate
