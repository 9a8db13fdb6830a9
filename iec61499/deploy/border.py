"""The border of a composite block as a basic block, for devices on which a composite's network lies flat.

A composite samples its data inputs when an event enters it and publishes its data outputs when one leaves it, and
either crossing is an entry of the event queue. A flat network keeps both, in the same order, if a basic block stands
where the border was: what enters at X leaves to the blocks inside at INNER_X, and what they send to INNER_Y
leaves at Y.
"""

from __future__ import annotations

from typing import Final

from iec61499 import model
from iec61499.errors import FunctionBlockError

BORDER: Final = "BORDER"
"""Name of the border among the composite's blocks."""
_INNER: Final = "INNER_"


def inner_name(port: str) -> str:
    """The border's name for the side of a composite's port that the blocks inside see."""
    return _INNER + port


def border_type(composite: model.CompositeFBType) -> model.BasicFBType:
    """The basic block, under the composite's name.

    Raises:
        FunctionBlockError: two of its ports would have one name; names file and line.
    """
    interface = composite.interface
    names = interface.names()
    for name in names:
        if inner_name(name) in names:
            raise FunctionBlockError(
                f"port {inner_name(name)} of {composite.header.name}: expected another name, "
                f"as its border takes this one for the inside of {name}",
                composite.header.file,
                composite.header.line,
            )
    ports = model.Interface(
        (*interface.event_inputs, *(_inside(event) for event in interface.event_outputs)),
        (*(_inside(event) for event in interface.event_inputs), *interface.event_outputs),
        (*interface.inputs, *(_renamed(variable) for variable in interface.outputs)),
        (*(_renamed(variable) for variable in interface.inputs), *interface.outputs),
    )
    crossings = [
        *((event.name, inner_name(event.name), _copies(event, True)) for event in interface.event_inputs),
        *((inner_name(event.name), event.name, _copies(event, False)) for event in interface.event_outputs),
    ]
    states, transitions, algorithms = [model.ECState("START")], [], []
    for event, answer, text in crossings:
        name = f"ON_{event}"
        if text:
            algorithms.append(model.Algorithm(name, model.Source(text)))
        states.append(model.ECState(name, (model.ECAction(name if text else "", answer),)))
        transitions += [model.ECTransition("START", name, event), model.ECTransition(name, "START")]
    return model.BasicFBType(composite.header, ports, (), tuple(states), tuple(transitions), tuple(algorithms))


def _inside(event: model.EventPort) -> model.EventPort:
    return model.EventPort(inner_name(event.name), tuple(inner_name(name) for name in event.with_variables))


def _renamed(variable: model.Variable) -> model.Variable:
    return model.Variable(inner_name(variable.name), variable.type)


def _copies(event: model.EventPort, inwards: bool) -> str:
    """Structured Text that lets the data of an event across."""
    if inwards:
        return "".join(f"{inner_name(name)} := {name};\n" for name in event.with_variables)
    return "".join(f"{name} := {inner_name(name)};\n" for name in event.with_variables)
