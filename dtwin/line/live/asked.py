"""What the twin of a zone asks of the plant: what the line is now, and what its arms shall do."""

from __future__ import annotations

import logging
from threading import Lock
from typing import Final

from dtwin.bus.line.plant import PlantState, PlantWord, StationReading
from dtwin.bus.line.situation import PlantSituation
from dtwin.bus.line.topics import PLANT_NOW, PLANT_WORD
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError, ParameterError
from dtwin.line.control import OneResource
from dtwin.line.line import Line
from dtwin.line.live.heard import check_situation
from dtwin.line.situation import Situation
from dtwin.parameters import PERIOD
from iec61499.errors import FunctionBlockError

log = logging.getLogger(__name__)

_LATELY: Final = 1.0
"""Plant time for which a situation is still the one of now, s."""


def is_past(word: PlantWord, released: float) -> bool:
    """Whether a word is about an arm as it was before somebody released it at a plant time (s; 0 for never)."""
    return word.seen is not None and released > 0.0 and word.seen < released + 0.5 * PERIOD


class Recollection:
    """What the plant tells that the line is.

    Args:
        line: the line.
        bus: session of the zone.
    """

    def __init__(self, line: Line, bus: Bus) -> None:
        self._line, self._bus = line, bus
        self._blocks: OneResource | None = None
        self._known: Situation | None = None
        self._recalling = Lock()

    def at(self, time: float) -> Situation | None:
        """The situation at a plant time (s), of a second before at most; None where the plant cannot tell.

        Several questions may be answered at once, each on a thread of its own.
        """
        with self._recalling:
            if self._known is None or not 0.0 <= time - self._known.plant.time < _LATELY:
                self._known = self._told()
            return self._known

    def _told(self) -> Situation | None:
        try:
            told = self._bus.ask(PLANT_NOW, None, PlantSituation)
            check_situation(self._line, told)
            self._blocks = self._blocks or OneResource(self._line)
            return Situation(told.plant, told.set_ups, told.done_by, self._blocks.recall(told.blocks))
        except (CommunicationError, ParameterError, FunctionBlockError) as error:
            log.info("simulated from an empty zone on: %s", error)
            return None


class Requests:
    """What arms are asked for, which is said again with every look until the plant tells that they do it.

    Args:
        bus: session of the zone.
    """

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._open: dict[str, PlantWord] = {}
        self._changed: set[str] = set()

    def ask(self, word: PlantWord) -> None:
        """Asks for something, in the place of what was asked of the same arm before."""
        self._open[word.station] = word
        self._say(word)

    def look(self, reading: StationReading) -> bool:
        """Looks whether an arm does what it was asked for; whether it is as it was made to be again.

        What was asked before somebody has released the arm is asked no more: it would undo what a person has decided.
        """
        name, stop, settings = reading.name, reading.stop, reading.settings
        word = self._open.get(name)
        if stop or settings is not None or word is not None:
            self._changed.add(name)
        if word is not None:
            done = stop or (word.word == "settings" and word.settings == settings)
            if not done and not is_past(word, reading.released):
                self._say(word)
                return False
            del self._open[name]
        if name in self._changed and not stop and settings is None:
            self._changed.remove(name)
            return True
        return False

    def _say(self, word: PlantWord) -> None:
        try:
            self._bus.ask(PLANT_WORD, word, PlantState)
        except CommunicationError as error:
            log.error("%s: %s is not heard: %s", word.station, word.word, error)
