"""Functions that generated Python calls."""

from __future__ import annotations

from iec61499.st.python.helpers import COMMON, EXACT, FAST


def test_fast_and_exact_functions_have_the_same_names() -> None:
    assert FAST.keys() == EXACT.keys()
    assert not FAST.keys() & COMMON.keys()
