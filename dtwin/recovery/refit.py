"""The arm identified anew from its motions since a change."""

from __future__ import annotations

from collections.abc import Sequence

from dtwin.bus.messages import DECIDE, IDENTIFY
from dtwin.bus.twin_messages import IdentificationDecision, IdentificationRequest, IdentificationState
from dtwin.errors import CommunicationError
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, symbol_of
from dtwin.recovery.desk import Desk

MODEL_NAME = "recovery"
"""Name under which identification keeps the model."""


def refitted(desk: Desk, arm: ArmParameters, names: Sequence[str], since: float) -> ArmParameters:
    """An arm of which some parameters are identified anew, from the motions of the empty arm.

    What is known of the same parameters of the other joints counts as it is.

    Args:
        desk: place at the bus of the cell.
        arm: arm as it was known.
        names: parameters that have changed.
        since: plant time from which on the motions count, s.

    Raises:
        CommunicationError: identification refuses, or its model is in doubt.
        Late: the time is over.
        Grave: a finding stands that stops the arm.
    """
    symbols = sorted({symbol_of(name) for name in names})
    request = IdentificationRequest(",".join(symbols), source="motion", since=since, anew=",".join(names))
    desk.say(f"asks identification for {' and '.join(names)} from the motions since {since:.2f} s")
    desk.bus.ask(IDENTIFY, request, IdentificationState)
    state = _model(desk)
    desk.bus.ask(DECIDE, IdentificationDecision(True, MODEL_NAME), IdentificationState)
    found = {
        name: state.parameters[name].value
        for name in PARAMETER_NAMES
        if name in state.parameters and symbol_of(name) in symbols
    }
    anew = arm.with_values(found)
    changes = ", ".join(f"{name} is {anew.get(name):.4f}, was {arm.get(name):.4f}" for name in names)
    desk.say(f"accepts the model: {changes}")
    return anew


def _model(desk: Desk) -> IdentificationState:
    for message in desk.messages():
        if isinstance(message, IdentificationState):
            if message.phase == "proposed":
                return message
            if message.phase == "refused":
                raise CommunicationError(f"identification: {message.text}")
    raise AssertionError("the messages only end with an exception")
