"""The arm identified anew from its motions since a change."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dtwin.bus.messages import DECIDE, IDENTIFY
from dtwin.bus.twin_messages import IdentificationDecision, IdentificationRequest, IdentificationState
from dtwin.errors import CommunicationError
from dtwin.monitoring.kinds import RELATIVE, parse_fault_id, plausible_sizes, reference
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, symbol_of
from dtwin.recovery.desk import Desk, DoubtfulFinding

PATIENCE: Final = 5.0
"""s for which a better estimate of the monitor is waited for"""
WELL: Final = 0.02
"""standard deviation of an estimate that is known well, relative to a plausible change"""
EARNED: Final = 0.5
"""Probability with which a parameter has to be what changed before an arm gets a model with it"""
MODEL_NAME: Final = "recovery"
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
        DeadlinePassed: the time is over.
        CriticalFinding: a finding stands that stops the arm.
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


def estimated(desk: Desk, arm: ArmParameters, healthy: ArmParameters, names: Sequence[str]) -> ArmParameters:
    """An arm of which some parameters are as the monitor estimates them, as soon as it knows them well.

    The monitor knows what an arm has beside its parameters, which a fit of motions to the equations of motion does
    not. While it examines a joint anew, what it has found there may be about to be withdrawn; a parameter of which it
    has withdrawn the finding is what it was before. One that is less probable than all other causes together is not
    believed, since nothing but the monitor's estimate stands behind it.

    Args:
        desk: place at the bus of the cell.
        arm: arm as it was known, with those parameters as they were before what was found.
        healthy: arm that the monitor began with.
        names: parameters that have changed.

    Raises:
        DoubtfulFinding: what changed is probably something else.
        DeadlinePassed: the time is over.
        CriticalFinding: a finding stands that stops the arm.
    """
    plausible, until = plausible_sizes(healthy), desk.time + PATIENCE
    units = {name: reference(name, healthy) if parse_fault_id(name).about.unit == RELATIVE else 1.0 for name in names}
    joints = {parse_fault_id(name).joint for name in names}
    desk.say(f"waits until the monitor knows {' and '.join(names)} well")
    for _ in desk.messages():
        known = {name: desk.findings[name] for name in names if name in desk.findings}
        well = all(unit.deviation * units[name] <= WELL * plausible[name] for name, unit in known.items())
        if desk.time >= until or (well and not joints & desk.examined):
            break
    doubted = [unit.text for unit in known.values() if unit.confidence < EARNED]
    if doubted:
        raise DoubtfulFinding(" and ".join(doubted))
    # An estimate near zero may lie below it, where no parameter of an arm is.
    sizes = {name: known[name].size * units[name] if name in known else 0.0 for name in names}
    values = {name: max(arm.get(name) + size, 0.0) for name, size in sizes.items()}
    anew = arm.with_values(values)
    changes = ", ".join(f"{name} is {anew.get(name):.4f}, was {arm.get(name):.4f}" for name in names)
    desk.say(f"takes what the monitor has estimated: {changes}")
    return anew


def _model(desk: Desk) -> IdentificationState:
    for message in desk.messages():
        if isinstance(message, IdentificationState):
            if message.phase == "proposed":
                return message
            if message.phase == "refused":
                raise CommunicationError(f"identification: {message.text}")
    raise AssertionError("the messages only end with an exception")
