"""Variables for algorithms under test, and what an algorithm makes of them on all backends."""

from __future__ import annotations

import math
from typing import Any

from iec61499.types import DINT, LREAL, ArrayType, DataType
from tests.support.iec61499.st_harness import LUA, check, run_exact, run_lua, run_python, same, scope_of

TYPES: dict[str, str | DataType] = {
    **dict.fromkeys(("X", "Y", "Z"), "LREAL"), "R": "REAL", **dict.fromkeys(("I", "J", "K"), "DINT"),
    "N": "SINT", "P": "USINT", "L": "LINT", "UL": "ULINT", "B": "BOOL", "C": "BOOL", "W": "WORD", "S": "STRING",
    "T": "TIME", "A": ArrayType(LREAL, -1, 2), "M": ArrayType(ArrayType(DINT, 1, 2), 0, 1),
}  # fmt: skip
SCOPE = scope_of(TYPES)
inf, nan = math.inf, math.nan


def results(text: str, everywhere: bool, **values: Any) -> dict[str, Any]:
    """The state after the algorithm, which is equal on all backends; Lua is among them only with everywhere."""
    checked = check(text, **TYPES)
    state = run_python(checked, SCOPE, values)
    others = [run_exact(checked, SCOPE, values)]
    if everywhere:
        others += [run_lua(checked, SCOPE, values, interpreter) for interpreter in LUA]
    for other in others:
        assert {n: v for n, v in other.items() if not same(v, state[n])} == {}
    return state
