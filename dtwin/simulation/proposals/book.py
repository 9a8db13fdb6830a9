"""The book of proposals: each is checked when it is made, and approved by a person at most once, in time, as seen.

An approval moves nothing. Whoever approves has it carried out with the rights of this person, through the same doors.
"""

from __future__ import annotations

import hashlib
import itertools
from collections import deque
from pathlib import Path
from typing import Final

import msgspec

from dtwin.bus.codec import encode
from dtwin.bus.line.messages import FlowEffect
from dtwin.bus.proposals.messages import SHOWN, Effect, Proposal, ProposalDecision, ProposalRequest, ProposalState
from dtwin.errors import ParameterError
from dtwin.line_file import LineFile

HOLDS: Final = 600.0
"""Plant time for which a proposal can be approved, s."""
MOST_OPEN: Final = 8
"""Number of proposals that may wait for a person at a time."""
MOST_CHECKED: Final = 12
"""Number of proposals that are checked within CHECKED_IN, also when they are refused then: each takes the twin."""
CHECKED_IN: Final = 30.0
"""Plant time, s."""
RECOVERY: Final = "recovery"
"""Name under which the recovery service proposes."""
TWIN: Final = "overall-twin"
"""Name under which the twins of a line propose."""
OWN: Final = (RECOVERY, TWIN)
"""Names under which nobody else proposes."""
SPARED: Final = 2
"""Number of both that all others leave to these, so that no proposals keep them from answering a finding."""
LONGEST: Final = 4500
"""Greatest size of what is proposed, bytes of its message."""
TOLD: Final = 60_000
"""Greatest size of the proposals that are told at once, bytes: they go into one message with the settings."""


class Book:
    """Keeps proposals in a file that only grows; its last line about a number counts.

    Args:
        path: path of the file, which is made with the first proposal.

    Raises:
        RecordingError: the file cannot be read, or a line is not as it was written.
    """

    def __init__(self, path: Path) -> None:
        self._file = LineFile(path, Proposal, "a proposal", marked=True)
        self._kept = {entry.number: entry for entry in self._file.entries()}
        self._checked: deque[float] = deque(maxlen=MOST_CHECKED)

    def newest(self, time: float, version: int) -> tuple[Proposal, ...]:
        """All proposals that wait and the newest others that one message has room for, oldest first.

        Those that can be approved no more at a plant time (s) are expired.

        Args:
            time: plant time, s.
            version: version of the settings in force.
        """
        self._expire(time, version)
        order = sorted(self._kept.values(), key=lambda each: (each.state == "open", each.number), reverse=True)
        sizes = itertools.accumulate(len(encode(each)) for each in order[:SHOWN])
        told = [each for each, size in zip(order, sizes, strict=False) if size <= TOLD]
        return tuple(sorted(told, key=lambda each: each.number))

    def make_room(self, time: float, version: int, who: str) -> None:
        """Counts a proposal of somebody that is going to be checked, so that nobody keeps the twin busy.

        Args:
            time: plant time, s.
            version: version of the settings in force.
            who: name of who proposes.

        Raises:
            ParameterError: too many wait already, or were checked just now.
        """
        self._expire(time, version)
        spared = 0 if who in OWN else SPARED
        most = MOST_OPEN - spared
        if sum(each.state == "open" for each in self._kept.values()) >= most:
            raise ParameterError(f"{most} proposals wait for a person already: expected none more until one does")
        most = MOST_CHECKED - spared
        recent = [each for each in self._checked if time - CHECKED_IN < each <= time]
        if len(recent) >= most:
            raise ParameterError(
                f"proposals: expected at most {most} within {CHECKED_IN:g} s, those that were refused among"
                f" them; wait until {recent[-most] + CHECKED_IN:.1f} s"
            )
        self._checked.append(time)

    def add(self, request: ProposalRequest, effect: Effect | FlowEffect | None, time: float) -> Proposal:
        """Keeps a proposal that has passed its checks, for which `make_room` found room.

        Raises:
            RecordingError: it cannot be written down; then it is none.
        """
        number = max(self._kept, default=0) + 1
        made = Proposal(number, digest(number, time, request), time, request)
        name = "flow" if isinstance(effect, FlowEffect) else "effect"
        return self._keep(msgspec.structs.replace(made, **{name: effect}))

    def decide(self, decision: ProposalDecision, time: float, version: int) -> Proposal:
        """Notes what a person has decided, or what came of it.

        Args:
            decision: what is decided.
            time: plant time, s.
            version: version of the settings in force.

        Raises:
            ParameterError: there is no such proposal, it is another one than the person has seen, it was decided
                already, it is too old, or it stands on settings that are no longer in force.
            RecordingError: it cannot be written down; then it is not decided.
        """
        self._expire(time, version)
        found = self._kept.get(decision.number)
        if found is None:
            raise ParameterError(f"proposal {decision.number}: there is none of this number")
        if found.digest != decision.digest:
            raise ParameterError(f"proposal {found.number}: it is another one than was seen: expected its digest")
        if decision.action == "report":
            if found.state != "approved" or found.by != decision.who or found.outcome:
                raise ParameterError(f"proposal {found.number}: expected a report of who approved it, once")
            return self._keep(msgspec.structs.replace(found, outcome=decision.text or "done"))
        if found.state != "open":
            by = f" by {found.by}" if found.by else f": {found.outcome}"
            raise ParameterError(f"proposal {found.number}: it is {found.state} already{by}")
        state: ProposalState = "approved" if decision.action == "approve" else "declined"
        outcome = decision.text if state == "declined" else ""
        return self._keep(msgspec.structs.replace(found, state=state, by=decision.who, outcome=outcome))

    def withdraw(self, station: str, why: str) -> None:
        """Ends the open proposals of settings for the arm of a station, because something else is known of it."""
        for each in [each for each in self._kept.values() if each.state == "open"]:
            if each.request.settle is not None and each.request.settle.station == station:
                self._keep(msgspec.structs.replace(each, state="expired", outcome=why))

    def _expire(self, time: float, version: int) -> None:
        """Ends the open proposals that are too old, of another run, or on settings that are no longer in force."""
        for each in [each for each in self._kept.values() if each.state == "open"]:
            if why := _over(each, time, version):
                self._keep(msgspec.structs.replace(each, state="expired", outcome=why))

    def _keep(self, proposal: Proposal) -> Proposal:
        self._file.append(proposal)
        self._kept[proposal.number] = proposal
        return proposal


def digest(number: int, time: float, request: ProposalRequest) -> str:
    """What a person has seen of a proposal, as 32 hexadecimal digits."""
    told = f"{number} {time!r} ".encode() + encode(request)
    return hashlib.blake2b(told, digest_size=16).hexdigest()


def check_form(request: ProposalRequest) -> None:
    """Checks that a request proposes one thing in not too many words.

    Raises:
        ParameterError: it does not; the message says what is missing or too much.
    """
    kind, size = request.kind, len(encode(request))
    if size > LONGEST:
        raise ParameterError(f"proposal: expected at most {LONGEST} bytes, got {size}: use fewer words")
    if (request.set_up is not None) != (kind == "set-up"):
        raise ParameterError(f"set_up: expected one for a set-up alone, proposed is {kind}")
    if (request.settle is not None) != (kind == "settle"):
        raise ParameterError(f"settle: expected settings of a station for settle alone, proposed is {kind}")
    if (request.change is not None) != (kind == "settings"):
        raise ParameterError(f"change: expected one for settings alone, proposed is {kind}")
    if bool(request.parameters) != (kind in ("answer", "acknowledge")):
        raise ParameterError(f"parameters: expected findings for answer and acknowledge alone, proposed is {kind}")
    if bool(request.text) != (kind == "diagnosis"):
        raise ParameterError(f"text: expected words for a diagnosis alone, proposed is {kind}")


def _over(proposal: Proposal, time: float, version: int) -> str:
    """Why a proposal can be approved no more at a plant time (s), "" if it can."""
    if time < proposal.time:
        return "it is of an earlier run"
    if time > proposal.time + HOLDS:
        return f"nobody approved it within {HOLDS:g} s"
    change = proposal.request.change
    if change is not None and change.based_on != version:
        return f"it stands on version {change.based_on} of the settings, in force is {version}"
    set_up = proposal.request.set_up
    if set_up is not None and set_up.based_on != version:
        return f"it stands on version {set_up.based_on} of the set-up, in force is {version}"
    return ""
