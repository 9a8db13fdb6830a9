"""Short notation for the standard blocks: ports as one line of text, behaviour as rows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from iec61499 import model
from iec61499.files.block_types import split_condition
from iec61499.types import ArrayType, elementary

Row = tuple[str, str, str]
"""Transition condition, Structured Text to run, and event outputs to issue (separated by blanks)."""

_EVENT: Final = re.compile(r"(\w+)(?:\(([^)]*)\))?")


def interface(events: str, data: str) -> model.Interface:
    """Ports from `EI(G) -> EO0, EO1` and `G: BOOL -> Q: BOOL`; `DT: TIME[4]` is an array of four."""
    event_inputs, _, event_outputs = events.partition("->")
    inputs, _, outputs = data.partition("->")
    return model.Interface(_events(event_inputs), _events(event_outputs), variables(inputs), variables(outputs))


def _events(text: str) -> tuple[model.EventPort, ...]:
    return tuple(model.EventPort(name, tuple(with_list.split())) for name, with_list in _EVENT.findall(text))


def variables(text: str) -> tuple[model.Variable, ...]:
    """Variables from `IN1, IN2: ANY_NUM; K: UINT`."""
    result: list[model.Variable] = []
    for group in filter(str.strip, text.split(";")):
        names, _, type_name = group.partition(":")
        result += [model.Variable(name.strip(), _type(type_name.strip())) for name in names.split(",")]
    return tuple(result)


def _type(name: str) -> model.VariableType:
    if name.startswith("ANY"):
        return model.GenericType(name)
    base, _, size = name.rstrip("]").partition("[")
    return ArrayType(elementary(base), 0, int(size) - 1) if size else elementary(base)


def basic(
    name: str, comment: str, events: str, data: str, rows: Sequence[Row], internals: str = ""
) -> model.BasicFBType:
    """A block that waits in START; a row's condition takes it through a state with that row's action and back."""
    ports = interface(events, data)
    inputs = [event.name for event in ports.event_inputs]
    states, transitions, algorithms = [model.ECState("START")], [], []
    for number, (condition, text, outputs) in enumerate(rows, 1):
        event, guard = split_condition(condition, inputs)
        state, algorithm = f"{event}_{number}", ""
        if text:
            algorithm = f"ON_{state}"
            algorithms.append(model.Algorithm(algorithm, model.Source(text)))
        issued = outputs.split() or [""]
        actions = [model.ECAction(algorithm, issued[0]), *(model.ECAction("", output) for output in issued[1:])]
        states.append(model.ECState(state, tuple(actions)))
        transitions += [model.ECTransition("START", state, event, guard), model.ECTransition(state, "START")]
    header = model.TypeHeader(name, comment=comment)
    return model.BasicFBType(
        header, ports, variables(internals), tuple(states), tuple(transitions), tuple(algorithms)
    )


def function(name: str, comment: str, data: str, text: str, internals: str = "") -> model.SimpleFBType:
    """A block that computes its outputs from its inputs on REQ and confirms with CNF."""
    ports = interface("", data)
    inputs = tuple(variable.name for variable in ports.inputs)
    outputs = tuple(variable.name for variable in ports.outputs)
    ports = model.Interface(
        (model.EventPort("REQ", inputs),), (model.EventPort("CNF", outputs),), ports.inputs, ports.outputs
    )
    state = model.ECState("REQ", (model.ECAction("REQ", "CNF"),))
    algorithm = model.Algorithm("REQ", model.Source(text))
    return model.SimpleFBType(
        model.TypeHeader(name, comment=comment), ports, variables(internals), (state,), (algorithm,)
    )


def simple(
    name: str, inputs: tuple[model.Variable, ...], outputs: tuple[model.Variable, ...], text: str
) -> model.SimpleFBType:
    """A block that computes on REQ and confirms with CNF, its ports given as variables."""
    block = function(name, "", "", text)
    request = model.EventPort("REQ", tuple(variable.name for variable in inputs))
    confirmation = model.EventPort("CNF", tuple(variable.name for variable in outputs))
    ports = model.Interface((request,), (confirmation,), inputs, outputs)
    return model.SimpleFBType(block.header, ports, (), block.states, block.algorithms)


def composite(
    name: str, comment: str, ports: model.Interface, blocks: str, events: str, data: str
) -> model.CompositeFBType:
    """A network from `CTR: E_CTU; DLY: E_DELAY` and connections `START -> CTR.R; ...`."""
    network = model.FBNetwork(
        tuple(model.Block(n.strip(), t.strip()) for n, t in (item.split(":") for item in blocks.split(";"))),
        (),
        _connections(events),
        _connections(data),
    )
    return model.CompositeFBType(model.TypeHeader(name, comment=comment), ports, network)


def _connections(text: str) -> tuple[model.Connection, ...]:
    pairs = (item.split("->") for item in text.split(";"))
    return tuple(model.Connection(source.strip(), destination.strip()) for source, destination in pairs)
