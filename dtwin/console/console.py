"""One console: the hub, the desk, the sessions and the audit file, and how a command passes them all."""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import Any, Final

import msgspec

from dtwin.bus.messages import StopRequest
from dtwin.bus.proposals.deciding import DOORS, decide, have_answered
from dtwin.bus.proposals.messages import ProposalDecision
from dtwin.bus.session import Bus
from dtwin.bus.stopping import stop
from dtwin.bus.twin_messages import DeskState, MonitoringVerdict, Upload, WatchState
from dtwin.console.annunciator import Annunciator, Treatment
from dtwin.console.clocks import Clocks
from dtwin.console.commands import ConsoleCommand, Files, Form
from dtwin.console.hub import Hub
from dtwin.console.people.audit import Audit, AuditEntry
from dtwin.console.people.occupancy import NOBODY_KEEPS
from dtwin.console.people.sessions import Attempts, Session, Sessions
from dtwin.console.people.users import Role, Users, may
from dtwin.console.ring import Ring
from dtwin.console.telling import CellState
from dtwin.errors import CommunicationError, DtwinError, ParameterError, RecordingError

log = logging.getLogger(__name__)

NOT_YOURS: Final = "occupy the desk first"
RECOVERY: Final = "recovery"
"""The service that answers findings."""


class You(msgspec.Struct, frozen=True, tag_field="tell", tag="you"):
    """What a page is told of its own session.

    Attributes:
        user: name of the person.
        role: what the person may do.
        desk: name of the person who has the desk, "" when it is free.
        yours: whether this session has the desk.
        blocked: reason why a command is not possible now, by the name of the command; "" for those that are.
        zones: zones of a line whose desks this session has.
    """

    user: str
    role: str
    desk: str
    yours: bool
    blocked: dict[str, str]
    zones: tuple[str, ...] = ()


class Answer(msgspec.Struct, frozen=True):
    """What became of a command: whether it was carried out, in words, and the answer of the bus."""

    done: bool
    text: str
    reply: Any = None


class Console:
    """A console of one cell.

    Args:
        bus: session with the rights of the commands.
        hub: hub of the cell.
        clocks: clocks of the console.
        audit: audit file.
        files: folders and files that the console reads.
        users: users who may log in; None lets everybody who reaches the server in, with all rights.
        user: name of those who need not log in.
        annunciator: alarms of the cell.
    """

    def __init__(
        self,
        bus: Bus,
        hub: Hub,
        clocks: Clocks,
        audit: Audit,
        files: Files,
        users: Users | None,
        user: str,
        annunciator: Annunciator,
    ) -> None:
        self.hub = hub
        self.clocks = clocks
        self.annunciator = annunciator
        self.files = files
        self.users = users
        self.user = user
        self.sessions = Sessions()
        self.attempts = Attempts()
        self.desk = hub.desk
        self.ring = Ring(hub.task.colours, hub.joints)
        hub.motion.keep = self.ring.add
        self._bus = bus
        self._audit = audit

    def session(self, key: str | None) -> Session | None:
        """The session of a cookie with the rights that its person has now; None when it has ended.

        It ends when the person is a user no more, or has another password.
        """
        if self.users is None:
            return self.sessions.visitor(key, self.user)
        session = self.sessions.find(key, self.clocks.steady())
        if session is None:
            return None
        try:
            user = self.users.read().get(session.user)
        except ParameterError as error:  # Who cannot be known has no rights.
            log.warning("%s", error)
            return None
        if user is None or user.scrypt != session.proof:
            self.sessions.end(session.key)
            return None
        return replace(session, role=user.role)

    def you(self, session: Session, state: CellState) -> You:
        """What the page of a session is told of itself."""
        desk = self.desk.state or DeskState()
        return You(
            session.user,
            session.role,
            desk.user,
            desk.session == session.name,
            {name: self.refusal(command, session, state) for name, command in self.hub.commands.items()},
        )

    def refusal(self, command: ConsoleCommand, session: Session, state: CellState) -> str:
        """Why a session cannot give a command now, "" when it can; a stop needs nothing but its role."""
        if not may(session.role, command.role):
            return f"needs the role {command.role}, {session.user} is {session.role}"
        if command.always:
            return ""
        age = self.hub.age
        if age is None or age > self.hub.stale:
            return f"the values are older than {self.hub.stale:g} s"
        return command.blocked(state) or self._at_desk(session, state)

    def _at_desk(self, session: Session, state: CellState) -> str:
        """Why a session may not command from where it is, "" when it may, whatever the form says."""
        return _not_at(self.desk.state, session)

    def _refused(self, command: ConsoleCommand, form: Form, session: Session, state: CellState) -> str:
        """Why a session cannot give a command with this form now, "" when it can. Raises ParameterError."""
        return self.refusal(command, session, state)

    def command(self, name: str, content: bytes, session: Session, address: str) -> Answer:
        """Gives a command and notes it; blocks until the bus answers.

        Raises:
            RecordingError: the audit file cannot be written; then the command is not given, unless it stops the arm.
        """
        command = self.hub.commands[name]
        try:
            form = command.read(content)
            if not command.always:
                self.desk.ask("keep", session)
            state = self.hub.state()
            if reason := self._refused(command, form, session, state):
                return self._noted(name, msgspec.to_builtins(form), session, address, Answer(False, reason))
            message = command.message(form, session.user, self.files)
        except DtwinError as error:
            return self._noted(
                name, content[:1000].decode(errors="replace"), session, address, Answer(False, str(error))
            )
        try:
            self._note(f"{name}, given", msgspec.to_builtins(form), session, address, Answer(False, ""))
        except RecordingError as error:
            if not command.always:
                raise
            log.error("%s", error)
        try:
            answer = self._give(command, message)
        except (CommunicationError, ParameterError) as error:
            key, _, reason = str(error).partition(": ")
            answer = Answer(False, reason if key.startswith("dtwin/") and reason else str(error))
        self.hub.ask_again()
        return self._noted(name, msgspec.to_builtins(form), session, address, answer)

    def _give(self, command: ConsoleCommand, message: msgspec.Struct) -> Answer:
        """Gives a command; a stop is done when the cell shows it, in one way or another.

        Raises:
            CommunicationError: it is refused, or nobody answers.
        """
        if isinstance(message, StopRequest):
            stopped = stop(self._bus, message)
            trouble = f"; the torque is off, because: {stopped.trouble}" if stopped.trouble else ""
            return Answer(True, words(stopped.state) + trouble, msgspec.to_builtins(stopped.state))
        if isinstance(message, ProposalDecision):
            doors = {**DOORS, "answer": have_answered} if self.hub.is_here(RECOVERY) else DOORS
            decided = decide(self._bus, message, doors, self.hub.kept)
            return Answer(True, f"proposal {decided.number} is {decided.state}; {decided.outcome}".removesuffix("; "))
        assert command.topic.reply is not None
        reply: Any = self._bus.ask(command.topic, message, command.topic.reply)
        return Answer(True, words(reply), msgspec.to_builtins(reply))

    def keep_desk(self, session: Session) -> None:
        """Passes on a sign of life of a session, which keeps the desk if it has it and may command."""
        if may(session.role, "operator") and self.desk.held == session.name:
            self.desk.ask("keep", session)

    def change_desk(self, action: str, session: Session, address: str, zone: str = "") -> tuple[bool, str]:
        """Occupies or leaves the desk for a session, and notes it; returns whether that was done, and words for it.

        Raises:
            ParameterError: the action is neither occupy nor leave, or a zone is named: a cell has one desk.
            RecordingError: the audit file cannot be written.
        """
        if action not in ("occupy", "leave"):
            raise ParameterError(f"desk: expected occupy or leave, got {action[:50]!r}")
        if zone:
            raise ParameterError(f"zone: expected none, since a cell has one desk; got {zone[:50]!r}")
        if action == "leave":
            return self._leave(session, address)
        if not may(session.role, "operator"):
            refusal = f"needs the role operator, {session.user} is {session.role}"
        else:
            had = self.desk.ask("keep", session)
            refusal = _not_at(self.desk.ask("occupy", session), session)
        try:
            self._note("desk, occupy", {}, session, address, Answer(not refusal, refusal or "you have the desk"))
        except RecordingError:
            # What is not noted is not done.
            if not refusal and (had is None or had.session != session.name):
                self.desk.ask("leave", session)
            raise
        return not refusal, refusal or "you have the desk"

    def _leave(self, session: Session, address: str) -> tuple[bool, str]:
        """Leaves the desk, with a full disk, too: who leaves it commands nothing."""
        before = self.desk.ask("keep", session)
        done = before is not None and before.session == session.name
        after = self.desk.ask("leave", session) if done else before
        if after is None:
            text = NOBODY_KEEPS
        elif done:
            text = "the desk is free"
        else:
            text = f"you do not have the desk: {f'{after.user} has it' if after.session else 'it is free'}"
        answer = self._noted("desk, leave", {}, session, address, Answer(done, text))
        return answer.done, answer.text

    def note_login(self, name: str, address: str, role: Role | None) -> None:
        """Notes an attempt to log in, if there is room for that: a stop needs somebody who is logged in.

        Args:
            name: name that was given.
            address: address that it was given from.
            role: role of the person; None when the attempt has failed.
        """
        visitor = Session("", "", name[:32], role or "viewer")
        text = "the name or the password is wrong" if role is None else "welcome"
        self._noted("log in", {}, visitor, address, Answer(role is not None, text))

    def treat(self, action: str, treatment: Treatment, session: Session, address: str) -> Answer:
        """Does something about an alarm, and notes it; who has the desk has been asked for before.

        Raises:
            RecordingError: the audit file cannot be written; nothing is done then.
        """
        if not may(session.role, "operator"):
            refusal = f"needs the role operator, {session.user} is {session.role}"
        else:
            refusal = self._may_treat(treatment, session)
        name, content = f"alarm, {action[:50]}", msgspec.to_builtins(treatment)
        if refusal:
            answer = Answer(False, refusal)
        else:
            self._note(f"{name}, given", content, session, address, Answer(False, ""))
            try:
                self.annunciator.treat(action, treatment, self.clocks.wall(), session.user)
                answer = Answer(True, "done")
            except ParameterError as error:
                answer = Answer(False, str(error))
        return self._noted(name, content, session, address, answer)

    def _may_treat(self, treatment: Treatment, session: Session) -> str:
        """Why a session may not treat an alarm, "" when it may."""
        # Where nobody keeps the desk, alarms are treated all the same: one of them may be the bridge's own.
        desk = self.desk.state
        return "" if desk is None else _not_at(desk, session)

    def _noted(self, name: str, content: Any, session: Session, address: str, answer: Answer) -> Answer:
        """What became of something, noted; that there is no room for the note is told, and changes nothing."""
        try:
            self._note(name, content, session, address, answer)
        except RecordingError as error:
            log.error("%s", error)
            return Answer(answer.done, f"{answer.text}; not noted: {error}", answer.reply)
        return answer

    def _note(self, name: str, content: Any, session: Session, address: str, answer: Answer) -> None:
        entry = AuditEntry(
            round(self.clocks.wall(), 3),
            self.hub.frame().time,
            session.user,
            session.role,
            session.name,
            address,
            name,
            content,
            answer.done,
            answer.text,
        )
        self._audit.append(entry)


def _not_at(desk: DeskState | None, session: Session) -> str:
    """Why a session may not command from a desk, "" when it may."""
    if desk is None:
        return NOBODY_KEEPS
    if desk.session == session.name:
        return ""
    return f"{desk.user} has the desk" if desk.session else NOT_YOURS


def words(reply: Any) -> str:
    """An answer of the bus in words: what is so now."""
    if isinstance(reply, Upload) and reply.action != "refuse":
        return f"version {reply.version} in force since {reply.time:.1f} s{', on trial' if reply.on_trial else ''}"
    if isinstance(reply, WatchState):
        return f"the monitor watches with {reply.model}" if reply.running else "the monitor is stopped"
    if isinstance(reply, MonitoringVerdict):
        told = [f"{name} {unit.state}" for name, unit in reply.units.items() if unit.state != "nominal"]
        return "the arm as it is now counts as normal" + (f"; still told: {', '.join(told)}" if told else "")
    if (stop := getattr(reply, "stop", None)) is not None:
        return "the arm moves" if stop == "none" else f"stop: {stop}"
    return getattr(reply, "text", "") or "done"
