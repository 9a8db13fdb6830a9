"""What Structured Text means where IEC 61131-3 leaves it to the implementation, for the checker and both backends."""

from __future__ import annotations

from typing import Final

ITERATION_LIMIT: Final = 10_000_000
"""Most loop iterations of one call, all loops together; more are taken for a loop that never ends."""


def integer_divide(a: int, b: int) -> int:
    """The quotient truncated toward zero; 0 when b is 0, as FORTE's DIV."""
    if b == 0:
        return 0
    quotient = abs(a) // abs(b)
    return quotient if (a < 0) == (b < 0) else -quotient


def integer_modulo(a: int, b: int) -> int:
    """The remainder, which has the sign of a; 0 when b is 0, as FORTE's MOD."""
    if b == 0:
        return 0
    return abs(a) % abs(b) if a >= 0 else -(-a % abs(b))
