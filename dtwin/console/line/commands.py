"""What can be commanded at the console of a line, and which desks that needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import msgspec

from dtwin.bus.line.messages import LineState, SetUpQuestion, SetUpRequest, SetUps, StationWord
from dtwin.bus.line.topics import LINE_DECIDE, LINE_PREDICT, LINE_RELEASE, LINE_STOP, SET_UP
from dtwin.bus.proposals.messages import ProposalDecision
from dtwin.console.commands import ConsoleCommand, Form, Seen
from dtwin.console.telling import CellState
from dtwin.errors import ParameterError, choices
from dtwin.names import Name
from dtwin.signals import Count, Line

LINE_STALE: Final = 2.0
"""Age from which on what is known of a line counts as stale, s."""
NO_DESK: Final = None
"""What needs no desk, because it changes nothing or must always be possible."""


class AtStation(Form, frozen=True):
    """A form about the arm of a station."""

    station: Name
    why: Line = "from the console"


class Question(Form, frozen=True):
    """A form that asks what a set-up would bring; empty asks for the best there is."""

    set_up: SetUps = msgspec.field(default_factory=dict)


class NewSetUp(Form, frozen=True):
    """A form that has a line set up otherwise, as in `SetUpRequest`."""

    based_on: Count
    set_up: SetUps
    why: Line = "from the console"


Zones = tuple[str, ...] | None


@dataclass(frozen=True)
class LineCommand(ConsoleCommand):
    """A command of the page of a line.

    Attributes:
        zones: the zones whose desks it needs, by its form; () for any one, NO_DESK for none. Raises ParameterError.
    """

    zones: Callable[[Any, CellState], Zones] = lambda form, state: NO_DESK


def zones_of_set_up(state: LineState, changes: Mapping[str, str]) -> tuple[str, ...]:
    """The zones that a set-up concerns: those of the stations that get operations, and that give them away.

    Raises:
        ParameterError: there is no such operation or station.
    """
    zones = {station.name: station.zone for station in state.stations}
    found = set()
    for operation, station in changes.items():
        if operation not in state.set_up:
            raise ParameterError(f"operation {operation}: expected {choices(list(state.set_up))}")
        if station not in zones:
            raise ParameterError(f"station {station}: expected {choices(list(zones))}")
        if state.set_up[operation] != station:
            found |= {zones[station], zones[state.set_up[operation]]}
    return tuple(zone for zone in dict.fromkeys(zones.values()) if zone in found)


def _told(state: CellState) -> LineState:
    if state.line is None or state.line.state is None:
        raise ParameterError("nothing is known of the line yet")
    return state.line.state


def _of_station(form: AtStation, state: CellState) -> Zones:
    zones = {station.name: station.zone for station in _told(state).stations}
    if form.station not in zones:
        raise ParameterError(f"station {form.station}: expected {choices(list(zones))}")
    return (zones[form.station],)


def _of_set_up(form: NewSetUp, state: CellState) -> Zones:
    return zones_of_set_up(_told(state), form.set_up)


def _of_proposal(form: Seen, state: CellState) -> Zones:
    for proposal in state.proposals:
        request = proposal.request
        if proposal.number == form.number and request.set_up is not None:
            return zones_of_set_up(_told(state), request.set_up.set_up)
        if proposal.number == form.number and request.settle is not None:
            return _of_station(AtStation(station=request.settle.station), state)
    return ()


def _never(state: CellState) -> str:
    return ""


def _release_blocked(state: CellState) -> str:
    stations = () if state.line is None or state.line.state is None else state.line.state.stations
    return "" if any(station.doing == "stopped" for station in stations) else "no arm is stopped"


def _decision_blocked(state: CellState) -> str:
    return "" if any(each.state == "open" for each in state.proposals) else "no proposal waits"


LINE_COMMANDS: Final[Mapping[str, ConsoleCommand]] = {
    command.name: command
    for command in (
        LineCommand(
            "stop",
            "operator",
            AtStation,
            LINE_STOP,
            lambda form, user, files: StationWord(user, form.why, form.station),
            _never,
            always=True,
        ),
        LineCommand(
            "release",
            "operator",
            AtStation,
            LINE_RELEASE,
            lambda form, user, files: StationWord(user, form.why, form.station),
            _release_blocked,
            zones=_of_station,
        ),
        LineCommand(
            "predict",
            "operator",
            Question,
            LINE_PREDICT,
            lambda form, user, files: SetUpQuestion(form.set_up),
            _never,
        ),
        LineCommand(
            "setup",
            "operator",
            NewSetUp,
            SET_UP,
            lambda form, user, files: SetUpRequest(user, form.why, form.based_on, form.set_up),
            _never,
            zones=_of_set_up,
        ),
        LineCommand(
            "approve",
            "operator",
            Seen,
            LINE_DECIDE,
            lambda form, user, files: ProposalDecision(form.number, form.digest, user, "approve"),
            _decision_blocked,
            zones=_of_proposal,
        ),
        LineCommand(
            "decline",
            "operator",
            Seen,
            LINE_DECIDE,
            lambda form, user, files: ProposalDecision(form.number, form.digest, user, "decline", form.why),
            _decision_blocked,
            zones=_of_proposal,
        ),
    )
}
"""All commands by name."""
