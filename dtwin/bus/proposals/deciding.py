"""How a person's approval is carried out: with this person's own rights, through the doors that there are anyway.

The simulation service notes an approval once; then the approver's own session asks for what was approved. So nothing
moves for a forged, repeated or late approval: whoever sends it would have to ask for the change itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import msgspec

from dtwin.bus.line.messages import LineState, SetUpDone, StationWord
from dtwin.bus.line.topics import LINE_DECIDE, LINE_LOOK, LINE_SETTLE, SET_UP
from dtwin.bus.messages import (
    ACKNOWLEDGE,
    ANSWER,
    DECIDE_PROPOSAL,
    LOOK,
    RECOVERY_DECIDE,
    RECOVERY_LOOK,
    UPLOAD,
    Done,
    StopRequest,
)
from dtwin.bus.proposals.messages import (
    AnswerRequest,
    Kind,
    LineLook,
    Look,
    Proposal,
    ProposalDecision,
    RecoveryLook,
)
from dtwin.bus.session import Bus
from dtwin.bus.stopping import stop
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import AcknowledgeRequest, MonitoringVerdict, Upload
from dtwin.errors import CommunicationError, DtwinError, ParameterError, choices

Door = Callable[[Bus, Proposal, str], str | None]
"""Has what a proposal proposes done by a person, and tells what came of it; None when whoever does it reports that.
Raises DtwinError."""


@dataclass(frozen=True)
class Kept:
    """Who keeps proposals.

    Attributes:
        look: topic by which they are seen.
        told: message that tells them.
        decide: topic by which they are decided.
    """

    look: Topic
    told: type[Look] | type[LineLook] | type[RecoveryLook]
    decide: Topic

    def proposals(self, bus: Bus) -> tuple[Proposal, ...]:
        """The newest proposals, oldest first. Raises CommunicationError."""
        told: Look | LineLook | RecoveryLook = bus.ask(self.look, None, self.told)
        return told.proposals


CELL: Final = Kept(LOOK, Look, DECIDE_PROPOSAL)
LINE: Final = Kept(LINE_LOOK, LineLook, LINE_DECIDE)
ARM: Final = Kept(RECOVERY_LOOK, RecoveryLook, RECOVERY_DECIDE)
"""Of an arm that is not the thesis's."""


def find(bus: Bus, number: int, kept: Kept = CELL) -> Proposal:
    """The proposal of a number.

    Raises:
        ParameterError: there is none.
        CommunicationError: nobody answers.
    """
    told = kept.proposals(bus)
    for each in told:
        if each.number == number:
            return each
    known = f"expected {choices(str(each.number) for each in told)}" if told else "nothing has been proposed yet"
    raise ParameterError(f"proposal {number}: {known}")


def decide(bus: Bus, decision: ProposalDecision, doors: Mapping[Kind, Door], kept: Kept = CELL) -> Proposal:
    """Decides about a proposal, and has it carried out if it is approved.

    Args:
        bus: session of the person.
        decision: approve or decline, with the digest of what the person has seen.
        doors: what carries out each kind.
        kept: who keeps the proposals.

    Returns:
        the proposal afterwards, with what came of it.

    Raises:
        ParameterError: its kind cannot be carried out here; then it stays open.
        CommunicationError: the decision is refused, or what was approved is; then the proposal tells so.
    """
    door = None
    if decision.action == "approve":
        kind = find(bus, decision.number, kept).request.kind
        if (door := doors.get(kind)) is None:
            raise ParameterError(f"a proposal of the kind {kind}: approve it with `dtwin mcp approve`")
    decided = bus.ask(kept.decide, decision, Proposal)
    if door is None:
        return decided
    try:
        outcome = door(bus, decided, decision.who)
    except DtwinError as error:
        _report(bus, kept, decision, f"not done: {error}")
        raise CommunicationError(f"proposal {decided.number} was approved and is not done: {error}") from None
    return decided if outcome is None else _report(bus, kept, decision, outcome)


def _reason(proposal: Proposal) -> str:
    return f"proposal {proposal.number} of {proposal.request.who}: {proposal.request.why}"[:1000]


def _report(bus: Bus, kept: Kept, decision: ProposalDecision, outcome: str) -> Proposal:
    told = msgspec.structs.replace(decision, action="report", text=outcome[:1000])
    return bus.ask(kept.decide, told, Proposal)


def _upload(bus: Bus, proposal: Proposal, who: str) -> str:
    change = proposal.request.change
    assert change is not None
    done = bus.ask(UPLOAD, msgspec.structs.replace(change, who=who, why=_reason(proposal)), Upload)
    return f"version {done.version} in force{', on trial' if done.on_trial else ''}"


def _set_up(bus: Bus, proposal: Proposal, who: str) -> str:
    change = proposal.request.set_up
    assert change is not None
    done = bus.ask(SET_UP, msgspec.structs.replace(change, who=who, why=_reason(proposal)), SetUpDone)
    return f"version {done.version} of the set-up in force, {done.effect.rate:.1f} boxes/h expected"


def _settle(bus: Bus, proposal: Proposal, who: str) -> str:
    found = proposal.request.settle
    assert found is not None
    bus.ask(LINE_SETTLE, StationWord(who, _reason(proposal), found.station), LineState)
    return f"{found.station} {'is released and ' if found.releases else ''}works with {found.settings}"


def _acknowledge(bus: Bus, proposal: Proposal, who: str) -> str:
    for name in proposal.request.parameters:
        bus.ask(ACKNOWLEDGE, AcknowledgeRequest(name), MonitoringVerdict)
    return "the arm as it is now counts as normal"


def _stop(bus: Bus, proposal: Proposal, who: str) -> str:
    stopped = stop(bus, StopRequest(who, f"proposal {proposal.number}: {proposal.request.why}"[:1000]))
    return f"stop: {stopped.state.stop}"


def _agree(bus: Bus, proposal: Proposal, who: str) -> str:
    return "the diagnosis is noted as agreed with; nothing was changed"


def have_answered(bus: Bus, proposal: Proposal, who: str) -> None:
    """Has the recovery service of a cell answer findings, which reports what came of it."""
    bus.ask(ANSWER, AnswerRequest(proposal.number, who), Done)


LINE_DOORS: Mapping[Kind, Door] = {"set-up": _set_up, "settle": _settle, "diagnosis": _agree}
"""What carries out proposals at a line."""
DOORS: Mapping[Kind, Door] = {"settings": _upload, "acknowledge": _acknowledge, "stop": _stop, "diagnosis": _agree}
"""What one request carries out; an answer takes several and a while: the recovery service has it, if it is there."""
