"""A console of one line: as that of a cell, but that each zone has a desk of its own."""

from __future__ import annotations

from typing import Any, Final

import msgspec

from dtwin.bus.line.messages import FlowEffect, LineState, SetUpDone, StationWord
from dtwin.bus.line.plant import PlantState, PlantWord
from dtwin.bus.line.topics import LINE_STOP, PLANT_WORD
from dtwin.bus.proposals.deciding import LINE_DOORS, decide
from dtwin.bus.proposals.messages import ProposalDecision
from dtwin.console.annunciator import Treatment
from dtwin.console.commands import ConsoleCommand, Form
from dtwin.console.console import Answer, Console, You
from dtwin.console.line.annunciator import PREFIX
from dtwin.console.line.commands import LineCommand
from dtwin.console.line.desks import NOBODY_KEEPS, ZoneOccupancy, refusal
from dtwin.console.line.hub import LineHub
from dtwin.console.people.sessions import Session
from dtwin.console.people.users import may
from dtwin.console.telling import CellState
from dtwin.errors import ParameterError, RecordingError, UnansweredError, choices

STOP_PATIENCE: Final = 3.0
"""Longest wait for an answer to a stop before the other way is taken, s."""


class LineConsole(Console):
    """A console of one line; the arguments are those of `Console`."""

    hub: LineHub
    desk: ZoneOccupancy

    def you(self, session: Session, state: CellState) -> You:
        """What the page of a session is told of itself."""
        own = tuple(desk.zone for desk in self.desk.desks or () if desk.session == session.name)
        blocked = {name: self.refusal(command, session, state) for name, command in self.hub.commands.items()}
        return You(session.user, session.role, "", bool(own), blocked, own)

    def keep_desk(self, session: Session) -> None:
        """Passes on a sign of life of a session, which keeps the desks that it has if it may command."""
        if may(session.role, "operator") and self.desk.zones_of(session):
            self.desk.ask("keep", session)

    def change_desk(self, action: str, session: Session, address: str, zone: str = "") -> tuple[bool, str]:
        """Occupies or leaves the desk of a zone for a session, and notes it; that of all zones without one.

        Raises:
            ParameterError: the action is neither occupy nor leave, or there is no such zone.
            RecordingError: the audit file cannot be written.
        """
        if action not in ("occupy", "leave"):
            raise ParameterError(f"desk: expected occupy or leave, got {action[:50]!r}")
        known = [desk.zone for desk in self.desk.desks or ()]
        if not known:
            return False, NOBODY_KEEPS
        if zone and zone not in known:
            raise ParameterError(f"zone: expected {choices(known)}, got {zone[:50]!r}")
        zones = (zone,) if zone else tuple(known)
        named = f"desk of {zone or 'all zones'}, {action}"
        if action == "leave":
            done = self.desk.ask_for("leave", zones, session) is not None
            answer = Answer(done, f"free: {', '.join(zones)}" if done else NOBODY_KEEPS)
            answer = self._noted(named, {}, session, address, answer)
            return answer.done, answer.text
        had = self.desk.zones_of(session)
        if not may(session.role, "operator"):
            refused = f"needs the role operator, {session.user} is {session.role}"
        else:
            refused = refusal(self.desk.ask_for("occupy", zones, session), zones, session)
        answer = Answer(not refused, refused or f"you have the desk of {', '.join(zones)}")
        try:
            self._note(named, {}, session, address, answer)
        except RecordingError:
            # What is not noted is not done.
            self.desk.ask_for("leave", [each for each in zones if each not in had], session)
            raise
        return answer.done, answer.text

    def _refused(self, command: ConsoleCommand, form: Form, session: Session, state: CellState) -> str:
        if reason := self.refusal(command, session, state):
            return reason
        zones = command.zones(form, state) if isinstance(command, LineCommand) else ()
        return "" if zones is None or command.always else refusal(self.desk.desks, zones, session)

    def _at_desk(self, session: Session, state: CellState) -> str:
        return ""  # Which desks are needed only the form says.

    def _may_treat(self, treatment: Treatment, session: Session) -> str:
        if self.desk.desks is None:
            return ""
        face = self.hub.state().line
        station = treatment.name.removeprefix(f"{PREFIX}station ")
        zone = "" if face is None else face.zone_of(station)
        return refusal(self.desk.desks, (zone,) if zone else (), session)

    def _give(self, command: ConsoleCommand, message: msgspec.Struct) -> Answer:
        if isinstance(message, ProposalDecision):
            decided = decide(self._bus, message, LINE_DOORS, self.hub.kept)
            return Answer(True, f"proposal {decided.number} is {decided.state}; {decided.outcome}".removesuffix("; "))
        if command.topic is LINE_STOP and isinstance(message, StationWord):
            return self._stop(message)
        assert command.topic.reply is not None
        reply: Any = self._bus.ask(command.topic, message, command.topic.reply)
        return Answer(True, _words(reply), None if isinstance(reply, LineState) else msgspec.to_builtins(reply))

    def _stop(self, word: StationWord) -> Answer:
        """Stops an arm: the twin of the line does, or, when it does not answer, the plant itself."""
        try:
            self._bus.ask(LINE_STOP, word, LineState, STOP_PATIENCE)
        except UnansweredError as error:
            try:
                stop = PlantWord(word.station, "failed", f"{word.who}: {word.why}"[:1000])
                self._bus.ask(PLANT_WORD, stop, PlantState, STOP_PATIENCE)
            except UnansweredError:
                raise error from None
            return Answer(True, "the plant has stopped it, because the twin of the line does not answer")
        return Answer(True, "done")


def _words(reply: Any) -> str:
    """An answer of the line in words."""
    if isinstance(reply, SetUpDone):
        return f"set-up {reply.version} in force since {reply.time:.1f} s, {reply.effect.rate:.1f} boxes/h expected"
    if isinstance(reply, FlowEffect):
        return f"{reply.rate:.1f} boxes/h expected, {reply.rate_now:.1f} with the set-up in force"
    return "done"
