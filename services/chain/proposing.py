"""What recovery of an arm of n joints proposes to people, kept in a file, and what they have decided."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

from dtwin.bus.messages import ANSWER, RECOVERY_DECIDE, RECOVERY_LOOK, Done
from dtwin.bus.proposals.messages import (
    AnswerRequest,
    LookRequest,
    Proposal,
    ProposalDecision,
    ProposalRequest,
    RecoveryLook,
)
from dtwin.bus.session import Bus
from dtwin.errors import ParameterError
from dtwin.simulation.proposals.book import RECOVERY, Book

_VERSION = 0
"""Version of the settings on which answers to findings stand: on none."""


class Proposing:
    """The proposals of recovery.

    Args:
        bus: session on which people look, and decide.
        path: file of the proposals.
        time: gives the plant time, s.
        approved: takes what is to be carried out, on another thread than that of the service.
    """

    def __init__(self, bus: Bus, path: Path, time: Callable[[], float], approved: Callable[[Proposal], None]) -> None:
        self._book = Book(path)
        self._time = time
        self._approved = approved
        self._taken: set[int] = set()
        self._lock = threading.Lock()
        bus.answer(RECOVERY_LOOK, LookRequest, None, self._look)
        bus.answer(RECOVERY_DECIDE, ProposalDecision, self._decide)
        bus.answer(ANSWER, AnswerRequest, self._request)

    def propose(self, why: str, parameter: str) -> Proposal:
        """Proposes to answer a finding.

        Raises:
            ParameterError: too many proposals wait already.
            RecordingError: it cannot be written down.
        """
        with self._lock:
            self._book.make_room(self._time(), _VERSION, RECOVERY)
            request = ProposalRequest(RECOVERY, why[:1000], "answer", parameters=(parameter,))
            return self._book.add(request, None, self._time())

    def expired(self, number: int) -> bool:
        """Whether nobody decided about a proposal in time."""
        with self._lock:
            told = self._book.newest(self._time(), _VERSION)
        return next((each.state == "expired" for each in told if each.number == number), True)

    def decline(self, proposal: Proposal, why: str) -> None:
        """Takes a proposal back.

        Raises:
            ParameterError: somebody was quicker.
        """
        self._decide(ProposalDecision(proposal.number, proposal.digest, RECOVERY, "decline", why))

    def report(self, proposal: Proposal, outcome: str) -> None:
        """Tells what came of a proposal that was approved."""
        self._decide(ProposalDecision(proposal.number, proposal.digest, proposal.by, "report", outcome[:1000]))

    def _look(self) -> RecoveryLook:
        with self._lock:
            return RecoveryLook(self._book.newest(self._time(), _VERSION))

    def _decide(self, decision: ProposalDecision) -> Proposal:
        with self._lock:
            return self._book.decide(decision, self._time(), _VERSION)

    def _request(self, asked: AnswerRequest) -> Done:
        """Takes on a proposal that a person has approved, once."""
        with self._lock:
            told = self._book.newest(self._time(), _VERSION)
            found = next((each for each in told if each.number == asked.number), None)
            if found is None or found.state != "approved" or found.by != asked.who or found.outcome:
                raise ParameterError(
                    f"proposal {asked.number}: expected one that {asked.who} has approved and nobody did"
                )
            if found.number in self._taken:
                raise ParameterError(f"proposal {found.number}: it is being carried out already")
            self._taken.add(found.number)
        self._approved(found)
        return Done(self._time(), f"proposal {found.number} is being carried out")
