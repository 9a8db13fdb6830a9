"""exp, tanh and a quick division for kernels, of one number or of `Lanes`.

Of one number they are the functions of the C library. Lanes have their own, which do not branch: what they say of a
number differs from that by less than 1e-15 of it. The reduction by powers of two is that of Cody and Waite (Software
Manual for the Elementary Functions, 1980), the polynomial Taylor's.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from numba import types
from numba.extending import overload

from dtwin.twin.compiled import kernel
from dtwin.twin.lanes import choose, doubled

_ONE_BY_LN2: Final = 1.0 / math.log(2.0)
_LN2: Final = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
"""ln 2 in two parts, of which the first has 32 bits, so that its product with a small whole number is exact."""
_ROUNDER: Final = 1.5 * 2.0**52
"""A number that, added to another one, rounds it to a whole number."""
_SERIES: Final = tuple(1.0 / math.factorial(n) for n in range(2, 14))
_LEAST: Final = -700.0
"""Below this exp counts as exp(-700), 1e-304."""
_SATURATED: Final = 22.0
"""From here on tanh is 1 to the last bit."""


def exp(x: float) -> float:
    """The exponential function of a float, or of Lanes up to 700."""
    return math.exp(x)


def tanh(x: float) -> float:
    """The hyperbolic tangent of a float, or of Lanes."""
    return math.copysign(1.0, x) if abs(x) >= _SATURATED else math.tanh(x)


def ratio(x: float, y: float) -> float:
    """x / y; where x are Lanes, x (1 / y), because a division of Lanes takes as long as some ten products."""
    return x / y


@kernel(inlined=True)
def _reduced(x: float) -> tuple[float, float]:
    """exp(r) - 1 and k in the last bits of a number, where x is k ln 2 + r and |r| at most ln 2 / 2."""
    rounded = x * _ONE_BY_LN2 + _ROUNDER
    k = rounded - _ROUNDER
    r = (x - k * _LN2[0]) - k * _LN2[1]
    a, z = _SERIES, r * r
    w = z * z
    low = (a[0] + r * a[1]) + z * (a[2] + r * a[3])
    middle = (a[4] + r * a[5]) + z * (a[6] + r * a[7])
    high = (a[8] + r * a[9]) + z * (a[10] + r * a[11])
    return r + z * (low + w * (middle + w * high)), rounded


@kernel(inlined=True)
def _exp(x: float) -> float:
    less_one, k = _reduced(choose(x, _LEAST, _LEAST, x))
    return doubled(1.0 + less_one, k)


@kernel(inlined=True)
def _tanh(x: float) -> float:
    """By exp(2 |x|) - 1, of which no digits are lost where x is small."""
    size = abs(x)
    less_one, k = _reduced(2.0 * choose(_SATURATED, size, _SATURATED, size))
    power = doubled(1.0, k)
    grown = power * less_one + (power - 1.0)
    return math.copysign(grown / (grown + 2.0), x)


@kernel(inlined=True)
def _ratio(x: float, y: float) -> float:
    return x * (1.0 / y)


_OPTIONS: Final = {"error_model": "numpy", "forceinline": True}


@overload(exp, jit_options=_OPTIONS)
def _any_exp(x: float) -> Callable[..., float]:
    return exp if isinstance(x, types.Float) else _exp.py_func


@overload(tanh, jit_options=_OPTIONS)
def _any_tanh(x: float) -> Callable[..., float]:
    return tanh if isinstance(x, types.Float) else _tanh.py_func


@overload(ratio, jit_options=_OPTIONS)
def _any_ratio(x: float, y: float) -> Callable[..., float]:
    return ratio if isinstance(x, types.Float) else _ratio.py_func
