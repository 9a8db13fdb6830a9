"""Recovery that proposes: nothing moves until a person approves, but for a stop, which waits for nobody."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, cast

import pytest

from dtwin.bus.messages import DECIDE_PROPOSAL, LOOK, PROPOSE
from dtwin.bus.proposals.messages import AnswerRequest, Look, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import Topic
from dtwin.errors import CommunicationError, ParameterError
from dtwin.recovery.desk import Desk
from dtwin.recovery.measures import Measures
from dtwin.recovery.operator import Operator
from dtwin.recovery.proposals import NAME, RETRY, Proposals
from dtwin.simulation.proposals.book import HOLDS, Book
from tests.recovery.fake_cell import HEALTHY, FakeCell
from tests.support.ai import UPLOAD


class BookedCell(FakeCell):
    """A cell whose simulation service keeps the proposals.

    Args:
        path: file of the book.
        end: plant time after which the operator looks no more, s.

    Attributes:
        refusals: number of proposals that are refused before one is kept.
    """

    def __init__(self, path: Path, end: float = 60.0) -> None:
        super().__init__()
        self.book = Book(path)
        self.desk = Desk(cast(Bus, self), self.over, lambda time: None, end, NAME)
        self.proposals = Proposals(self.desk)
        self.refusals = 0

    def ask(self, topic: Topic, request: Any, reply: type, timeout: float = 5.0) -> Any:
        answers: dict[Topic, Callable[[Any], Any]] = {
            LOOK: lambda request: Look(UPLOAD, self.seen()),
            PROPOSE: self._propose,
            DECIDE_PROPOSAL: lambda request: self.book.decide(request, self.time, 3),
        }
        return answers[topic](request) if topic in answers else super().ask(topic, request, reply, timeout)

    def _propose(self, request: ProposalRequest) -> Proposal:
        if self.refusals:
            self.refusals -= 1
            raise CommunicationError("too many wait")
        return self.book.add(request, None, self.time)

    def seen(self) -> tuple[Proposal, ...]:
        return self.book.newest(self.time, 3)

    def approve(self, number: int, who: str = "carol") -> None:
        """A person approves, and asks recovery for it."""
        found = self.seen()[number - 1]
        self.book.decide(ProposalDecision(number, found.digest, who, "approve"), self.time, 3)
        self.proposals.request(AnswerRequest(number, who))

    def at(self, time: float, act: Callable[[], None]) -> None:
        """Has something done at a plant time (s)."""
        before = self.changing
        done: list[bool] = []

        def look() -> None:
            before()
            if self.time >= time and not done:
                done.append(True)
                act()

        self.changing = look

    def watch(self) -> Operator:
        """The operator that proposes, after its time."""
        measures = Measures(self.desk, HEALTHY)
        measures.refer()
        operator = Operator(self.desk, measures, self.proposals.propose, lambda: self.proposals.look(operator))
        operator.watch()
        return operator


@pytest.fixture
def cell(tmp_path: Path) -> BookedCell:
    return BookedCell(tmp_path / "proposals.jsonl")


def test_nothing_moves_without_an_approval(cell: BookedCell) -> None:
    cell.refits["K3"] = 0.9 * HEALTHY.get("K3")
    cell.found["K3"] = (20.0, -0.1, 0.001)
    operator = cell.watch()
    assert (cell.uploads, cell.identified, cell.stops, operator.steps) == ([], [], [], [])
    (proposed,) = cell.seen()
    assert (proposed.state, proposed.request.who, proposed.request.kind) == ("open", NAME, "answer")
    assert proposed.request.parameters == ("K3",)
    foreseen = "then the arm can work with 2 s a motion"
    assert proposed.request.why.startswith(f"refit: the model can have the torque that there is; {foreseen}; K3")


def test_what_an_arm_can_do_is_told_of_a_controller_that_knows_it(cell: BookedCell) -> None:
    """One that goes on with the old model loses its paths: that is no answer, as the answer is the new model."""
    cell.refits["K2"] = 0.85 * HEALTHY.get("K2")
    cell.found["K2"] = (20.0, -0.15, 0.001)
    cell.worse = lambda request: 9.0 if request.arm != HEALTHY and request.model != request.arm else 1.0
    cell.watch()
    assert "then the arm can work with 2 s a motion" in cell.seen()[0].request.why


def test_an_arm_that_cannot_hold_its_boxes_is_stopped_and_nobody_asked(cell: BookedCell) -> None:
    cell.found["K2"] = (20.0, -0.3, 0.001)
    cell.watch()
    assert not cell.seen()
    assert [stop.state for stop in cell.stops] == ["failed"]
    assert "cannot hold a box of 210 g at red: replace motor 2, then `dtwin release`" in cell.told[-1]


def test_a_proposal_that_may_end_in_a_stop_says_so(cell: BookedCell) -> None:
    cell.found["K2"] = (20.0, -0.3, 0.1)
    cell.watch()
    (proposed,) = cell.seen()
    assert (
        "; then the arm can work without a box only, it cannot hold a box of 210 g at red; " in proposed.request.why
    )


def test_what_is_approved_is_done_under_the_name_of_who_approved(cell: BookedCell) -> None:
    cell.refits["K3"] = 0.9 * HEALTHY.get("K3")
    cell.found["K3"] = (20.0, -0.1, 0.001)
    cell.at(30.0, partial(cell.approve, 1))
    operator = cell.watch()
    (upload,) = cell.uploads
    assert upload.model is not None
    assert upload.model.get("K3") == pytest.approx(0.9 * HEALTHY.get("K3"))
    assert (upload.who, upload.why.partition(":")[0]) == ("carol", "proposal 1 of recovery")
    assert [step.measure for step in operator.steps] == ["refit"]
    (proposed,) = cell.seen()
    assert (proposed.state, proposed.by, proposed.outcome) == ("approved", "carol", "uploaded, and its trial passed")


def test_an_answer_is_asked_for_by_who_approved_it_once(cell: BookedCell) -> None:
    cell.found["K3"] = (20.0, -0.1, 0.001)
    cell.refits["K3"] = 0.9 * HEALTHY.get("K3")
    refused: list[str] = []

    def forge() -> None:
        for number, who in ((1, "carol"), (7, "carol")):
            with pytest.raises(ParameterError, match="expected one that") as error:
                cell.proposals.request(AnswerRequest(number, who))
            refused.append(str(error.value))
        cell.approve(1)
        with pytest.raises(ParameterError, match="mallory has approved"):
            cell.proposals.request(AnswerRequest(1, "mallory"))
        with pytest.raises(ParameterError, match="being carried out already"):
            cell.proposals.request(AnswerRequest(1, "carol"))

    cell.at(30.0, forge)

    def again() -> None:
        with pytest.raises(ParameterError, match="and nobody did") as error:
            cell.proposals.request(AnswerRequest(1, "carol"))
        refused.append(str(error.value))

    cell.at(45.0, again)
    cell.watch()
    assert len(refused) == 3
    assert len(cell.uploads) == 1


def test_a_proposal_ends_with_its_finding(cell: BookedCell) -> None:
    cell.found["K3"] = (20.0, -0.1, 0.001)
    cell.at(40.0, cell.found.clear)
    cell.watch()
    (proposed,) = cell.seen()
    assert (proposed.state, proposed.by, proposed.outcome) == ("declined", NAME, "it is found no more")
    assert cell.uploads == []


def test_a_stop_waits_for_nobody(cell: BookedCell) -> None:
    cell.found["freeze2"] = (20.0, 1.0, 0.001)
    operator = cell.watch()
    assert len(cell.stops) == 1
    assert [step.measure for step in operator.steps] == ["stop"]
    assert cell.seen() == ()


def test_what_nobody_decides_in_time_is_proposed_again(tmp_path: Path) -> None:
    cell = BookedCell(tmp_path / "proposals.jsonl", 30.0 + HOLDS)
    cell.found["K3"] = (20.0, -0.1, 0.001)
    cell.watch()
    assert [(each.number, each.state) for each in cell.seen()] == [(1, "expired"), (2, "open")]


def test_a_proposal_that_is_refused_is_made_again(cell: BookedCell) -> None:
    cell.refusals = 1
    cell.found["K3"] = (20.0, -0.1, 0.001)
    cell.watch()
    (proposed,) = cell.seen()
    assert 20.0 + RETRY < proposed.time < 20.0 + RETRY + 3.0
    assert "cannot propose to answer K3: too many wait" in cell.told
