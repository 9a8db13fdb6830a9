"""A running line on the bus: how it does, what another set-up would bring, proposals, set-ups, stops and releases."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from typing import Final, Protocol

from dtwin.bus.line.messages import FlowEffect, LineState, SetUpDone, SetUpQuestion, SetUpRequest, StationWord
from dtwin.bus.line.plant import Settings
from dtwin.bus.line.topics import (
    LINE_DECIDE,
    LINE_LOOK,
    LINE_PLAN,
    LINE_PREDICT,
    LINE_PROPOSE,
    LINE_RELEASE,
    LINE_SETTLE,
    LINE_STATE,
    LINE_STOP,
    SET_UP,
)
from dtwin.bus.proposals.messages import (
    FoundSettings,
    LineLook,
    LookRequest,
    Proposal,
    ProposalDecision,
    ProposalRequest,
)
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import CHECKED
from dtwin.errors import DtwinError, ParameterError
from dtwin.line.line import Line
from dtwin.line.live.between import Between
from dtwin.line.live.pace import Pace
from dtwin.line.live.seen import line_state, plan_of, plant_state
from dtwin.line.run import LineRun
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Mode
from dtwin.line.twins.overall import Choice
from dtwin.line.twins.reorganisation import Reorganisation
from dtwin.simulation.proposals.book import TWIN, Book, check_form

log = logging.getLogger(__name__)

KINDS: Final = ("set-up", "diagnosis")
"""Kinds of proposals that a line takes."""


class Asked(Protocol):
    """A line that can be asked."""

    @property
    def time(self) -> float:
        """Plant time, s."""

    @property
    def work(self) -> Reorganisation:
        """Who does what in it."""

    def state(self) -> LineState:
        """How it does."""

    def stop(self, station: str, who: str, why: str) -> None:
        """Stops the arm of a station. Raises ParameterError."""

    def settle(self, station: str, who: str, why: str) -> None:
        """Has an arm work with the settings that its twin has found. Raises ParameterError."""

    def release(self, station: str, who: str, why: str) -> None:
        """Lets a stopped arm move again. Raises ParameterError."""


class Answers:
    """Answers what is asked of a line.

    Args:
        line: the line as it was built.
        asked: the line that runs.
        book: book of the proposals.
        bus: session of the line.
        between: what is done between two cycles.
        state: tells how the line does, on any thread; between two cycles if not given.
    """

    def __init__(
        self,
        line: Line,
        asked: Asked,
        book: Book,
        bus: Bus,
        between: Between,
        state: Callable[[], LineState] | None = None,
    ) -> None:
        self._line, self._book = asked, book
        self._stations = [station.name for station in line.stations]
        self._laid: dict[str, tuple[Settings | None, bool]] = {}
        ask = between.ask
        bus.answer(LINE_STATE, LookRequest, None, state or partial(ask, asked.state))
        bus.answer(LINE_LOOK, LookRequest, None, partial(ask, self._look))
        plan = plan_of(line)
        bus.answer(LINE_PLAN, LookRequest, None, lambda: plan)
        bus.answer(LINE_PREDICT, SetUpQuestion, partial(ask, self._predict))
        bus.answer(LINE_PROPOSE, ProposalRequest, partial(ask, self._propose))
        bus.answer(LINE_DECIDE, ProposalDecision, partial(ask, self._decide))
        bus.answer(SET_UP, SetUpRequest, partial(ask, self._set_up))
        bus.answer(LINE_STOP, StationWord, partial(ask, partial(self._word, asked.stop)))
        bus.answer(LINE_SETTLE, StationWord, partial(ask, partial(self._word, asked.settle)))
        bus.answer(LINE_RELEASE, StationWord, partial(ask, partial(self._word, asked.release)))

    def _look(self) -> LineLook:
        version = self._line.work.version
        return LineLook(version, self._book.newest(self._line.time, version))

    def _predict(self, asked: SetUpQuestion) -> FlowEffect:
        return self._line.work.effect(asked.set_up)

    def _propose(self, asked: ProposalRequest) -> Proposal:
        check_form(asked)
        if asked.kind not in KINDS:
            raise ParameterError(f"kind: expected {' or '.join(KINDS)}, since this is a line; got {asked.kind}")
        self._book.make_room(self._line.time, self._line.work.version, asked.who)
        effect = None
        if asked.set_up is not None:
            self._check(asked.set_up)
            effect = self._line.work.effect(asked.set_up.set_up)
        return self._book.add(asked, effect, self._line.time)

    def _decide(self, decision: ProposalDecision) -> Proposal:
        return self._book.decide(decision, self._line.time, self._line.work.version)

    def _set_up(self, asked: SetUpRequest) -> SetUpDone:
        self._check(asked)
        effect = self._line.work.set_up(asked.set_up, asked.who, asked.why)
        return SetUpDone(self._line.time, self._line.work.version, effect)

    def _word(self, act: Callable[[str, str, str], None], word: StationWord) -> LineState:
        act(word.station, word.who, word.why)
        return self._line.state()

    def _check(self, asked: SetUpRequest) -> None:
        """Checks that a request is made for the set-up in force, and changes something."""
        in_force = self._line.work.version
        if asked.based_on != in_force:
            raise ParameterError(
                f"based_on: the set-up has changed: in force is version {in_force}, got {asked.based_on}"
            )
        if not asked.set_up:
            raise ParameterError("set_up: expected an operation at least that another station shall do")

    def look_at_settings(
        self, mode: Mode, able: Callable[[str], Capability], in_force: Callable[[str], Settings | None]
    ) -> None:
        """Lays before a person the settings with which arms could work on, and withdraws those that are no longer so.

        Args:
            mode: what the twins may do; if they act, they need a person for arms alone that are stopped.
            able: tells what the arm of a station can do, as its twin says.
            in_force: tells what its blocks have in the place of the settings of its cell.
        """
        for station in self._stations:
            now = able(station)
            found, stopped = now.once_released or now, now.once_released is not None
            needed = (mode == "propose" or stopped) and found.settings != in_force(station)
            wanted = (found.settings, stopped) if needed else (None, False)
            if wanted != self._laid.get(station, (None, False)):
                self._laid[station] = wanted
                self._lay_settings(station, found, *wanted)

    def _lay_settings(self, station: str, found: Capability, wanted: Settings | None, stopped: bool) -> None:
        time = self._line.time
        try:
            self._book.withdraw(station, "other settings are in force, or something else is known of the arm")
            if wanted is None:
                return
            settle = FoundSettings(station, wanted.text(), found.ability, stopped)
            asked = ProposalRequest(TWIN, f"{found.ability}: {found.why}"[:1000], "settle", settle=settle)
            self._book.make_room(time, self._line.work.version, TWIN)
            self._book.add(asked, None, time)
        except DtwinError as error:
            log.error("the settings for %s are not proposed: %s", station, error)

    def lay(self, choice: Choice, why: str) -> None:
        """Lays before a person what the twins would do."""
        work, time = self._line.work, self._line.time
        changes = {name: station for name, station in choice.assignment.items() if work.assignment[name] != station}
        request = SetUpRequest(TWIN, why[:1000], work.version, changes)
        asked = ProposalRequest(TWIN, why[:1000], "set-up", set_up=request)
        try:
            self._book.make_room(time, work.version, TWIN)
            self._book.add(asked, work.effect(changes), time)
        except DtwinError as error:
            log.error("the twins' proposal is not kept: %s", error)


class LiveLine:
    """A line, with its twins, in one process that is asked while it runs.

    Args:
        run: the line.
        book: book of the proposals.
        bus: session of the line.
        clock: gives a time that only grows, s.

    Attributes:
        between: what is done between two cycles.
    """

    def __init__(self, run: LineRun, book: Book, bus: Bus, clock: Callable[[], float]) -> None:
        self.between = Between(clock, CHECKED)
        self._run, self._clock = run, clock
        self._late = 0
        self._answers = Answers(run.line, self, book, bus, self.between)
        run.propose = self._answers.lay

    @property
    def time(self) -> float:
        """Plant time, s."""
        return self._run.time

    @property
    def work(self) -> Reorganisation:
        """Who does what in it."""
        return self._run.work

    def state(self) -> LineState:
        """How it does."""
        run = self._run
        stopped = {name: "" for name in run.emulated if run.is_stopped(name)}
        plant = plant_state(run.floor, run.work.version, run.work.assignment, stopped, self._late)
        return line_state(run.line, run.settings.twins, plant, run.work, run.capability, run.course.decisions)

    def stop(self, station: str, who: str, why: str) -> None:
        """Stops the arm of a station. Raises ParameterError: there is none of that name."""
        self._run.stop(station, who, why)

    def settle(self, station: str, who: str, why: str) -> None:
        """Has an arm work with the settings that its twin has found. Raises ParameterError: there are none."""
        self._run.settle(station, who, why)

    def release(self, station: str, who: str, why: str) -> None:
        """Lets a stopped arm move again. Raises ParameterError: there is none of that name, or it is not stopped."""
        self._run.release(station, who, why)

    def run(self, realtime: bool, stopping: Callable[[], bool], report: Callable[[int], None]) -> None:
        """Runs the line until its end, and answers between two cycles.

        Args:
            realtime: whether a cycle takes as long as in the plant; otherwise the next one follows at once.
            stopping: tells whether it shall end now.
            report: called after every cycle with the number of late ones.

        Raises:
            DtwinError: a box has vanished, or an arm or the blocks have failed.
        """
        pace, emulated = Pace(self._clock, realtime), self._run.emulated
        while not (self._run.over or stopping()):
            self._run.step()
            mode = self._run.settings.twins
            self._answers.look_at_settings(mode, self._run.capability, lambda name: emulated[name].settings)
            self.between.serve(pace.ahead())
            self._late = pace.late
            report(self._late)
