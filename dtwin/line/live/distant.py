"""The plant of a line as the twin of the line sees it from another process, and what has been decided there."""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Final

from dtwin.bus.line.messages import LineDecision
from dtwin.bus.line.plant import PlantSetUp, PlantState, PlantWord
from dtwin.bus.line.topics import PLANT_SET_UP, PLANT_STATE, PLANT_WORD
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError, DtwinError, UnansweredError
from dtwin.line.line import Assignment, Line
from dtwin.line.live.heard import believed, check_plant_state
from dtwin.line.twins.decisions import Decision
from dtwin.line_file import LineFile

log = logging.getLogger(__name__)

_ON_ITS_WAY: Final = 2.0
"""Longest time for which a state of the plant is on its way, s; one that is older is that of a plant begun anew."""
_RESUMED: Final = 200
"""Number of decisions that a process which begins anew takes up."""
_SEEN: Final = 5.0
"""Longest time until the twin of a zone has seen that an arm was released, s."""


class DistantPlant:
    """The plant in another process.

    Args:
        line: the line.
        bus: session of the line.
        heard: is given every state that is newer than the ones before.

    Attributes:
        state: what it has told last; None before it has told anything.
    """

    def __init__(self, line: Line, bus: Bus, heard: Callable[[PlantState], None]) -> None:
        self.state: PlantState | None = None
        self._bus, self._heard = bus, heard
        self._holding = threading.Lock()
        self._hold = believed(partial(check_plant_state, line), self._take)
        bus.subscribe(PLANT_STATE, PlantState, self._hold)

    def word(self, word: PlantWord) -> None:
        """Has an arm stopped, released or given other settings. Raises CommunicationError: it does not answer."""
        self._hold(self._bus.ask(PLANT_WORD, word, PlantState))

    def set_up(self, version: int, assignment: Assignment) -> bool:
        """Has the zones set up; whether they take it. Raises UnansweredError: it does not answer."""
        try:
            self._hold(self._bus.ask(PLANT_SET_UP, PlantSetUp(version, dict(assignment)), PlantState))
        except UnansweredError:
            raise
        except CommunicationError as error:
            log.info("%s", error)
            return False
        return True

    def _take(self, state: PlantState) -> None:
        """Takes a state, unless a newer one was the answer to a question while it was on its way."""
        with self._holding:
            held = self.state
            older = held is not None and (state.time, state.version) < (held.time, held.version)
            if older and held is not None and held.time - state.time < _ON_ITS_WAY:
                return
            self.state = state
            self._heard(state)


class Decisions:
    """What has been decided about a line, kept and written down.

    Args:
        history: file to which every decision is appended.

    Attributes:
        entries: the decisions, oldest first.
    """

    def __init__(self, history: LineFile[Decision]) -> None:
        self.entries: list[Decision] = []
        self._history = history
        self._heard: set[tuple[float, str, str, str]] = set()

    def resume(self) -> None:
        """Takes up what an earlier process has written about the same run, which the zones still tell."""
        self.entries = list(deque(self._history.entries(), maxlen=_RESUMED))
        self._heard = {_name_of(decision) for decision in self.entries}

    def note(self, decision: Decision) -> None:
        """Keeps a decision; a disk that is full does not end the twin."""
        self.entries.append(decision)
        try:
            self._history.append(decision)
        except DtwinError as error:
            log.error("a decision is not in the history: %s", error)

    def hear(self, told: LineDecision) -> None:
        """Notes a decision that a zone tells of, once."""
        if (name := _name_of(told)) in self._heard:
            return
        self._heard.add(name)
        if not self._is_noted(told):
            self.note(Decision(told.time, told.who, told.what, told.why, told.station, {}, told.rate))

    def _is_noted(self, seen: LineDecision) -> bool:
        """Whether the twin of a zone has seen an arm move again that somebody has released here."""
        return seen.what == "repair" and any(
            each.what == "repair" and each.station == seen.station and 0.0 <= seen.time - each.time <= _SEEN
            for each in self.entries
        )


def _name_of(decision: Decision | LineDecision) -> tuple[float, str, str, str]:
    """By what a decision is known again."""
    return decision.time, decision.who, decision.what, decision.station
