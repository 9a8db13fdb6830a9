"""Structured Text as machine code has the results of the Python runtime, bit for bit."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from dtwin.iec61499.st import ast
from dtwin.iec61499.st.check import check_algorithm
from dtwin.iec61499.st.printer import print_algorithm
from tests.support.iec61499.c_harness import needs_compiler, run_c
from tests.support.iec61499.st_harness import run_python, same
from tests.support.iec61499.st_programs import SCOPE, programs, states


@needs_compiler
@settings(
    deadline=None,
    suppress_health_check=list(HealthCheck),
    max_examples=6,
    derandomize=True,
    phases=[Phase.generate],  # a smaller program would have to be compiled, too
)
@given(cases=st.lists(st.tuples(programs, states), min_size=20, max_size=20))
def test_c_agrees_with_python(
    cases: list[tuple[ast.ParsedAlgorithm, dict[str, Any]]], tmp_path_factory: pytest.TempPathFactory
) -> None:
    checked = [check_algorithm(tree, SCOPE, SCOPE.keys()) for tree, _ in cases]
    results = run_c(
        [(one, SCOPE, state) for one, (_, state) in zip(checked, cases, strict=True)], tmp_path_factory.mktemp("c")
    )
    for one, (tree, state), got in zip(checked, cases, results, strict=True):
        expected = run_python(one, SCOPE, state)
        assert isinstance(got, dict)
        wrong = {name: (expected[name], got[name]) for name in SCOPE if not same(expected[name], got[name])}
        assert not wrong, f"{wrong}\n{print_algorithm(tree)}"
