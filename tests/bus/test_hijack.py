"""Queryables that others declare on a cell's keys: whoever has the cell's key hears the cell, and nobody else."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from dtwin.bus.codec import encode
from dtwin.bus.messages import RESET, Done, ResetRequest
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.signature import new_key
from dtwin.errors import CommunicationError, UnansweredError
from tests.support.bus import noting
from tests.support.ports import free_port
from tests.support.waiting import until

FALSE = Done(0.0, "done, says the hijacker")
TRUE = Done(0.0, "done")

Reply = Callable[[zenoh.Query], Any]


class Meeting:
    """An answerer and an asker with the cell's key, and a session of somebody without it.

    Attributes:
        meet: where they meet.
        asked: what the answerer was asked to do.
    """

    def __init__(self) -> None:
        self.meet = meet = f"tcp/127.0.0.1:{free_port()}"
        key = new_key()
        self.answerer, self.asker = Bus(open_peer(meet), key=key), Bus(open_peer(meet), key=key)
        self.stranger = open_peer(meet)
        self.asked: list[ResetRequest] = []
        self.answerer.answer(RESET, ResetRequest, noting(self.asked, TRUE), lambda: TRUE)
        self.key = self.asker.key(RESET)
        until(lambda: self.asker.ask(RESET, None, Done) == TRUE, "the answerer is found")

    def close(self) -> None:
        for bus in (self.answerer, self.asker, self.stranger):
            bus.close()

    @contextmanager
    def hijacked(self, expression: str, reply: Reply) -> Iterator[None]:
        """While somebody else answers a key expression, too, and says that his answers are complete."""
        seen: list[zenoh.Query] = []

        def take(query: zenoh.Query) -> None:
            seen.append(query)
            with query:
                reply(query)

        declared = self.stranger.declare_queryable(expression, Callback(take, lambda: None), complete=True)
        try:
            with self.asker._session.declare_querier(self.key, target=zenoh.QueryTarget.ALL) as querier:

                def hears() -> bool:
                    list(querier.get(attachment=b"a probe"))
                    return bool(seen)

                until(hears, "the hijacker is asked")
            yield
        finally:
            declared.undeclare()


@pytest.fixture(scope="module")
def meeting() -> Iterator[Meeting]:
    meeting = Meeting()
    yield meeting
    meeting.close()


def false(query: zenoh.Query) -> None:
    query.reply(str(query.key_expr), encode(FALSE))


def flood(query: zenoh.Query) -> None:
    for _ in range(1000):
        false(query)


def huge(query: zenoh.Query) -> None:
    query.reply(str(query.key_expr), 10_000_000 * b"x", attachment=10_000 * b"y")


def refusal(query: zenoh.Query) -> None:
    query.reply_err("not today")


def echo(query: zenoh.Query) -> None:
    """What was asked comes back as the answer, with its own signature."""
    attachment = query.attachment.to_bytes() if query.attachment else b""
    query.reply(str(query.key_expr), query.payload or b"", attachment=attachment)


@pytest.mark.parametrize("reply", [false, flood, huge, refusal, echo])
@pytest.mark.parametrize("expression", ["dtwin/cell/arm/emulator/reset", "dtwin/**"])
def test_a_hijacked_queryable_keeps_nothing_from_the_answerer(
    meeting: Meeting, expression: str, reply: Reply
) -> None:
    meeting.asked.clear()
    with meeting.hijacked(expression, reply):
        for seed in range(3):
            assert meeting.asker.ask(RESET, ResetRequest(seed), Done) == TRUE
    assert meeting.asked == [ResetRequest(seed) for seed in range(3)]


def test_a_hijacker_that_never_ends_its_answer_holds_up_nobody(meeting: Meeting) -> None:
    meeting.asked.clear()
    held: list[zenoh.Query] = []
    declared = meeting.stranger.declare_queryable("dtwin/**", Callback(held.append, lambda: None), complete=True)
    try:
        until(lambda: meeting.asker.ask(RESET, None, Done) == TRUE and held, "the hijacker is asked")
        assert meeting.asker.ask(RESET, ResetRequest(1), Done) == TRUE
    finally:
        declared.undeclare()
        held.clear()
    assert meeting.asked == [ResetRequest(1)]


def test_answers_of_somebody_else_are_told_and_no_answer_is_an_error(meeting: Meeting) -> None:
    with Bus(open_peer(meeting.meet), "empty", key=new_key()) as asker:
        key = asker.key(RESET)
        declared = meeting.stranger.declare_queryable(key, Callback(false, lambda: None), complete=True)
        with pytest.raises(UnansweredError, match="without the signature"):
            asker.ask(RESET, ResetRequest(1), Done, 1.0)
        assert asker.refused["unsigned"] > 0
        declared.undeclare()


def test_answers_to_other_requests_are_not_believed(meeting: Meeting) -> None:
    """The hijacker asks for the answers to other requests, and to this one, and passes them on."""
    kept: list[tuple[bytes, bytes]] = []

    def replay(query: zenoh.Query) -> None:
        for payload, attachment in kept:
            query.reply(str(query.key_expr), payload, attachment=attachment)

    def keep(reply: zenoh.Reply) -> None:
        if reply.ok is not None and reply.ok.attachment is not None:
            kept.append((reply.ok.payload.to_bytes(), reply.ok.attachment.to_bytes()))

    def pass_on(query: zenoh.Query) -> None:
        if query.attachment is not None:
            handler = Callback(keep, lambda: None)
            meeting.stranger.get(meeting.key, handler, payload=query.payload, attachment=query.attachment)

    with meeting.hijacked(meeting.key, pass_on):
        assert meeting.asker.ask(RESET, ResetRequest(1), Done) == TRUE
        until(lambda: kept, "the hijacker has answers with signatures")
    meeting.asked.clear()
    before = meeting.asker.refused["forged"]
    asked = []

    def refused() -> bool:
        asked.append(ResetRequest(2))
        assert meeting.asker.ask(RESET, asked[-1], Done) == TRUE
        return meeting.asker.refused["forged"] > before

    with meeting.hijacked(meeting.key, replay):
        until(refused, "an answer to another request comes before the true one, and is refused")
    assert meeting.asked == asked


def test_a_request_acts_once_however_often_it_comes(meeting: Meeting) -> None:
    seen: list[tuple[bytes, bytes]] = []

    def overhear(query: zenoh.Query) -> None:
        if query.attachment is not None and query.payload is not None:
            seen.append((query.payload.to_bytes(), query.attachment.to_bytes()))

    meeting.asked.clear()
    with meeting.hijacked("dtwin/**", overhear):
        assert meeting.asker.ask(RESET, ResetRequest(7), Done) == TRUE
        until(lambda: len(seen) > 1, "the request was overheard")
    assert meeting.asked == [ResetRequest(7)]
    before = meeting.answerer.refused["replayed"]
    for payload, attachment in 3 * tuple(seen):
        list(meeting.stranger.get(meeting.key, payload=payload, attachment=attachment, timeout=1.0))
    assert meeting.asked == [ResetRequest(7)]
    assert meeting.answerer.refused["replayed"] > before


def test_a_request_that_comes_late_or_to_another_life_does_not_act() -> None:
    """The clock of the answerer's challenges is set on, as if somebody had held the request back."""
    meet, key = f"tcp/127.0.0.1:{free_port()}", new_key()
    asked: list[ResetRequest] = []
    with Bus(open_peer(meet), key=key) as asker, open_peer(meet) as stranger:
        seen: list[tuple[bytes, bytes]] = []

        def overhear(query: zenoh.Query) -> None:
            if query.attachment is not None and query.payload is not None:
                seen.append((query.payload.to_bytes(), query.attachment.to_bytes()))

        stranger.declare_queryable("dtwin/**", Callback(overhear, lambda: None))
        with Bus(open_peer(meet), key=key) as first:
            first.answer(RESET, ResetRequest, noting(asked, TRUE))
            assert asker.ask(RESET, ResetRequest(1), Done) == TRUE
            until(lambda: len(seen) > 1, "the request was overheard")
        with Bus(open_peer(meet), key=key) as second:
            second.answer(RESET, ResetRequest, noting(asked, TRUE))

            def refused() -> bool:
                for payload, attachment in tuple(seen):
                    list(stranger.get(asker.key(RESET), payload=payload, attachment=attachment, timeout=1.0))
                return second.refused["late"] > 0

            until(refused, "the request of an earlier life comes late")
    assert asked == [ResetRequest(1)]


def test_whoever_has_no_key_does_nothing_and_is_told(meeting: Meeting) -> None:
    meeting.asked.clear()
    before = meeting.answerer.refused["unsigned"]
    replies = list(meeting.stranger.get(meeting.key, payload=encode(ResetRequest(5)), timeout=2.0))
    assert [reply.ok for reply in replies] == [None]
    assert meeting.asked == []
    assert meeting.answerer.refused["unsigned"] > before


def ignore(reply: zenoh.Reply) -> None:
    """Nobody wants to know."""


def test_a_flood_of_strangers_keeps_no_request_waiting(meeting: Meeting) -> None:
    meeting.asked.clear()
    over = threading.Event()

    def send() -> None:
        while not over.is_set():
            for payload in (b"", encode(ResetRequest(5)), 60_000 * b"["):
                meeting.stranger.get(meeting.key, Callback(ignore, lambda: None), payload=payload)

    thread = threading.Thread(target=send)
    before = meeting.answerer.refused.total()
    thread.start()
    try:
        until(lambda: meeting.answerer.refused.total() > before + 1000, "the flood has come")
        for seed in range(3):
            assert meeting.asker.ask(RESET, ResetRequest(seed), Done) == TRUE
    finally:
        over.set()
        thread.join()
    assert meeting.asked == [ResetRequest(seed) for seed in range(3)]
    assert meeting.answerer.refused["flood"] > 0


def test_a_refusal_is_signed_too(meeting: Meeting) -> None:
    with meeting.hijacked("dtwin/**", false), pytest.raises(CommunicationError, match="invalid"):
        meeting.asker.ask(RESET, FALSE, Done)
