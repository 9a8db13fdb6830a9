"""What can be commanded at the console of an arm of n joints: what its bridge, monitor and twin answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from dtwin.bus.messages import ARM_ROLL_BACK, RECOVERY_DECIDE
from dtwin.bus.proposals.messages import ProposalDecision
from dtwin.bus.twin_messages import IdentificationRequest
from dtwin.console.commands import COMMANDS, ConsoleCommand, Start, missing
from dtwin.console.telling import CellState


def _roll_back_blocked(state: CellState) -> str:
    if reason := missing(state, "simulation", "--simulation"):
        return reason
    return "" if state.model is not None and state.model.on_trial else "no model is on trial"


def _decision_blocked(state: CellState) -> str:
    if reason := missing(state, "recovery", "--recovery propose"):
        return reason
    return "" if any(each.state == "open" for each in state.proposals) else "no proposal waits"


_OWN: Final = (
    replace(
        COMMANDS["identify"],
        form=Start,
        message=lambda form, user, files: IdentificationRequest(source="motion"),
    ),
    replace(COMMANDS["rollback"], topic=ARM_ROLL_BACK, blocked=_roll_back_blocked),
    replace(
        COMMANDS["approve"],
        topic=RECOVERY_DECIDE,
        message=lambda form, user, files: ProposalDecision(form.number, form.digest, user, "approve"),
        blocked=_decision_blocked,
    ),
    replace(COMMANDS["decline"], topic=RECOVERY_DECIDE, blocked=_decision_blocked),
)
CHAIN_COMMANDS: Final[Mapping[str, ConsoleCommand]] = {
    **{name: COMMANDS[name] for name in ("stop", "release", "learn", "watch", "leave", "accept", "reject", "fault")},
    **{command.name: command for command in _OWN},
}
"""All commands by name."""
