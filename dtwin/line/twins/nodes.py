"""The twins of stations, whatever arms they have."""

from __future__ import annotations

from dtwin.line.chain.cell import arm_cell
from dtwin.line.line import Line, StationPlan
from dtwin.line.twins.chain import ChainNodeTwin
from dtwin.line.twins.node import NodeTwin

AnyNode = NodeTwin | ChainNodeTwin
"""The twin of a station."""


def node_of(line: Line, plan: StationPlan) -> AnyNode:
    """The twin of a station of a line. Raises DtwinError when its cell cannot be used."""
    cell, classes = arm_cell(plan), tuple(each.heaviest for each in line.classes)
    lightest, heaviest = line.source.lightest, line.source.heaviest
    if cell is None:
        return NodeTwin(plan, lightest, heaviest, classes)
    return ChainNodeTwin(plan, cell, lightest, heaviest, classes)
