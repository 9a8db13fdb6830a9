"""What an AI can call at a production line."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from dtwin.ai.marking import marked
from dtwin.ai.profiles import Allowance, Doors
from dtwin.ai.tools.arguments import Why
from dtwin.ai.tools.look import passages
from dtwin.bus.line.messages import (
    FlowEffect,
    LineState,
    SetUpDone,
    SetUpQuestion,
    SetUpRequest,
    StationWord,
)
from dtwin.bus.line.topics import LINE_LOOK, LINE_PREDICT, LINE_PROPOSE, LINE_STATE, LINE_STOP, SET_UP
from dtwin.bus.proposals.messages import LineLook, Proposal, ProposalRequest

_NAME = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,31}$"
OneName = Annotated[str, Field(pattern=_NAME)]
SetUp = Annotated[
    dict[OneName, OneName],
    Field(
        min_length=1,
        max_length=8,
        description="Station of each operation that another one shall do, such as {'mark': 'a1'}; see `status`",
    ),
]
StationName = Annotated[OneName, Field(description="Name of a station; see `stations`")]
Seen = Annotated[int, Field(ge=0, description="Version of the set-up that you have seen; see `status`")]
Diagnosis = Annotated[str, Field(min_length=3, max_length=1000, description="What you think is wrong")]


@dataclass(frozen=True)
class AtLine:
    """Where an AI stands at a line.

    Attributes:
        doors: the queries that its profile may ask.
        who: its name.
        pages: folder of the documentation.
        allowance: how much and how often it may change, for the profile that acts.
    """

    doors: Doors
    who: str
    pages: Path
    allowance: Allowance

    def _state(self) -> LineState:
        return self.doors.ask(LINE_STATE, None, LineState)

    def status(self) -> dict[str, Any]:
        """How the line does: boxes, rate (boxes/h), which station does which operation, and the set-up's version."""
        told: dict[str, Any] = marked(self._state())
        return {name: value for name, value in told.items() if name not in ("stations", "vehicles", "decisions")}

    def stations(self) -> dict[str, Any]:
        """The stations: what each does, its box, what it was built for, and what its arm can still do, with why."""
        return {"stations": marked(list(self._state().stations))}

    def vehicles(self) -> dict[str, Any]:
        """The vehicles: what each does, where it is (m), its charge (percent) and its box."""
        return {"vehicles": marked(list(self._state().vehicles))}

    def decisions(self) -> dict[str, Any]:
        """What was found out and decided lately, oldest first: findings, stops, set-ups and repairs, who and why."""
        return {"decisions": marked(list(self._state().decisions))}

    def proposals(self) -> dict[str, Any]:
        """The newest proposals, what they would change, and what a person has decided about them."""
        return {"proposals": [marked(each) for each in self.doors.ask(LINE_LOOK, None, LineLook).proposals]}

    def documentation(
        self, words: Annotated[str, Field(min_length=2, max_length=100, description="Words to look for")]
    ) -> dict[str, Any]:
        """Passages of the project's own documentation with the most of some words."""
        return passages(self.pages, words)

    def what_if(self, set_up: SetUp) -> dict[str, Any]:
        """What the twins expect of another set-up: boxes/h of the line and of each zone, beside those in force.

        It is an error when a station cannot do it: as it was built, or as its twin says that its arm is now.
        """
        return _effect(self.doors.ask(LINE_PREDICT, SetUpQuestion(set_up), FlowEffect))

    def best_set_up(self) -> dict[str, Any]:
        """The set-up with which the twins expect most boxes/h of the stations as they are now."""
        return _effect(self.doors.ask(LINE_PREDICT, SetUpQuestion(), FlowEffect))

    def propose_set_up(self, why: Why, based_on: Seen, set_up: SetUp) -> dict[str, Any]:
        """Proposes that other stations do some operations. The twins check it; the answer has what they expect."""
        asked = SetUpRequest(self.who, why, based_on, set_up)
        return self._made(ProposalRequest(self.who, why, "set-up", set_up=asked))

    def propose_diagnosis(self, why: Why, text: Diagnosis) -> dict[str, Any]:
        """Lays a diagnosis in words before a person, who may agree with it; nothing is changed by that."""
        return self._made(ProposalRequest(self.who, why, "diagnosis", text=text))

    def _made(self, request: ProposalRequest) -> dict[str, Any]:
        made = self.doors.ask(LINE_PROPOSE, request, Proposal)
        return {"number": made.number, "state": made.state, "flow": marked(made.flow)}

    def set_up(self, why: Why, based_on: Seen, set_up: SetUp) -> dict[str, Any]:
        """Has other stations do some operations, if the twins and the zones' blocks let it pass, within limits."""
        expected = self.doors.ask(LINE_PREDICT, SetUpQuestion(set_up), FlowEffect)
        self.allowance.check_loss("boxes/h", expected.rate_now, expected.rate)
        self.allowance.count()
        done = self.doors.ask(SET_UP, SetUpRequest(self.who, why, based_on, set_up), SetUpDone)
        return {"version": done.version, "effect": _effect(done.effect)}

    def stop(self, why: Why, station: StationName) -> dict[str, Any]:
        """Stops the arm of a station, which keeps its box. Always allowed, counted by no limit; people release it."""
        state = self.doors.ask(LINE_STOP, StationWord(self.who, why, station), LineState)
        return {"stations": [marked(each) for each in state.stations if each.name == station]}


def _effect(effect: FlowEffect) -> dict[str, Any]:
    told: dict[str, Any] = marked(effect)
    return told
