"""The commands of the page: each is one query of the bus, with who may give it and when it is possible.

The page sends a form; the server fills in who asks, so that nobody speaks in another one's name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from dtwin.bus.messages import (
    ACKNOWLEDGE,
    DECIDE,
    DECIDE_PROPOSAL,
    FAULT,
    IDENTIFY,
    RELEASE,
    ROLL_BACK,
    STOP,
    UPLOAD,
    WATCH,
    FaultRequest,
    ReleaseRequest,
    StopRequest,
)
from dtwin.bus.proposals.messages import ProposalDecision
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import (
    AcknowledgeRequest,
    DataSource,
    IdentificationDecision,
    IdentificationRequest,
    Kilograms,
    RollBackRequest,
    UploadRequest,
    WatchRequest,
)
from dtwin.bus.verdicts.opinion import is_known
from dtwin.console.people.users import Role
from dtwin.console.telling import CellState
from dtwin.errors import ParameterError
from dtwin.identification.store import STORE, ModelStore
from dtwin.names import Name
from dtwin.parameters import Gains
from dtwin.signals import Count, Line, Seconds, Word


class Form(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A form without fields."""


class Reasoned(Form, frozen=True):
    """A form with a reason in the words of who asks."""

    why: Line = "no reason given"


class Decision(Form, frozen=True):
    """A form that accepts a proposed model, as in `IdentificationDecision`."""

    name: Name = "arm"
    upload: bool = False
    anyway: bool = False


class Start(Form, frozen=True):
    """A form that starts an identification, as in `IdentificationRequest`."""

    free: Line = IdentificationRequest().free
    box_mass: Kilograms | None = None
    source: DataSource = "signal"
    since: Seconds = 0.0
    anew: Line = ""


class Seen(Form, frozen=True):
    """A form that decides about a proposal as it was shown."""

    number: Count
    digest: Word
    why: Line = ""


class Parameter(Form, frozen=True):
    """A form that names the parameter of a finding; "" for all findings."""

    parameter: Line = ""


class Injection(Form, frozen=True):
    """A form with a fault in the notation of `dtwin run --fault`."""

    fault: Line


class Settings(Form, frozen=True):
    """A form with new settings, as in `UploadRequest`; models are named as in the store."""

    why: Line
    based_on: Count
    gains: Gains | None = None
    target_time: float | None = None
    payload: Kilograms | None = None
    model: Line | None = None
    version: Count | None = None
    arm: Line | None = None


@dataclass(frozen=True)
class Files:
    """Folders and files that the console reads.

    Attributes:
        store: folder of the identified models.
        history: history of the settings.
        recordings: folder of the logs that can be replayed; None for none.
    """

    store: Path = STORE
    history: Path = Path("uploads.jsonl")
    recordings: Path | None = None


@dataclass(frozen=True)
class ConsoleCommand:
    """A command of the page.

    Attributes:
        name: name in addresses and in the audit file.
        role: least role of who may give it.
        form: type of the form that the page sends.
        topic: query of the bus.
        message: makes the message of the query from the form, the user's name and the files.
        blocked: says why the command is not possible in a state of the cell, "" when it is.
        always: whether the command needs no desk, no fresh values and no room for its audit: a stop does not.
    """

    name: str
    role: Role
    form: type[Form]
    topic: Topic
    message: Callable[[Any, str, Files], msgspec.Struct]
    blocked: Callable[[CellState], str]
    always: bool = False

    def read(self, content: bytes) -> Form:
        """The form in the body of a request.

        Raises:
            ParameterError: the body is no such form.
        """
        try:
            return msgspec.json.decode(content or b"{}", type=self.form)
        except msgspec.MsgspecError as error:
            raise ParameterError(f"{self.name}: {error}") from None


def missing(state: CellState, service: str, option: str) -> str:
    """Why a command that needs a service is not possible, "" if the service is there; `option` starts it."""
    health = state.services.get(service)
    if health is not None and health.here:
        return ""
    command = f"dtwin up {option}".strip()
    return f"no {service} service: `{command}` starts one"


def _never_blocked(state: CellState) -> str:
    return ""


def _release_blocked(state: CellState) -> str:
    if state.stop == "none":
        return "nothing is stopped"
    return "the arm still brakes" if state.stop == "braking" else ""


def _learn_blocked(state: CellState) -> str:
    if reason := missing(state, "monitoring", "--monitoring"):
        return reason
    verdict = state.verdict
    found = (
        verdict is not None
        and is_known(verdict)
        and (verdict.forecasts or any(unit.state != "nominal" for unit in verdict.units.values()))
    )
    return "" if found else "there is no finding"


def _start_blocked(state: CellState) -> str:
    if reason := missing(state, "monitoring", "--monitoring"):
        return reason
    return "the monitor watches already" if state.watch is not None and state.watch.running else ""


def _leave_blocked(state: CellState) -> str:
    if reason := missing(state, "monitoring", "--monitoring"):
        return reason
    return "the monitor is stopped already" if state.watch is not None and not state.watch.running else ""


def _identify_blocked(state: CellState) -> str:
    if reason := missing(state, "identification", "--identification"):
        return reason
    if state.stop != "none":
        return "the arm is stopped"
    identification = state.identification
    busy = identification is not None and identification.phase in ("measuring", "estimating")
    return "an identification is under way" if busy else ""


def _decide_blocked(state: CellState) -> str:
    if reason := missing(state, "identification", "--identification"):
        return reason
    identification = state.identification
    proposed = identification is not None and identification.phase == "proposed"
    return "" if proposed else "no model waits for a decision"


def _upload_blocked(state: CellState) -> str:
    return missing(state, "simulation", "--simulation")


def _roll_back_blocked(state: CellState) -> str:
    if reason := _upload_blocked(state):
        return reason
    return "" if state.settings is not None and state.settings.on_trial else "no settings are on trial"


def _decision_blocked(state: CellState) -> str:
    if reason := _upload_blocked(state):
        return reason
    return "" if any(each.state == "open" for each in state.proposals) else "no proposal waits"


def _fault_blocked(state: CellState) -> str:
    return missing(state, "emulator", "")


def _settings(form: Settings, user: str, files: Files) -> UploadRequest:
    store = ModelStore(files.store)
    model, arm = (None if name is None else store.load(name).arm for name in (form.model, form.arm))
    unopposed = None if model is None else model.with_values({f"mu{joint}": 0.0 for joint in (1, 2, 3)})
    return UploadRequest(
        user,
        form.why,
        form.based_on,
        form.gains,
        form.target_time,
        unopposed,
        form.version,
        arm or model,
        form.payload,
    )


def _acceptance(form: Decision, user: str, files: Files) -> IdentificationDecision:
    return IdentificationDecision(True, form.name, form.upload, form.anyway)


COMMANDS: Final = {
    command.name: command
    for command in (
        ConsoleCommand(
            "stop",
            "operator",
            Reasoned,
            STOP,
            lambda form, user, files: StopRequest(user, form.why),
            _never_blocked,
            always=True,
        ),
        ConsoleCommand(
            "release",
            "operator",
            Reasoned,
            RELEASE,
            lambda form, user, files: ReleaseRequest(user, form.why),
            _release_blocked,
        ),
        ConsoleCommand(
            "learn",
            "operator",
            Parameter,
            ACKNOWLEDGE,
            lambda form, user, files: AcknowledgeRequest(form.parameter),
            _learn_blocked,
        ),
        ConsoleCommand(
            "watch",
            "operator",
            Form,
            WATCH,
            lambda form, user, files: WatchRequest(user, True),
            _start_blocked,
        ),
        ConsoleCommand(
            "leave",
            "engineer",
            Form,
            WATCH,
            lambda form, user, files: WatchRequest(user, False),
            _leave_blocked,
        ),
        ConsoleCommand(
            "identify",
            "operator",
            Start,
            IDENTIFY,
            lambda form, user, files: IdentificationRequest(
                form.free, form.box_mass, form.source, form.since, form.anew
            ),
            _identify_blocked,
        ),
        ConsoleCommand("accept", "engineer", Decision, DECIDE, _acceptance, _decide_blocked),
        ConsoleCommand(
            "reject",
            "operator",
            Form,
            DECIDE,
            lambda form, user, files: IdentificationDecision(False),
            _decide_blocked,
        ),
        ConsoleCommand("upload", "engineer", Settings, UPLOAD, _settings, _upload_blocked),
        ConsoleCommand(
            "rollback",
            "operator",
            Reasoned,
            ROLL_BACK,
            lambda form, user, files: RollBackRequest(user, form.why),
            _roll_back_blocked,
        ),
        ConsoleCommand(
            "approve",
            "engineer",
            Seen,
            DECIDE_PROPOSAL,
            lambda form, user, files: ProposalDecision(form.number, form.digest, user, "approve"),
            _decision_blocked,
        ),
        ConsoleCommand(
            "decline",
            "operator",
            Seen,
            DECIDE_PROPOSAL,
            lambda form, user, files: ProposalDecision(form.number, form.digest, user, "decline", form.why),
            _decision_blocked,
        ),
        ConsoleCommand(
            "fault",
            "engineer",
            Injection,
            FAULT,
            lambda form, user, files: FaultRequest((form.fault,)),
            _fault_blocked,
        ),
    )
}
"""All commands by name."""
