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
    cell = arm_cell(plan)
    return NodeTwin(plan, line.source) if cell is None else ChainNodeTwin(plan, cell, line.source)
