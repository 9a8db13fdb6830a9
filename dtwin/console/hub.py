"""Gathers what a cell says on its bus, for everybody who looks at it; one hub serves all pages."""

from __future__ import annotations

import logging
import math
import threading
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final, TypeVar

import msgspec

from dtwin.bus.following import Following, following_ticks
from dtwin.bus.messages import (
    ACTED,
    EVENTS,
    IDENTIFICATION,
    IDENTIFY,
    LOOK,
    MONITORING,
    PATH,
    RESIDUALS,
    SENSORS,
    STATUS,
    STOP,
    SUMMARY,
    TICKS,
    VOLTAGES,
    WATCH,
    Acted,
    PassedTicks,
    Path,
    Status,
    StopState,
    Summary,
)
from dtwin.bus.pairs import Pairs
from dtwin.bus.proposals.deciding import CELL, Kept
from dtwin.bus.proposals.messages import Look
from dtwin.bus.session import Bus, Subscription
from dtwin.bus.ticks import Tick
from dtwin.bus.topics.topic import Topic
from dtwin.bus.twin_messages import IdentificationState, MonitoringResiduals, MonitoringVerdict, WatchState
from dtwin.bus.verdicts.opinion import Opinion
from dtwin.console.clocks import Clocks
from dtwin.console.commands import COMMANDS, ConsoleCommand
from dtwin.console.conditions import NEWS, STALE, conditions, doing
from dtwin.console.excited import ExcitedMotion
from dtwin.console.people.occupancy import Occupancy
from dtwin.console.telling import CellState, Frame, Health, spots
from dtwin.errors import CommunicationError
from dtwin.signals import Event, Sensors, Stop, Voltages
from dtwin.task import DEFAULT_TASK, Task

log = logging.getLogger(__name__)

ASKING: Final = 1.0
"""Time between two rounds of questions while a page is open, s."""
ASKING_UNREAD: Final = 5.0
"""The same while none is, s: alarms need no more."""
PATIENCE: Final = 1.0
"""Longest wait for one answer, s."""
BEHIND: Final = 50
"""Number of samples by which the last one with a path may be older than the last one."""
SILENT: Final = 3.0
"""Time without a word of a service after which its last word does not count any more, s."""
KEPT_EVERY: Final = 0.1
"""Time between two frames that are kept for replays, s."""
FRESH: Final = 1000
"""Number of events that wait to be taken."""
EVENTS_KEPT: Final = 60
"""Number of the last events that pages are told."""
M = TypeVar("M", bound=msgspec.Struct)


class Hub:
    """The last word of everybody in a cell.

    What comes over the bus is put into attributes by Zenoh's threads; each is replaced as a whole, so a reader sees
    the old or the new one.

    Args:
        bus: session on which the hub listens and asks.
        cell: name of the cell.
        arm: name of the arm.
        clocks: clocks of the console.
        task: task of the cell, whose places are drawn.

    Attributes:
        task: task of the cell.
        excited: motion of the last identification.
        desk: who has the desk of the cell.
        keep: takes ten frames a second, on one of Zenoh's threads.
        joints: number of joints of the arm.
        commands: what can be commanded in such a cell, by name.
        kept: who keeps its proposals.
        stale: age from which on its values count as stale, s.
        patience: longest wait for one answer, s.
    """

    joints: int = 3
    commands: Mapping[str, ConsoleCommand] = COMMANDS
    kept: Kept = CELL
    stale: float = STALE
    patience: float = PATIENCE

    def __init__(self, bus: Bus, cell: str, arm: str, clocks: Clocks, task: Task = DEFAULT_TASK) -> None:
        self.task = task
        self.desk = Occupancy(bus)
        self.keep: Callable[[Frame], object] = lambda frame: None
        self._due = -math.inf
        self._bus = bus
        self._names = (cell, arm)
        self._clocks = clocks
        self.excited = ExcitedMotion()
        self._sensors: Sensors | None = None
        self._heard = (0.0, 0.0)
        self._acted: Voltages | Acted | None = None
        self._pairs: Pairs[Sensors, Path] = Pairs()
        self._pairing = threading.Lock()
        self._on_path: tuple[Sensors, Path] | None = None
        self._residuals: MonitoringResiduals | None = None
        self._opinion = Opinion()
        self._last: dict[type, Any] = {}
        self._statuses: dict[str, tuple[float, Status]] = {}
        self._here: dict[str, bool] = {}
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)
        self._fresh: deque[Event] = deque(maxlen=FRESH)
        self._stop: Stop = "none"
        self._ask_stop = self._ask_watch = True
        self._colours = ("", "")
        self._followed: list[Subscription] = []
        self._over = threading.Event()
        self._news = threading.Event()
        self._asking = threading.Thread(target=self._ask_all, name="ask", daemon=True)

    def listen(self) -> None:
        """Subscribes to all that is shown, and begins to ask for what is not published."""
        bus = self._bus
        self._listen_to_motion()
        bus.subscribe(MONITORING, MonitoringVerdict, self._take_verdict)
        bus.subscribe(IDENTIFICATION, IdentificationState, self._take_identification)
        bus.subscribe(EVENTS, Event, self._take_event)
        bus.subscribe(STATUS, Status, self._take_status)
        bus.watch_alive(self._take_token)
        self._asking.start()

    def _listen_to_motion(self) -> None:
        self._bus.subscribe(TICKS, PassedTicks, following_ticks(self._take_ticks, self._bus.refuse))
        self._bus.subscribe(RESIDUALS, MonitoringResiduals, self._take_residuals)

    def close(self) -> None:
        """Ends the questions."""
        self._over.set()
        self._news.set()
        self._asking.join()

    def follow_path(self, wanted: bool) -> None:
        """Has every sample, its command and the path sent at once or not, which costs all who send them time.

        What is not published is asked for more often meanwhile.
        """
        if wanted and not self._followed:
            self._followed = self._samples_followed()
            self._news.set()
        elif not wanted and self._followed:
            for subscription in self._followed:
                subscription.end()
            self._followed, self._on_path = [], None

    def _samples_followed(self) -> list[Subscription]:
        subscribe = self._bus.subscribe
        return [
            subscribe(PATH, Path, self._take_path),
            subscribe(VOLTAGES, Voltages, self._take_acted),
            subscribe(ACTED, Acted, self._take_acted),
            subscribe(SENSORS, Sensors, Following(self._take_sensors, self._bus.refuse)),
        ]

    def watch(self, names: frozenset[str]) -> None:
        """Listens to the arms of these stations; a cell has none."""

    def station(self, name: str) -> msgspec.Struct | None:
        """What was last heard of the arm of a station that is watched; None in a cell."""
        return None

    def ask_again(self) -> None:
        """Asks at once for what may have changed by a command."""
        self._ask_stop = self._ask_watch = True
        self._news.set()

    @property
    def age(self) -> float | None:
        """Time since the last sample arrived, s; None before the first one."""
        return None if self._sensors is None else self._clocks.steady() - self._heard[0]

    def frame(self) -> Frame:
        """The arm as it was last heard of."""
        newest, acted, residuals = self._sensors, self._acted, self._residuals
        if newest is None:
            return Frame()
        # An angle and a path of two samples would look like a distance from the path.
        sensors, path = self._on_path or (newest, None)
        heard = self._heard[1] - (newest.time - sensors.time if self._on_path else 0.0)
        watched = residuals if residuals and sensors.time - residuals.time < SILENT else None
        return Frame(
            sensors.time,
            round(max(0.0, self._clocks.steady() - self._heard[0]), 3),
            round(1e3 * heard, 1),
            sensors.theta,
            None if path is None else path.theta,
            None if acted is None else acted.volts,
            sensors.gripper,
            acted is not None and acted.box_gripped,
            sensors.box_colour if sensors.box_present else "",
            None if watched is None else watched.predicted,
            None if watched is None else watched.residual,
            None if watched is None else watched.deviation,
            None if watched is None else watched.evidence,
            None if watched is None else watched.threshold,
        )

    def state(self) -> CellState:
        """All that changes seldom."""
        services = self._services()
        summary = self._last.get(Summary) or Summary({})
        watch = self._of("monitoring", WatchState)
        unwatched = MONITORING.sender not in services or (watch is not None and not watch.running)
        verdict = None if unwatched else self._opinion.current(self._clocks.steady())
        identification = self._of("identification", IdentificationState)
        look = self._of("simulation", Look)
        settings, proposals = (None, ()) if look is None else (look.settings, look.proposals)
        states = [health.state for health in services.values()]
        held = self._colours[1] if self._acted is not None and self._acted.box_gripped else ""
        waiting = self._colours[0]
        return CellState(
            *self._names,
            doing=doing(self._stop, states, identification, held, waiting),
            stop=self._stop,
            services=services,
            ticks=summary.ticks,
            late_ticks=summary.late_ticks,
            real_time_factor=summary.real_time_factor,
            latency_ms=summary.latency_ms,
            boxes=summary.boxes,
            verdict=verdict,
            watch=watch,
            identification=identification,
            settings=settings,
            proposals=proposals,
            places=spots(self.task),
            events=tuple(self._events),
            conditions=conditions(
                services,
                self._stop,
                verdict,
                settings,
                self.age,
                watch is None or watch.running,
                sum(each.state == "open" for each in proposals),
            ),
        )

    def fresh_events(self) -> list[Event]:
        """The events since the last call, oldest first."""
        found = []
        while self._fresh:
            found.append(self._fresh.popleft())
        return found

    def is_here(self, service: str) -> bool:
        """Whether the token of a service is there."""
        return self._here.get(service, False)

    def _of(self, service: str, message: type[M]) -> M | None:
        """The last message of a service, as long as the service is there."""
        found: M | None = self._last.get(message) if self.is_here(service) else None
        return found

    def _services(self) -> dict[str, Health]:
        now = self._clocks.steady()
        found = {}
        summary: Summary | None = self._last.get(Summary)
        for name, service in ({} if summary is None else summary.services).items():
            found[name] = Health(
                service.state,
                service.doing or service.last_error,
                round(service.rate_hz, 1),
                service.restarts,
                self.is_here(name),
            )
        for name, (heard, status) in list(self._statuses.items()):
            if name not in found:
                state = status.state if self.is_here(name) and now - heard < SILENT else "gone"
                found[name] = Health(state, status.last_error, round(status.rate_hz, 1), 0, self.is_here(name))
        return dict(sorted(found.items()))

    def _take_ticks(self, ticks: list[Tick]) -> None:
        self.excited.extend(ticks)
        if not self._followed:
            for sensors, acted in ticks:
                self._note_colours(sensors)
                self._acted = acted
            self._note_newest(ticks[-1][0])

    def _take_sensors(self, sensors: Sensors) -> None:
        self._note_newest(sensors)
        with self._pairing:
            pair = self._pairs.first(sensors)
        if pair is not None and self._followed:
            self._on_path = pair
        elif self._on_path is not None and sensors.sequence - self._on_path[0].sequence not in range(BEHIND):
            self._on_path = None
        self._note_colours(sensors)

    def _note_newest(self, sensors: Sensors) -> None:
        self._sensors, self._heard = sensors, (self._clocks.steady(), self._clocks.wall())
        self._opinion.sample(sensors.time, self._heard[0])
        if self._heard[0] >= self._due:
            self._due = max(self._due + KEPT_EVERY, self._heard[0])
            self.keep(self.frame())

    def _note_colours(self, sensors: Sensors) -> None:
        waiting, held = self._colours
        if self._acted is None or not self._acted.box_gripped:
            held = waiting  # A box is held from the tick on in which it no longer waits.
        waiting = sensors.box_colour if sensors.box_present else ""
        self._colours = (waiting, held or waiting)

    def _take_acted(self, acted: Voltages | Acted) -> None:
        self._acted = acted

    def _take_path(self, path: Path) -> None:
        with self._pairing:
            pair = self._pairs.second(path)
        if pair is not None and self._followed:
            self._on_path = pair

    def _take_residuals(self, residuals: MonitoringResiduals) -> None:
        self._residuals = residuals

    def _take_verdict(self, verdict: MonitoringVerdict) -> None:
        self._opinion.update(verdict, self._clocks.steady())

    def _take_last(self, message: msgspec.Struct) -> None:
        self._last[type(message)] = message

    def _take_identification(self, state: IdentificationState) -> None:
        self._take_last(state)
        self.excited.update_state(state)

    def _take_event(self, event: Event) -> None:
        self._events.append(event)
        self._fresh.append(event)
        if event.kind in NEWS:
            self.ask_again()

    def _take_status(self, status: Status) -> None:
        self._statuses[status.service] = (self._clocks.steady(), status)

    def _take_token(self, service: str, alive: bool) -> None:
        self._here[service] = alive
        self.ask_again()

    def _ask_all(self) -> None:
        while not self._over.is_set():
            self._ask(SUMMARY, Summary)
            self.desk.look(self.is_here("bridge"))
            self._ask_settings()
            if self.is_here("monitoring") and (self._ask_watch or WatchState not in self._last):
                self._ask_watch = False
                self._ask(WATCH, WatchState)
            if self.is_here("identification") and IdentificationState not in self._last:
                self._ask(IDENTIFY, IdentificationState)
            # The blocks are looked at only when there is a reason, since that costs the bridge time.
            if self.is_here("bridge") and (self._ask_stop or self._stop != "none"):
                self._ask_stop = False
                if (answer := self._ask(STOP, StopState)) is not None:
                    self._stop = answer.stop
                else:
                    self._ask_stop = True
            self._news.wait(ASKING if self._followed else ASKING_UNREAD)
            self._news.clear()

    def _ask_settings(self) -> None:
        if self.is_here("simulation"):
            self._ask(LOOK, Look)

    def _ask(self, topic: Topic, reply: type[M]) -> M | None:
        """The answer of a topic without a message, remembered; None without one."""
        try:
            answer = self._bus.ask(topic, None, reply, self.patience)
        except CommunicationError as error:
            log.debug("%s", error)
            return None
        self._last[reply] = answer
        return answer
