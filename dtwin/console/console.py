"""One console: the hub, the desk, the sessions and the audit file, and how a command passes them all."""

from __future__ import annotations

import logging
from typing import Any, Final

import msgspec

from dtwin.bus.session import Bus
from dtwin.console.annunciator import Annunciator, Treatment
from dtwin.console.commands import COMMANDS, ConsoleCommand, Files
from dtwin.console.conditions import STALE
from dtwin.console.hub import Clocks, Hub
from dtwin.console.people.audit import Audit, AuditEntry
from dtwin.console.people.occupancy import TIME_OUT, Occupancy
from dtwin.console.people.sessions import Attempts, Session, Sessions
from dtwin.console.people.users import Role, Users, may
from dtwin.console.ring import Ring
from dtwin.console.telling import CellState
from dtwin.errors import CommunicationError, DtwinError, ParameterError, RecordingError

log = logging.getLogger(__name__)

NOT_YOURS: Final = "occupy the desk first"


class You(msgspec.Struct, frozen=True, tag_field="tell", tag="you"):
    """What a page is told of its own session.

    Attributes:
        user: name of the person.
        role: what the person may do.
        desk: name of the person who has the desk, "" when it is free.
        yours: whether this session has the desk.
        time_out: time without a sign of life after which the desk is free again, s.
        blocked: reason why a command is not possible now, by the name of the command; "" for those that are.
    """

    user: str
    role: str
    desk: str
    yours: bool
    time_out: float
    blocked: dict[str, str]


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
        self.desk = Occupancy()
        self.ring = Ring(hub.task.colours)
        self._bus = bus
        self._audit = audit

    def you(self, session: Session, state: CellState) -> You:
        """What the page of a session is told of itself."""
        holder = self.desk.holder(self.clocks.steady())
        return You(
            session.user,
            session.role,
            "" if holder is None else holder.user,
            holder is not None and holder.session == session.key,
            TIME_OUT,
            {name: self.refusal(command, session, state) for name, command in COMMANDS.items()},
        )

    def refusal(self, command: ConsoleCommand, session: Session, state: CellState) -> str:
        """Why a session cannot give a command now, "" when it can."""
        if not may(session.role, command.role):
            return f"needs the role {command.role}, {session.user} is {session.role}"
        age = self.hub.age
        if not command.always and (age is None or age > STALE):
            return "the values are older than 1 s"
        if reason := command.blocked(state):
            return reason
        holder = self.desk.holder(self.clocks.steady())
        if holder is None:
            return NOT_YOURS
        return "" if holder.session == session.key else f"{holder.user} has the desk"

    def command(self, name: str, content: bytes, session: Session, address: str) -> Answer:
        """Gives a command and notes it; blocks until the bus answers.

        Raises:
            RecordingError: the audit file cannot be written; then the command is not given, unless it stops the arm.
        """
        command = COMMANDS[name]
        try:
            form = command.read(content)
            state = self.hub.state()
            if reason := self.refusal(command, session, state):
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
        self.desk.touch(session.key, self.clocks.steady())
        try:
            assert command.topic.reply is not None
            reply: Any = self._bus.ask(command.topic, message, command.topic.reply)
            answer = Answer(True, _words(reply), msgspec.to_builtins(reply))
        except CommunicationError as error:
            answer = Answer(False, str(error).partition(": ")[2] or str(error))
        self.hub.ask_again()
        return self._noted(name, msgspec.to_builtins(form), session, address, answer)

    def change_desk(self, action: str, session: Session, address: str) -> tuple[bool, str]:
        """Occupies or leaves the desk for a session, and notes it; returns whether that was done, and words for it.

        Raises:
            ParameterError: the action is neither occupy nor leave.
            RecordingError: the audit file cannot be written.
        """
        now = self.clocks.steady()
        if action == "occupy":
            if not may(session.role, "operator"):
                done, text = False, f"needs the role operator, {session.user} is {session.role}"
            elif self.desk.occupy(session.key, session.user, now):
                done, text = True, "you have the desk"
            else:
                holder = self.desk.holder(now)
                done, text = False, f"{'somebody' if holder is None else holder.user} has the desk"
        elif action == "leave":
            self.desk.release(session.key)
            done, text = True, "the desk is free"
        else:
            raise ParameterError(f"desk: expected occupy or leave, got {action[:50]!r}")
        self._note(f"desk, {action}", {}, session, address, Answer(done, text))
        return done, text

    def note_login(self, name: str, address: str, role: Role | None) -> None:
        """Notes an attempt to log in; role is None when it has failed.

        Raises:
            RecordingError: the audit file cannot be written.
        """
        visitor = Session("", "", name[:32], role or "viewer", 0.0)
        text = "the name or the password is wrong" if role is None else "welcome"
        self._note("log in", {}, visitor, address, Answer(role is not None, text))

    def treat(self, action: str, treatment: Treatment, session: Session, address: str) -> Answer:
        """Does something about an alarm, and notes it.

        Raises:
            RecordingError: the audit file cannot be written.
        """
        holder = self.desk.holder(self.clocks.steady())
        if not may(session.role, "operator"):
            answer = Answer(False, f"needs the role operator, {session.user} is {session.role}")
        elif holder is None or holder.session != session.key:
            answer = Answer(False, NOT_YOURS if holder is None else f"{holder.user} has the desk")
        else:
            try:
                self.annunciator.treat(action, treatment, self.clocks.wall(), session.user)
                self.desk.touch(session.key, self.clocks.steady())
                answer = Answer(True, "done")
            except ParameterError as error:
                answer = Answer(False, str(error))
        self._note(f"alarm, {action[:50]}", msgspec.to_builtins(treatment), session, address, answer)
        return answer

    def _noted(self, name: str, content: Any, session: Session, address: str, answer: Answer) -> Answer:
        try:
            self._note(name, content, session, address, answer)
        except RecordingError as error:
            if not COMMANDS[name].always:
                raise
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


def _words(reply: Any) -> str:
    """An answer of the bus in words."""
    if (stop := getattr(reply, "stop", None)) is not None:
        return "the arm moves" if stop == "none" else f"stop: {stop}"
    return getattr(reply, "text", "") or "done"
