"""What Structured Text means where IEC 61131-3 leaves it to the implementation, for the checker and both backends."""

from __future__ import annotations

from typing import Final

ITERATION_LIMIT: Final = 10_000_000
"""Most loop iterations of one event chain, all loops together; more are taken for a loop that never ends."""
COMPUTING_TIME: Final = 0.04
"""Longest time for which one block may compute on a device before the others have their turn, s of the processor."""
STRING_LIMIT: Final = 65535
"""Longest STRING or WSTRING: communication blocks have 16 bits for its length."""


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
