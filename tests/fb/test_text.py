"""The Structured Text of fb/ survives being printed."""

import pytest

from iec61499 import model
from iec61499.library import Library
from iec61499.st.parser import parse_algorithm, parse_expression
from iec61499.st.printer import print_algorithm, print_expression
from tests.support.driven import FOLDER

LIBRARY = Library([FOLDER])
BASIC = [kind for name in LIBRARY.names() if isinstance(kind := LIBRARY.find(name), model.BasicFBType)]
ALGORITHMS = [(kind, algorithm) for kind in BASIC for algorithm in kind.algorithms]


@pytest.mark.parametrize(
    ("kind", "algorithm"), [pytest.param(k, a, id=f"{k.header.name}.{a.name}") for k, a in ALGORITHMS]
)
def test_algorithms_are_the_same_tree_after_printing(kind: model.BasicFBType, algorithm: model.Algorithm) -> None:
    tree = parse_algorithm(algorithm.source.text)
    assert tree.name == algorithm.name
    printed = print_algorithm(tree)
    assert parse_algorithm(printed) == tree
    assert print_algorithm(parse_algorithm(printed)) == printed


@pytest.mark.parametrize("kind", BASIC, ids=lambda kind: kind.header.name)
def test_conditions_are_the_same_tree_after_printing(kind: model.BasicFBType) -> None:
    for transition in kind.transitions:
        if transition.guard:
            tree = parse_expression(transition.guard)
            assert parse_expression(print_expression(tree)) == tree
