"""The twin of the line as a process: it sees what zones tell, shares the work out, and answers people."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Final

from dtwin.bus.line.messages import LineState
from dtwin.bus.line.plant import FlowAnswer, FlowQuestion, PlantState, PlantWord, SetUpFlow, ZoneState
from dtwin.bus.line.topics import ZONE_FLOW, ZONE_STATE
from dtwin.bus.session import Bus
from dtwin.bus.topics.topic import CHECKED
from dtwin.errors import CommunicationError, ParameterError, UnansweredError, choices
from dtwin.line.line import Assignment, Line
from dtwin.line.live.between import Between
from dtwin.line.live.distant import Decisions, DistantPlant
from dtwin.line.live.heard import believed, check_answer, check_zone_state
from dtwin.line.live.seen import line_state
from dtwin.line.live.serving import Answers
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Absence, Decision, Mode
from dtwin.line.twins.overall import Choice
from dtwin.line.twins.reorganisation import Doors, Reorganisation
from dtwin.line_file import LineFile
from dtwin.simulation.proposals.book import Book

log = logging.getLogger(__name__)

HEARD: Final = 10.0
"""Time without a word after which a zone counts as absent, s; its twin is busy for some when it looks back."""
_ANSWER: Final = 20.0
"""Longest wait for what a zone lets through, s."""
_RETRY: Final = 1.0
"""Time after which it is tried again to do what could not be done, s."""
_LOOK: Final = 0.1
"""Time from one look at what has come to the next, s."""


class DistantZone:
    """The twin of a zone in another process.

    While it does not answer, what the zone does stays as it is.

    Args:
        line: the line.
        number: number of the zone, from 0.
        bus: session of the line.
        clock: gives a time that only grows, s.

    Attributes:
        state: what it has told last.
        plant: what the plant has told last.
    """

    def __init__(self, line: Line, number: int, bus: Bus, clock: Callable[[], float]) -> None:
        zone = line.zones[number]
        self.state: ZoneState | None = None
        self.plant: PlantState | None = None
        self._name, self._stations = zone.name, tuple(station.name for station in zone.stations)
        self._places = tuple(dict.fromkeys(operation.place for operation in line.operations))
        self._line, self._zone = line, zone
        self._bus, self._clock = bus.beside(zone.name), clock
        self._heard = clock()
        self._rates: dict[tuple[tuple[str, str], ...], float] = {}
        self._bests: dict[tuple[tuple[str, str], ...], float] = {}
        self._bus.subscribe(ZONE_STATE, ZoneState, believed(partial(check_zone_state, zone), self._hold))

    @property
    def name(self) -> str:
        """Its name."""
        return self._name

    @property
    def stations(self) -> tuple[str, ...]:
        """Names of its stations."""
        return self._stations

    @property
    def present(self) -> bool:
        """Whether it has told something lately."""
        return self.state is not None and not self.missed

    @property
    def missed(self) -> bool:
        """Whether it has told nothing for long."""
        return self._clock() - self._heard >= HEARD

    def capability(self, station: str) -> Capability:
        """What the arm of a station can do: as its twin says; while that is absent, nothing if it is stopped."""
        told = () if self.state is None else self.state.stations
        found = next((each for each in told if each.name == station), None)
        if found is not None and (self.present or found.ability != "all"):
            return Capability.heard(found)
        readings = () if self.plant is None else self.plant.stations
        stopped = next((each for each in readings if each.name == station and each.stop), None)
        if stopped is not None:
            return Capability("nothing", (), stopped.why or "the blocks have stopped the arm; why is not known yet")
        return Capability("all", self._places, "its twin does not answer")

    def flows(self, question: FlowQuestion) -> Sequence[SetUpFlow]:
        """The ways to do some operations that let most boxes through, the best first; none if its stations cannot do
        them."""
        try:
            flows = self._ask(question)
        except CommunicationError as error:
            log.warning("zone %s stays as it is: %s", self._name, error)
            now = question.set_up
            jobs = [job.name for job in self._line.jobs if job.operation in question.operations]
            share = {name: now[name] for name in jobs if now[name] in self._stations}
            able = all(self.capability(at).ability != "nothing" for at in share.values())
            known = self._bests.get(_key(share), 3600.0)
            return [SetUpFlow(share, known)] if able and len(share) == len(jobs) else []
        self._bests |= {_key(flow.set_up): flow.rate for flow in flows}
        return flows

    def rate(self, assignment: Assignment) -> float:
        """Boxes an hour that leave the zone when there are always more, and room for them; 0 if nobody knows."""
        key = _key(assignment)
        if key not in self._rates:
            try:
                self._rates[key] = sum(flow.rate for flow in self._ask(FlowQuestion((), dict(assignment))))
            except CommunicationError as error:
                log.warning("zone %s: %s", self._name, error)
                return 0.0
        return self._rates[key]

    def _ask(self, question: FlowQuestion) -> Sequence[SetUpFlow]:
        if not self.present:
            raise UnansweredError(f"the twin of zone {self._name} does not answer")
        answer = self._bus.ask(ZONE_FLOW, question, FlowAnswer, _ANSWER)
        believed(partial(check_answer, self._line, self._zone, question), lambda good: None)(answer)
        return answer.flows

    def _hold(self, state: ZoneState) -> None:
        if self.state is not None and self.state.stations != state.stations:
            self._rates.clear()  # what an arm can do has changed, and so may what the zone lets through
        self.state, self._heard = state, self._clock()


class LiveOverall:
    """The twin of a line that runs elsewhere.

    Args:
        line: the line.
        mode: what the twins may do.
        bus: session of the line.
        book: book of the proposals.
        history: file to which every decision is appended.
        clock: gives a time that only grows, s.
    """

    def __init__(
        self, line: Line, mode: Mode, bus: Bus, book: Book, history: LineFile[Decision], clock: Callable[[], float]
    ) -> None:
        self._line, self._mode = line, mode
        self._decisions = Decisions(history)
        self._between = Between(clock, CHECKED)
        self._clock, self._tried = clock, -_RETRY
        self._zones = [DistantZone(line, number, bus, clock) for number in range(len(line.zones))]
        self._able: dict[str, Capability] = {}
        self._absence = Absence(self._decisions.note)
        self._lost: set[str] = set()
        doors = Doors(self._tell, self._now, self._decisions.note, self._propose)
        self.work = Reorganisation(line, mode, self._zones, doors)
        # It is told while this thread reckons; a set-up that is told a moment before its version can only be refused.
        self._answers = Answers(line, self, book, bus, self._between, self.state)
        self._plant = DistantPlant(line, bus, self._pass_on)

    @property
    def time(self) -> float:
        """Plant time of the last state of the plant, s."""
        return 0.0 if self._plant.state is None else self._plant.state.time

    @property
    def present(self) -> bool:
        """Whether the plant and all zones have told something."""
        return self._plant.state is not None and all(zone.present for zone in self._zones)

    def resume(self) -> None:
        """Takes up what an earlier process has written about the same run, which the zones still tell."""
        self._decisions.resume()

    def prepare(self) -> None:
        """Lets the zones find out, at the same time, what every way to share the work out brings."""
        with ThreadPoolExecutor(len(self._zones)) as pool:
            list(pool.map(self._prepare_zone, self._zones))

    def _prepare_zone(self, zone: DistantZone) -> None:
        names = [operation.name for operation in self._line.operations]
        for first in range(len(names)):
            for last in range(first + 1, len(names) + 1):
                if zone.present:
                    zone.flows(FlowQuestion(tuple(names[first:last]), dict(self.work.assignment)))

    def look(self) -> None:
        """Does for a moment what is asked, and answers what has come."""
        self._between.serve(_LOOK)
        plant = self._plant.state
        if plant is None:
            return
        if plant.version != self.work.version:
            self.work.adopt(plant.set_up, plant.version)
        self._absence.look(plant.absent, plant.time)
        for zone in self._zones:
            self._look_at(zone)
        in_force = {each.name: each.settings for each in plant.stations}
        self._answers.look_at_settings(self._mode, self._capability, in_force.__getitem__)
        if self._clock() - self._tried >= _RETRY:
            self._tried = self._clock()
            self.work.retry()

    def _look_at(self, zone: DistantZone) -> None:
        """What has been decided in a zone, what its arms can do otherwise than before, and whether it answers."""
        for each in () if zone.state is None else zone.state.decisions:
            self._decisions.hear(each)
        if zone.missed and zone.name not in self._lost:
            self._lost.add(zone.name)
            why = f"the twin of zone {zone.name} does not answer: what the zone does stays as it is"
            self._decisions.note(Decision(self.time, "overall twin", "no answer", why))
        elif zone.present and zone.name in self._lost:
            self._lost.remove(zone.name)
            self._decisions.note(
                Decision(self.time, "overall twin", "answers again", f"the twin of zone {zone.name} answers")
            )
            self.work.reconsider(f"the twin of zone {zone.name} answers again", "")
        for station in zone.stations:
            able, before = zone.capability(station), self._able.get(station)
            self._able[station] = able
            if able.ability == "all" if before is None else _same(able, before):
                continue
            if able.ability == "all":
                self.work.reconsider(f"{station} is repaired", station, self._line.assignment)
            else:
                self.work.reconsider(f"{station} can do {able.ability}", station)

    def state(self) -> LineState:
        """How it does.

        Raises:
            CommunicationError: the plant has told nothing yet.
        """
        plant = self._plant.state
        if plant is None:
            raise CommunicationError("the plant of the line has told nothing yet; try again")
        return line_state(self._line, self._mode, plant, self.work, self._capability, self._decisions.entries)

    def stop(self, station: str, who: str, why: str) -> None:
        """Stops the arm of a station, which keeps its box; what follows the twin of its zone says.

        Raises:
            ParameterError: there is no such station.
            CommunicationError: the plant does not answer.
        """
        self._plant.word(PlantWord(self._checked(station), "failed", f"it was stopped by {who}: {why}"[:1000]))
        self._decisions.note(Decision(self.time, who, "stop", why, station))

    def settle(self, station: str, who: str, why: str) -> None:
        """Has an arm work with the settings that its twin has found, and releases it with them if it is stopped.

        Raises:
            ParameterError: there is no such station, or its twin has found none.
            CommunicationError: the plant does not answer.
        """
        able = self._capability(self._checked(station))
        found = able.once_released or able
        if found.settings is None:
            raise ParameterError(f"station {station}: expected one whose twin has found other settings: {found.why}")
        said = f"asked for by {who}: {why}"[:1000]
        self._plant.word(PlantWord(station, "settings" if found is able else "release", said, found.settings))
        self._decisions.note(Decision(self.time, who, "settings", why, station))

    def release(self, station: str, who: str, why: str) -> None:
        """Lets a stopped arm move again, as one that is repaired.

        Raises:
            ParameterError: there is no such station, or its arm is not stopped.
            CommunicationError: the plant does not answer.
        """
        self._plant.word(PlantWord(self._checked(station), "release", f"released by {who}: {why}"[:1000]))
        self._decisions.note(Decision(self.time, who, "repair", why, station))

    def _capability(self, station: str) -> Capability:
        return self._zones[self._line.zone_of(station)].capability(station)

    def _checked(self, station: str) -> str:
        names = [each.name for each in self._line.stations]
        if station not in names:
            raise ParameterError(f"station: expected {choices(names)}, got {station!r}")
        return station

    def _tell(self, assignment: Assignment) -> bool:
        return self._plant.set_up(self.work.version, assignment)

    def _now(self) -> float:
        return self.time

    def _pass_on(self, state: PlantState) -> None:
        for zone in self._zones:
            zone.plant = state

    def _propose(self, choice: Choice, why: str) -> None:
        self._answers.lay(choice, why)


def _same(able: Capability, before: Capability) -> bool:
    """Whether an arm can do the same as before; one that works more slowly may do so at another speed."""
    slow = "slower" in (able.ability, before.ability)
    held = able.places == before.places and able.lighter == before.lighter
    return held and (not slow or (able.ability, able.why) == (before.ability, before.why))


def _key(assignment: Assignment) -> tuple[tuple[str, str], ...]:
    return tuple(sorted(assignment.items()))
