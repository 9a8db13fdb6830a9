"""Which outputs of a basic or simple block are not published as soon as an algorithm has written them."""

from __future__ import annotations

from collections.abc import Mapping

from iec61499 import model
from iec61499.st import typed


def late_outputs(
    block: model.BasicFBType | model.SimpleFBType, checked: Mapping[str, typed.CheckedAlgorithm]
) -> set[str]:
    """The variables that an action writes without an event that has them in its WITH.

    What others sample of such an output is a copy, made by the last event that published it. A VAR_IN_OUT has none.
    """
    with_variables = {event.name: event.with_variables for event in block.interface.event_outputs}
    late: set[str] = set()
    for state in block.states:
        for action in state.actions:
            if action.algorithm:
                late |= _written(checked[action.algorithm]) - set(with_variables.get(action.output, ()))
    return late - set(block.interface.in_outs)


def _written(code: typed.CheckedAlgorithm) -> set[str]:
    return {node.name for node in typed.walk(code.body) if isinstance(node, typed.Store | typed.For)}
