"""A running line on the bus: how it does, what another set-up would bring, proposals, set-ups, stops and releases.

Everything is answered between two cycles, by the thread that runs the line, so that nobody sees half a cycle.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as Late
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Final, TypeVar

from dtwin.bus.line.messages import FlowEffect, LineState, SetUpDone, SetUpQuestion, SetUpRequest, StationWord
from dtwin.bus.messages import (
    CHECKED,
    LINE_DECIDE,
    LINE_LOOK,
    LINE_PLAN,
    LINE_PREDICT,
    LINE_PROPOSE,
    LINE_RELEASE,
    LINE_STATE,
    LINE_STOP,
    SET_UP,
)
from dtwin.bus.proposals.messages import LineLook, LookRequest, Proposal, ProposalDecision, ProposalRequest
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError, DtwinError, ParameterError
from dtwin.line.line import CYCLE
from dtwin.line.live.asked import AskedRun
from dtwin.line.live.seen import plan_of, state_of
from dtwin.line.twins.overall import Choice
from dtwin.simulation.proposals.book import TWIN, Book, check_form

log = logging.getLogger(__name__)

KINDS: Final = ("set-up", "diagnosis")
"""Kinds of proposals that a line takes."""
R = TypeVar("R")


class LiveLine:
    """A line that is asked while it runs.

    Args:
        run: the line.
        book: book of the proposals.
        bus: session of the line.
        clock: gives a time that only grows, s.

    Attributes:
        late: number of cycles that began more than a cycle too late.
    """

    def __init__(self, run: AskedRun, book: Book, bus: Bus, clock: Callable[[], float]) -> None:
        self.late = 0
        self._run, self._book, self._clock = run, book, clock
        self._asked: SimpleQueue[tuple[Callable[[], Any], Future[Any]]] = SimpleQueue()
        run.propose = self._lay
        bus.answer(LINE_STATE, LookRequest, None, partial(self._between, self._state))
        bus.answer(LINE_LOOK, LookRequest, None, partial(self._between, self._look))
        plan = plan_of(run.line)
        bus.answer(LINE_PLAN, LookRequest, None, lambda: plan)
        for topic, message, act in (
            (LINE_PREDICT, SetUpQuestion, self._predict),
            (LINE_PROPOSE, ProposalRequest, self._propose),
            (LINE_DECIDE, ProposalDecision, self._decide),
            (SET_UP, SetUpRequest, self._set_up),
            (LINE_STOP, StationWord, partial(self._word, run.stop)),
            (LINE_RELEASE, StationWord, partial(self._word, run.release)),
        ):
            bus.answer(topic, message, partial(self._between, act))

    def run(self, realtime: bool, stopping: Callable[[], bool], report: Callable[[], None]) -> None:
        """Runs the line until its end, and answers between two cycles.

        Args:
            realtime: whether a cycle takes as long as in the plant; otherwise the next one follows at once.
            stopping: tells whether it shall end now.
            report: called after every cycle.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """
        began = self._clock() - self._run.time
        while not (self._run.over or stopping()):
            self._run.step()
            ahead = began + self._run.time - self._clock() if realtime else 0.0
            if ahead < -CYCLE:
                self.late += 1
                began -= ahead
            self.serve(max(0.0, ahead))
            report()

    def serve(self, seconds: float = 0.0) -> None:
        """Answers what was asked, and for some seconds what is asked meanwhile."""
        until = self._clock() + seconds
        while True:
            left = until - self._clock()
            try:
                asked, answer = self._asked.get(timeout=left) if left > 0.0 else self._asked.get_nowait()
            except Empty:
                return
            try:
                answer.set_result(asked())
            except DtwinError as error:
                answer.set_exception(error)

    def _between(self, act: Callable[..., R], *message: Any) -> R:
        """What comes of something that the thread of the line does between two cycles."""
        answer: Future[R] = Future()
        self._asked.put((partial(act, *message), answer))
        try:
            return answer.result(CHECKED)
        except Late:
            raise CommunicationError("the line is busy, or has come to its end; try again") from None

    def _state(self) -> LineState:
        return state_of(self._run, self.late)

    def _look(self) -> LineLook:
        return LineLook(self._run.version, self._book.newest(self._run.time, self._run.version))

    def _predict(self, asked: SetUpQuestion) -> FlowEffect:
        return self._run.effect(asked.set_up)

    def _propose(self, asked: ProposalRequest) -> Proposal:
        check_form(asked)
        if asked.kind not in KINDS:
            raise ParameterError(f"kind: expected {' or '.join(KINDS)}, since this is a line; got {asked.kind}")
        self._book.make_room(self._run.time, self._run.version, asked.who)
        effect = None
        if asked.set_up is not None:
            self._check_version(asked.set_up.based_on)
            if not asked.set_up.set_up:
                raise ParameterError("set_up: expected an operation at least that another station shall do")
            effect = self._run.effect(asked.set_up.set_up)
        return self._book.add(asked, effect, self._run.time)

    def _decide(self, decision: ProposalDecision) -> Proposal:
        return self._book.decide(decision, self._run.time, self._run.version)

    def _set_up(self, asked: SetUpRequest) -> SetUpDone:
        self._check_version(asked.based_on)
        if not asked.set_up:
            raise ParameterError("set_up: expected an operation at least that another station shall do")
        effect = self._run.set_up(asked.set_up, asked.who, asked.why)
        return SetUpDone(self._run.time, self._run.version, effect)

    def _word(self, act: Callable[[str, str, str], None], word: StationWord) -> LineState:
        act(word.station, word.who, word.why)
        return self._state()

    def _check_version(self, seen: int) -> None:
        if seen != self._run.version:
            raise ParameterError(
                f"based_on: the set-up has changed: in force is version {self._run.version}, got {seen}"
            )

    def _lay(self, choice: Choice, why: str) -> None:
        """Lays before a person what the twins would do."""
        run = self._run
        changes = {name: station for name, station in choice.assignment.items() if run.assignment[name] != station}
        request = SetUpRequest(TWIN, why[:1000], run.version, changes)
        try:
            self._book.make_room(run.time, run.version, TWIN)
            self._book.add(ProposalRequest(TWIN, why[:1000], "set-up", set_up=request), run.effect(changes), run.time)
        except DtwinError as error:
            log.error("the twins' proposal is not kept: %s", error)
