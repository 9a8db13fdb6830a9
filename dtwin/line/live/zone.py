"""The twin of a zone as a process: it watches its arms over the bus, tells what they can do, and what passes.

When the twin of the line does not answer, it shares the work of its zone out among its own stations by itself.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any, Final

from dtwin.bus.line.messages import TOLD
from dtwin.bus.line.plant import (
    FlowAnswer,
    FlowQuestion,
    PlantSetUp,
    PlantState,
    PlantWord,
    Settings,
    SetUpFlow,
    StationReading,
    ZoneState,
)
from dtwin.bus.line.topics import PLANT_SET_UP, PLANT_STATE, ZONE_FLOW, ZONE_STATE
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.line.chain.cell import arm_cell, believed_chain_settings
from dtwin.line.line import Line, Load, StationPlan
from dtwin.line.live.arms import ArmFollower
from dtwin.line.live.asked import Recollection, Requests
from dtwin.line.live.chain import ChainArmFollower
from dtwin.line.live.heard import believed, check_plant_state, check_question
from dtwin.line.live.seen import told
from dtwin.line.station import FREE
from dtwin.line.twins.decisions import OPERATOR, REPAIRED, Decision, Mode
from dtwin.line.twins.guard import Guard, Hands, StopState
from dtwin.line.twins.node import BEFORE
from dtwin.line.twins.nodes import node_of
from dtwin.line.twins.zone import ZoneTwin
from dtwin.parameters import PERIOD

log = logging.getLogger(__name__)

OVERALL: Final = "overall"
"""Name of the service that is the twin of the line."""
_LOOK: Final = 1.0
"""Plant time from one look at the arms to the next, s."""


def _follower(
    arm: Bus, station: StationPlan, put: Callable[[tuple[Any, Any]], None]
) -> ArmFollower | ChainArmFollower:
    """What hears what the arm of a station does, to be put where `LiveZone.take` is called with it."""
    cell = arm_cell(station)
    if cell is None:
        return ArmFollower(arm, lambda follower, came: put((follower, came)))
    return ChainArmFollower(arm, believed_chain_settings(station, cell), lambda follower, came: put((follower, came)))


class LiveZone:
    """The twin of a zone that watches a running line.

    Args:
        line: the line.
        number: number of the zone, from 0.
        mode: what the twins may do.
        bus: session of the line.
        put: gives something that has come over the bus to the thread that calls `take`.
    """

    def __init__(self, line: Line, number: int, mode: Mode, bus: Bus, put: Callable[[Any], None]) -> None:
        self._line, self._mode = line, mode
        zone = line.zones[number]
        nodes = {s.name: node_of(line, s) for s in zone.stations}
        own = self._own = bus.beside(zone.name)
        recollection = Recollection(line, own)
        self._twin = ZoneTwin(line, number, nodes, lambda: recollection.at(self.time))
        self._guard = Guard(nodes, mode, self._hands())
        self._decisions: deque[Decision] = deque(maxlen=TOLD)
        self._plant: PlantState | None = None
        self._requests = Requests(own)
        self._looked = 0.0
        self._alone = True
        self._tell = own.publisher(ZONE_STATE)
        self._arms = {station.name: _follower(bus.beside(station.name), station, put) for station in zone.stations}
        bus.subscribe(PLANT_STATE, PlantState, believed(partial(check_plant_state, line), put))
        bus.watch_alive(lambda name, alive: put(alive), OVERALL)
        own.answer(ZONE_FLOW, FlowQuestion, self._flow)

    @property
    def time(self) -> float:
        """Plant time of the last state of the plant, s."""
        return 0.0 if self._plant is None else self._plant.time

    def take(self, came: PlantState | bool | tuple[Any, Any]) -> None:
        """Takes what has come over the bus, and looks at the arms when that is due."""
        if isinstance(came, tuple):
            came[0].take(came[1])
        elif isinstance(came, bool):
            self._alone = not came
        else:
            if came.time < self.time:  # the plant has begun anew
                self._looked = 0.0
            self._plant = came
            if came.time - self._looked >= _LOOK:
                self._looked = came.time
                self._look(came)

    def tell(self) -> None:
        """Tells what the twin thinks."""
        stations = []
        for name in self._twin.stations:
            stations.append(self._twin.capability(name).told(name))
        self._tell(ZoneState(self._twin.name, self.time, tuple(stations), tuple(map(told, self._decisions))))

    def _look(self, plant: PlantState) -> None:
        if self._mode != "off":
            for reading in plant.stations:
                if reading.name in self._arms:
                    self._watch(reading)
        for arm in self._arms.values():
            arm.forget(2 * BEFORE * PERIOD)
        self.tell()

    def _watch(self, reading: StationReading) -> None:
        """Looks at what an arm has done, and what follows from it."""
        name, stop, settings = reading.name, reading.stop, reading.settings
        time, reasons = self.time, []
        if self._requests.look(reading):
            reasons.append(self._guard.repaired(name, time, OPERATOR, REPAIRED))
        if stop and reading.why:
            reasons += self._guard.known(name, reading.why)
        reasons += self._guard.look(name, self._arms[name].log, reading.arm, stop, time, settings)
        for because in reasons:
            self.tell()
            if self._alone and self._mode == "act":
                self._reorganise(because, name)

    def _reorganise(self, because: str, station: str) -> None:
        """Shares the operations of this zone out anew, because nobody else does."""
        if self._plant is None:
            return
        in_force = dict(self._plant.set_up)
        own = {name for name, at in in_force.items() if at in self._twin.stations}
        share = tuple(dict.fromkeys(job.operation for job in self._line.jobs if job.name in own))
        flows = self._twin.flows(FlowQuestion(share, in_force))
        if not flows:
            why = f"{because}: no station of the zone can do all that is left"
            self._note(Decision(self.time, f"twin of {self._twin.name}", "none possible", why, station))
            return
        best, rate = flows[0].set_up, flows[0].rate
        if all(in_force[name] == at for name, at in best.items()):
            return
        moved = ", ".join(f"{n} from {in_force[n]} to {at}" for n, at in best.items() if in_force[n] != at)
        whole = {**in_force, **best}
        try:
            self._own.ask(PLANT_SET_UP, PlantSetUp(self._plant.version, whole), PlantState)
        except CommunicationError as error:
            log.warning("%s: %s", because, error)
            return
        why = f"{because}, and the twin of the line does not answer: {moved}"
        self._note(Decision(self.time, f"twin of {self._twin.name}", "set-up", why, station, whole, rate))
        self.tell()

    def _stop(self, station: str, state: StopState, why: str) -> None:
        """Has an arm stopped; that is said again with every look until the plant tells that it is."""
        self._requests.ask(PlantWord(station, state, why[:1000], seen=self.time))

    def _settle(self, station: str, settings: Settings, why: str) -> None:
        """Has an arm work with other settings; that is said again likewise."""
        self._requests.ask(PlantWord(station, "settings", why[:1000], settings, self.time))

    def _needed(self, station: str) -> frozenset[Load]:
        """What a station brings to which places now."""
        in_force = self._line.assignment if self._plant is None else self._plant.set_up
        return self._line.loads(in_force, station)

    def _works(self, station: str) -> Load | None:
        """The box that the arm of a station holds, or is offered, now."""
        readings = () if self._plant is None else self._plant.stations
        return next((each.load for each in readings if each.name == station), None)

    def _box(self, station: str) -> int:
        """Number of that box, 0 for none."""
        readings = () if self._plant is None else self._plant.stations
        found = (each.worked or each.waiting for each in readings if each.name == station and each.arm != FREE)
        return next(found, 0)

    def _hands(self) -> Hands:
        return Hands(self._stop, self._settle, self._needed, self._works, self._box, self._note)

    def _flow(self, asked: FlowQuestion) -> FlowAnswer:
        """Answers on a thread of its own: a simulation takes seconds, in which the arms are watched."""
        check_question(self._line, asked)
        share = {name: at for name, at in asked.set_up.items() if at in self._twin.stations}
        if not asked.operations:
            return FlowAnswer((SetUpFlow(share, self._twin.rate(share)),) if share else ())
        return FlowAnswer(tuple(self._twin.flows(asked)))

    def _note(self, decision: Decision) -> None:
        self._decisions.append(decision)
        log.info("%s: %s: %s", decision.who, decision.what, decision.why)
