"""What recovery proposes to people instead of doing it, and what they have approved."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Final

from dtwin.bus.messages import DECIDE_PROPOSAL, LOOK, PROPOSE
from dtwin.bus.proposals.messages import AnswerRequest, Look, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.twin_messages import MonitoredUnit
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.recovery.answers import Measure, answer_to
from dtwin.recovery.desk import CriticalFinding, Desk, StoppedByController
from dtwin.recovery.operator import Operator
from dtwin.simulation.proposals.book import HOLDS, RECOVERY

NAME: Final = RECOVERY
"""Its name among proposals, in the history and among the events."""
RETRY: Final = 10.0
"""Plant time after which a proposal that was refused is made again, s."""


@dataclass
class Proposals:
    """The proposals of recovery at a cell.

    Attributes:
        desk: place at the bus of the cell.
        approved: proposals that are to be carried out.
        waiting: proposals that a person has to decide about, by their number.
        taken: numbers of the proposals that were asked for, each of which is carried out once.
        lock: held while that is decided, as several threads ask.
        again: plant time (s) at which findings whose proposal was refused are proposed again, by what they name.
    """

    desk: Desk
    approved: SimpleQueue[Proposal] = field(default_factory=SimpleQueue)
    waiting: dict[int, Proposal] = field(default_factory=dict)
    taken: set[int] = field(default_factory=set)
    lock: threading.Lock = field(default_factory=threading.Lock)
    again: dict[tuple[str, ...], float] = field(default_factory=dict)

    def propose(self, measure: Measure, found: Sequence[MonitoredUnit], able: str) -> None:
        """Proposes a measure against findings to a person, with what the arm can do then, "" if that is as before."""
        names = tuple(unit.parameter for unit in found)
        expected = [f"then {able}"] if able else []
        why = [f"{measure}: {answer_to(parse_fault_id(names[0])).why}", *expected, *(unit.text for unit in found)]
        request = ProposalRequest(NAME, "; ".join(why)[:1000], "answer", parameters=names)
        try:
            made = self.desk.bus.ask(PROPOSE, request, Proposal)
        except CommunicationError as error:
            self.desk.say(f"cannot propose to answer {' and '.join(names)}: {error}")
            self.again[names] = self.desk.time + RETRY
            return
        self.waiting[made.number] = made
        self.desk.say(
            f"proposal {made.number}: {measure} for {' and '.join(names)}; `dtwin mcp approve {made.number}`"
        )

    def request(self, asked: AnswerRequest) -> Proposal:
        """Takes on a proposal that a person has approved; called on another thread.

        Raises:
            ParameterError: it was not approved by this person, answers nothing, or was carried out.
            CommunicationError: nobody tells of the proposals.
        """
        told = self.desk.bus.ask(LOOK, None, Look).proposals
        found = next((each for each in told if each.number == asked.number), None)
        if found is None or found.request.kind != "answer":
            raise ParameterError(f"proposal {asked.number}: expected one that answers findings")
        if found.state != "approved" or found.by != asked.who or found.outcome:
            raise ParameterError(
                f"proposal {asked.number}: expected one that {asked.who} has approved and nobody did"
            )
        with self.lock:
            if found.number in self.taken:
                raise ParameterError(f"proposal {found.number}: it is being carried out already")
            self.taken.add(found.number)
        self.approved.put(found)
        return found

    def look(self, operator: Operator) -> None:
        """Carries out what was approved, and ends or renews proposals whose findings have changed."""
        while True:
            try:
                proposal = self.approved.get_nowait()
            except Empty:
                break
            self._carry_out(proposal, operator)
        for names in [names for names, time in self.again.items() if self.desk.time >= time]:
            del self.again[names]
            operator.forget(names)
        self._review(operator)

    def _carry_out(self, proposal: Proposal, operator: Operator) -> None:
        self.waiting.pop(proposal.number, None)
        reason = f"proposal {proposal.number} of {proposal.request.who}"
        try:
            outcome = operator.carry_out(proposal.request.parameters, proposal.by, reason)
        except (CriticalFinding, StoppedByController) as critical:
            self._report(proposal, f"interrupted: {critical}")
            raise
        except DtwinError as error:
            outcome = f"not done: {error}"
        self._report(proposal, outcome)

    def _report(self, proposal: Proposal, outcome: str) -> None:
        self.desk.say(f"proposal {proposal.number}: {outcome}")
        told = ProposalDecision(proposal.number, proposal.digest, proposal.by, "report", outcome[:1000])
        self.desk.bus.ask(DECIDE_PROPOSAL, told, Proposal)

    def _review(self, operator: Operator) -> None:
        """Declines own proposals about what is found no more, and has what nobody decided in time proposed again."""
        standing = self.desk.findings
        gone = [one for one in self.waiting.values() if not standing.keys() >= set(one.request.parameters)]
        for proposal in gone:
            del self.waiting[proposal.number]
            why = "it is found no more"
            self._decline(ProposalDecision(proposal.number, proposal.digest, NAME, "decline", why))
        if not self.waiting:
            return
        if self.desk.time < min(one.time for one in self.waiting.values()) + HOLDS:
            return
        states = {each.number: each.state for each in self.desk.bus.ask(LOOK, None, Look).proposals}
        for number in [number for number in self.waiting if states.get(number, "expired") == "expired"]:
            operator.forget(self.waiting.pop(number).request.parameters)

    def _decline(self, decision: ProposalDecision) -> None:
        try:
            self.desk.bus.ask(DECIDE_PROPOSAL, decision, Proposal)
        except CommunicationError as error:  # A person was quicker: what was approved comes as such.
            self.desk.say(str(error))
