"""Generated programs: every backend gives the same bits."""

from __future__ import annotations

from typing import Any

from hypothesis import HealthCheck, given

from iec61499.st import ast
from iec61499.st.check import check_algorithm
from iec61499.st.parser import parse_algorithm
from iec61499.st.printer import print_algorithm
from tests.support.examples import examples
from tests.support.iec61499.st_harness import LUA, run_exact, run_lua, run_python, same
from tests.support.iec61499.st_programs import SCOPE, programs, states

relaxed = examples(80, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)


def agree(expected: dict[str, Any], got: dict[str, Any], tree: ast.ParsedAlgorithm, backend: str = "Python") -> None:
    wrong = {name: (expected[name], got[name]) for name in SCOPE if not same(expected[name], got[name])}
    assert not wrong, f"{backend}: {wrong}\n{print_algorithm(tree)}"


@relaxed
@given(tree=programs)
def test_printed_programs_parse_to_the_same_tree(tree: ast.ParsedAlgorithm) -> None:
    assert parse_algorithm(print_algorithm(tree)) == tree


@relaxed
@given(tree=programs, state=states)
def test_fast_and_exact_python_agree(tree: ast.ParsedAlgorithm, state: dict[str, Any]) -> None:
    checked = check_algorithm(tree, SCOPE, SCOPE.keys())
    result = run_python(checked, SCOPE, state)
    agree(run_exact(checked, SCOPE, state), result, tree)
    for name, data_type in SCOPE.items():
        assert same(data_type.wrap(result[name]), result[name]), f"{name} left its type"


@relaxed
@given(tree=programs, state=states)
def test_lua_agrees_with_python(tree: ast.ParsedAlgorithm, state: dict[str, Any]) -> None:
    checked = check_algorithm(tree, SCOPE, SCOPE.keys())
    expected = run_python(checked, SCOPE, state)
    for interpreter in LUA:
        agree(expected, run_lua(checked, SCOPE, state, interpreter), tree, interpreter)
