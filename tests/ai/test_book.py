"""Proposals are decided once, in time, as they were seen."""

from pathlib import Path

import pytest
from msgspec.structs import replace

from dtwin.bus.codec import SIZE_LIMIT, encode
from dtwin.bus.proposals.messages import SHOWN, Effect, Look, ProposalDecision, ProposalRequest
from dtwin.bus.twin_messages import UploadRequest
from dtwin.cli import main
from dtwin.errors import ParameterError, RecordingError
from dtwin.simulation.proposals.book import (
    CHECKED_IN,
    HOLDS,
    LONGEST,
    MOST_CHECKED,
    MOST_OPEN,
    OWN,
    RECOVERY,
    SPARED,
    Book,
    check_form,
)
from tests.support.ai import UPLOAD

SLOWER = ProposalRequest("ai", "slower", "settings", UploadRequest("ai", "slower", 3, target_time=3.0))
STOP = ProposalRequest("ai", "look at it", "stop")


@pytest.fixture
def book(tmp_path: Path) -> Book:
    return Book(tmp_path / "proposals.jsonl")


def approval(number: int, digest: str, who: str = "carol") -> ProposalDecision:
    return ProposalDecision(number, digest, who, "approve")


def test_an_approval_counts_once(book: Book) -> None:
    made = book.add(SLOWER, None, 10.0)
    assert book.decide(approval(1, made.digest), 11.0, 3).state == "approved"
    with pytest.raises(ParameterError, match="approved already by carol"):
        book.decide(approval(1, made.digest), 12.0, 3)


def test_an_approval_of_another_proposal_than_was_seen_is_refused(book: Book) -> None:
    first, second = book.add(SLOWER, None, 10.0), book.add(STOP, None, 10.0)
    for number, digest in ((1, second.digest), (2, first.digest), (1, "0" * 32), (1, "")):
        with pytest.raises(ParameterError, match="another one than was seen"):
            book.decide(approval(number, digest), 11.0, 3)
    with pytest.raises(ParameterError, match="none of this number"):
        book.decide(approval(7, first.digest), 11.0, 3)
    assert [each.state for each in book.newest(11.0, 3)] == ["open", "open"]


@pytest.mark.parametrize(
    ("time", "version", "why"),
    [(10.0 + HOLDS + 0.1, 3, "nobody approved it"), (11.0, 4, "stands on version 3"), (9.0, 3, "an earlier run")],
)
def test_a_late_approval_is_refused(book: Book, time: float, version: int, why: str) -> None:
    made = book.add(SLOWER, None, 10.0)
    with pytest.raises(ParameterError, match=why):
        book.decide(approval(1, made.digest), time, version)


def test_what_was_decided_outlives_the_service(tmp_path: Path) -> None:
    path = tmp_path / "proposals.jsonl"
    book = Book(path)
    made = [book.add(request, None, 10.0) for request in (SLOWER, STOP)]
    book.decide(approval(1, made[0].digest), 11.0, 3)
    again = Book(path)
    assert [each.state for each in again.newest(12.0, 3)] == ["approved", "open"]
    with pytest.raises(ParameterError, match="approved already"):
        again.decide(approval(1, made[0].digest), 12.0, 3)


def test_a_book_that_was_changed_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "proposals.jsonl"
    Book(path).add(STOP, None, 10.0)
    path.write_bytes(path.read_bytes().replace(b"look at it", b"trust me"))
    with pytest.raises(RecordingError, match="as it was written"):
        Book(path)


def test_what_came_of_it_is_told_by_who_approved_it_alone(book: Book) -> None:
    made = book.add(STOP, None, 10.0)
    report = ProposalDecision(1, made.digest, "carol", "report", "stop: standstill")
    with pytest.raises(ParameterError, match="expected a report of who approved it"):
        book.decide(report, 11.0, 3)
    book.decide(approval(1, made.digest), 11.0, 3)
    with pytest.raises(ParameterError, match="expected a report of who approved it"):
        book.decide(replace(report, who="mallory"), 12.0, 3)
    assert book.decide(report, 12.0, 3).outcome == "stop: standstill"


def test_not_more_wait_than_a_person_can_look_at(book: Book) -> None:
    for _ in range(MOST_OPEN - SPARED):
        book.make_room(10.0, 3, "ai")
        book.add(STOP, None, 10.0)
    with pytest.raises(ParameterError, match="6 proposals wait for a person already"):
        book.make_room(10.0, 3, "ai")
    for _ in range(SPARED):
        book.make_room(10.0, 3, RECOVERY)
        book.add(replace(STOP, who=RECOVERY), None, 10.0)
    with pytest.raises(ParameterError, match="8 proposals wait for a person already"):
        book.make_room(10.0, 3, RECOVERY)


def test_nobody_keeps_the_twin_busy_with_proposals_that_are_refused(book: Book) -> None:
    most = MOST_CHECKED - SPARED
    for tenth in range(most):
        book.make_room(10.0 + 0.1 * tenth, 3, "ai")
    with pytest.raises(ParameterError, match=r"at most 10 within 30 s, .* wait until 40\.0 s"):
        book.make_room(20.0, 3, "ai")
    book.make_room(10.0 + CHECKED_IN, 3, "ai")
    with pytest.raises(ParameterError, match=r"wait until 40\.1 s"):
        book.make_room(10.0 + CHECKED_IN, 3, "ai")


def test_recovery_finds_room_whatever_others_propose(book: Book) -> None:
    for _ in range(MOST_CHECKED - SPARED):
        book.make_room(10.0, 3, "ai")
    for _ in range(SPARED):
        book.make_room(10.0, 3, RECOVERY)
    for who in ("ai", RECOVERY):
        with pytest.raises(ParameterError, match=r"wait until 40\.0 s"):
            book.make_room(11.0, 3, who)


@pytest.mark.parametrize(
    "request_",
    [
        replace(SLOWER, change=None),
        replace(STOP, change=SLOWER.change),
        replace(STOP, parameters=("K2",)),
        replace(STOP, kind="answer"),
        replace(STOP, kind="diagnosis"),
        replace(STOP, text="and then"),
    ],
)
def test_a_request_proposes_one_thing(request_: ProposalRequest) -> None:
    with pytest.raises(ParameterError, match="expected"):
        check_form(request_)


@pytest.mark.parametrize("letter", ["x", "漢", "\U0001f600"])
def test_what_is_told_of_proposals_is_never_too_long_and_has_all_that_wait(book: Book, letter: str) -> None:
    longest = ProposalRequest("ai", letter * 500, "diagnosis", text="")
    longest = replace(longest, text=letter * ((LONGEST - len(encode(longest))) // len(letter.encode())))
    for number in range(1, 2 * SHOWN):
        made = book.add(replace(longest, text=longest.text[:1000]), None, 10.0)
        book.decide(ProposalDecision(number, made.digest, "carol", "decline", letter * 1000), 10.0, 3)
    effect = Effect((1e-3 / 3,) * 3, 1 / 3, (10 / 3,) * 3, ("K1: 0.333333 becomes 0.666667",) * 50, (1e-3 / 3,) * 3)
    waiting = [book.add(longest, effect, 10.0) for _ in range(MOST_OPEN)]
    told = book.newest(10.0, 3)
    assert set(waiting) <= set(told)
    assert [each.number for each in told] == sorted(each.number for each in told)
    assert len(told) > MOST_OPEN or letter != "x"
    assert len(encode(Look(UPLOAD, told))) <= SIZE_LIMIT


def test_a_proposal_of_too_many_bytes_is_refused() -> None:
    with pytest.raises(ParameterError, match=rf"proposal: expected at most {LONGEST} bytes, got \d+"):
        check_form(ProposalRequest("ai", "漢" * 1000, "diagnosis", text="漢" * 1000))


@pytest.mark.parametrize("name", OWN)
def test_nobody_else_proposes_under_the_name_of_a_service(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("mcp", reason="pip install 'dtwin[mcp]'")
    assert main(["mcp", "--who", name]) == 2
    assert "a service proposes under it" in capsys.readouterr().err
