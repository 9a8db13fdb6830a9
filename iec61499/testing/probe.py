"""The network in which a block is tested: the block alone, and a probe that notes which events come out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from iec61499 import model
from iec61499.types import INT, UINT, ArrayType

BLOCK: Final = "TESTED"
"""Name of the block under test."""
PROBE: Final = "PROBE"
"""Name of the block that notes the events."""
NOTED: Final = 200
"""Most events that are noted of one call."""


def probe_type(kind: model.LibraryElement) -> model.BasicFBType:
    """A block with an input for each event output; LOG holds the numbers of those that came, COUNT how many did."""
    outputs = kind.interface.event_outputs
    events = tuple(model.EventPort(f"E{number}") for number in range(len(outputs)))
    noting = f"IF COUNT < {NOTED} THEN LOG[UINT_TO_INT(COUNT)] := {{}}; END_IF; COUNT := COUNT + 1;"
    algorithms = tuple(
        model.Algorithm(f"NOTE{number}", model.Source(noting.format(number))) for number in range(len(outputs))
    )
    states = (
        model.ECState("START"),
        *(model.ECState(f"S{number}", (model.ECAction(f"NOTE{number}"),)) for number in range(len(outputs))),
    )
    there = (model.ECTransition("START", f"S{number}", f"E{number}") for number in range(len(outputs)))
    back = (model.ECTransition(f"S{number}", "START") for number in range(len(outputs)))
    internals = (model.Variable("LOG", ArrayType(INT, 0, NOTED - 1)), model.Variable("COUNT", UINT))
    name = f"{PROBE}_{len(outputs)}"
    return model.BasicFBType(
        model.TypeHeader(name), model.Interface(events), internals, states, (*there, *back), algorithms
    )


def network(kind: model.LibraryElement, parameters: Mapping[str, str], probed: bool = True) -> model.FBNetwork:
    """The block with literals at its inputs, and behind its event outputs the probe, unless it is left out."""
    given = tuple(model.Parameter(name, value) for name, value in parameters.items())
    outputs = tuple(event.name for event in kind.interface.event_outputs)
    blocks = (model.Block("START", "E_RESTART"), model.Block(BLOCK, kind.header.name, given))
    if not probed:
        return model.FBNetwork(blocks)
    noting = model.Block(PROBE, f"{PROBE}_{len(outputs)}")
    events = tuple(model.Connection(f"{BLOCK}.{name}", f"{PROBE}.E{number}") for number, name in enumerate(outputs))
    return model.FBNetwork((*blocks, noting), events=events)
