"""What is said of proposals: an AI or recovery makes them, the simulation service keeps them, a person decides.

The rules of `dtwin.bus.messages` hold, which has their topics.
"""

from __future__ import annotations

from typing import Annotated, Final, Literal, get_args

import msgspec

from dtwin.bus.line.messages import FlowEffect, SetUpRequest
from dtwin.bus.twin_messages import Upload, UploadRequest
from dtwin.names import Name
from dtwin.parameters import CellJoints
from dtwin.signals import SCHEMA, Count, Line, Seconds, Word

Kind = Literal["settings", "answer", "acknowledge", "stop", "diagnosis", "set-up", "settle"]
"""settings: other settings of the controller; answer: what recovery does about findings; acknowledge: a finding
counts as normal; stop: a safe stop; diagnosis: words alone, for a person; set-up: which station of a line does
what; settle: the arm of a station of a line works with the settings that its twin has found."""
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)
ProposalState = Literal["open", "approved", "declined", "expired"]
"""approved: a person has taken it on, once; what came of it is told afterwards."""
SHOWN: Final = 20
"""Number of the newest proposals that are told."""
FaultName = Annotated[str, msgspec.Meta(pattern="^[A-Za-z]{1,16}[0-9]{0,2}$")]
"""What a finding names: a kind, and a joint for those that befall one."""
Names = Annotated[tuple[FaultName, ...], msgspec.Meta(max_length=8)]


class FoundSettings(msgspec.Struct, frozen=True):
    """Settings with which the arm of a station of a line can work on, as its twin has found.

    Attributes:
        station: name of the station.
        settings: what its blocks have then, in words.
        ability: what the arm can do then: all, slower, some places or lighter boxes.
        releases: whether the arm is stopped, so that it is released with them.
    """

    station: Name
    settings: Line
    ability: Word
    releases: bool = False


class ProposalRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Something that an AI or recovery would have done; nothing moves until a person approves.

    Attributes:
        who: name of the AI, or recovery.
        why: reason in its words.
        kind: what is proposed.
        change: other settings, for the kind settings alone; `based_on` is the version that the AI has seen.
        parameters: what the findings name that are answered or acknowledged.
        text: the diagnosis in words.
        set_up: other stations for operations, for the kind set-up alone; `based_on` is the version that was seen.
        settle: settings for the arm of a station, for the kind settle alone, which only the twins of a line propose.
    """

    who: Word
    why: Line
    kind: Kind
    change: UploadRequest | None = None
    parameters: Names = ()
    text: Line = ""
    set_up: SetUpRequest | None = None
    settle: FoundSettings | None = None


class Effect(msgspec.Struct, frozen=True):
    """What the twin expects of proposed settings beside those in force.

    Attributes:
        tracking: largest distance of each joint from its path over the motions of the cell, rad.
        tracking_now: the same with the settings in force; None where the twin refuses them, too.
        disk_margin: least disk margin at rest.
        disk_margin_now: the same with the settings in force, 0 where it is not known.
        peak_volts: largest voltage of each joint, V.
        difference: what changes, in words, one for each value.
    """

    tracking: CellJoints
    disk_margin: float
    peak_volts: CellJoints
    difference: tuple[Line, ...]
    tracking_now: CellJoints | None = None
    disk_margin_now: float = 0.0


class Proposal(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """A proposal as it is kept.

    Attributes:
        number: its number, from 1 on.
        digest: hash of the number, the time and the request: what a person approves is what this person has seen.
        time: plant time at which it was made, s.
        request: what is proposed.
        state: what has become of it.
        effect: what the twin expects, of proposed settings.
        by: person who has decided, "" while nobody has.
        outcome: what came of it, in words.
        flow: what the twins of a line expect, of a proposed set-up.
    """

    number: Count
    digest: Word
    time: Seconds
    request: ProposalRequest
    state: ProposalState = "open"
    effect: Effect | None = None
    by: Word = ""
    outcome: Line = ""
    flow: FlowEffect | None = None


class ProposalDecision(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What a person decides about a proposal.

    Attributes:
        number: number of the proposal.
        digest: its digest, as the person was shown it.
        who: name of the person.
        action: approve takes it on, which can be done once; decline ends it; report tells what came of it.
        text: what came of it, or why it is declined.
    """

    number: Count
    digest: Word
    who: Word
    action: Literal["approve", "decline", "report"]
    text: Line = ""


class AnswerRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Asks recovery to carry out a proposal to answer findings, which a person has approved.

    Attributes:
        number: number of the proposal.
        who: name of the person.
    """

    number: Count
    who: Word


class LookRequest(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """Asks for nothing but to see; it changes nothing."""


class Look(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What may be seen of the settings without a right to change them.

    Attributes:
        settings: settings in force.
        proposals: the newest proposals, oldest first.
    """

    settings: Upload
    proposals: Annotated[tuple[Proposal, ...], msgspec.Meta(max_length=SHOWN)] = ()


class LineLook(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What may be seen of the set-up of a line without a right to change it.

    Attributes:
        version: version of the set-up in force.
        proposals: the newest proposals, oldest first.
    """

    version: Count
    proposals: Annotated[tuple[Proposal, ...], msgspec.Meta(max_length=SHOWN)] = ()


class RecoveryLook(msgspec.Struct, frozen=True, tag_field="schema", tag=SCHEMA):
    """What recovery of an arm that is not the thesis's has proposed.

    Attributes:
        proposals: the newest proposals, oldest first.
    """

    proposals: Annotated[tuple[Proposal, ...], msgspec.Meta(max_length=SHOWN)] = ()
