"""Proposals at the console: an answer to findings is approved where recovery is there to carry it out."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from dtwin.bus.messages import ANSWER, DECIDE_PROPOSAL, LOOK, Done
from dtwin.bus.proposals.messages import AnswerRequest, Look, LookRequest, ProposalDecision, ProposalRequest
from dtwin.simulation.proposals.book import Book
from tests.support.ai import UPLOAD
from tests.support.console import Served, serve
from tests.support.waiting import until


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    with serve(tmp_path) as served:
        served.live()
        yield served


def test_an_answer_is_approved_where_recovery_carries_it_out(served: Served, tmp_path: Path) -> None:
    book, bus, version = Book(tmp_path / "proposals.jsonl"), served.cell.bus, UPLOAD.version
    asked: list[AnswerRequest] = []

    def carry_out(request: AnswerRequest) -> Done:
        asked.append(request)
        return Done(1.0, "is being carried out")

    bus.answer(LOOK, LookRequest, None, lambda: Look(UPLOAD, book.newest(1.0, version)))
    bus.answer(DECIDE_PROPOSAL, ProposalDecision, lambda decision: book.decide(decision, 1.0, version))
    bus.answer(ANSWER, AnswerRequest, carry_out)
    served.cell.begin("simulation")
    made = book.add(ProposalRequest("recovery", "refit", "answer", parameters=("K3",)), None, 1.0)
    engineer = served.visitor()
    engineer.enter()
    assert engineer.post("/api/desk/occupy")[0] == 200
    until(lambda: served.console.hub.state().proposals, "the console knows of the proposal")
    form = {"number": 1, "digest": made.digest}
    served.live()
    status, answer = engineer.post("/api/command/approve", form)
    assert (status, answer["done"]) == (409, False)
    assert "approve it with `dtwin mcp approve`" in answer["text"]
    assert book.newest(1.0, version)[0].state == "open"
    assert [found.key for found in served.console.hub.state().conditions if found.kind == "trial"] == ["proposal"]
    served.cell.begin("recovery")
    until(lambda: served.console.hub.is_here("recovery"), "recovery is there")
    status, answer = engineer.post("/api/command/approve", form)
    assert (status, answer["text"]) == (200, "proposal 1 is approved")
    (proposal,) = book.newest(1.0, version)
    assert (proposal.state, proposal.by, proposal.outcome) == ("approved", served.console.user, "")
    assert asked == [AnswerRequest(1, served.console.user)]
