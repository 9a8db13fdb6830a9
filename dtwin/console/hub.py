"""Gathers what a cell says on its bus, for everybody who looks at it; one hub serves all pages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, TypeVar

import msgspec

from dtwin.bus.messages import IDENTIFICATION, IDENTIFY, LOOK, MONITORING, STOP, SUMMARY, WATCH, StopState, Summary
from dtwin.bus.proposals.deciding import CELL, Kept
from dtwin.bus.proposals.messages import Look
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import IdentificationState, MonitoringVerdict, WatchState
from dtwin.console.answers import Answers
from dtwin.console.clocks import Clocks
from dtwin.console.commands import COMMANDS, ConsoleCommand
from dtwin.console.conditions import NEWS, STALE, conditions, doing
from dtwin.console.excited import ExcitedMotion
from dtwin.console.motion import CellMotion, Motion
from dtwin.console.people.occupancy import Occupancy
from dtwin.console.presence import EventQueue, Presence
from dtwin.console.telling import CellState, Frame, spots
from dtwin.signals import Event, Stop
from dtwin.task import DEFAULT_TASK, Task

ASKING: Final = 1.0
"""Time between two rounds of questions while a page is open, s."""
ASKING_UNREAD: Final = 5.0
"""The same while none is, s: alarms need no more."""
PATIENCE: Final = 1.0
"""Longest wait for one answer, s."""
M = TypeVar("M", bound=msgspec.Struct)


class Hub:
    """The last word of everybody in a cell.

    Args:
        bus: session on which the hub listens and asks.
        cell: name of the cell.
        arm: name of the arm.
        clocks: clocks of the console.
        task: task of the cell, whose places are drawn.
        motion: how the arm moves; as the arm of the cell does if not given.

    Attributes:
        task: task of the cell.
        excited: motion of the last identification.
        desk: who has the desk of the cell.
        motion: how the arm moves.
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

    def __init__(
        self,
        bus: Bus,
        cell: str,
        arm: str,
        clocks: Clocks,
        task: Task = DEFAULT_TASK,
        motion: Motion | None = None,
    ) -> None:
        self.task = task
        self.desk = Occupancy(bus)
        self.excited = ExcitedMotion()
        self.motion = CellMotion(bus, clocks, self.excited) if motion is None else motion
        self._bus = bus
        self._names = (cell, arm)
        self._clocks = clocks
        self._presence = Presence(clocks.steady, self.ask_again)
        self._events = EventQueue(self._take_event)
        self._answers = Answers(bus, self.patience, self._ask_round)
        self._stop: Stop = "none"
        self._ask_stop = self._ask_watch = True

    def listen(self) -> None:
        """Subscribes to all that is shown, and begins to ask for what is not published."""
        self.motion.listen()
        self._bus.subscribe(MONITORING, MonitoringVerdict, self._take_verdict)
        self._bus.subscribe(IDENTIFICATION, IdentificationState, self._take_identification)
        self._events.listen(self._bus)
        self._presence.listen(self._bus)
        self._answers.start()

    def close(self) -> None:
        """Ends the questions."""
        self._answers.close()

    def follow_path(self, wanted: bool) -> None:
        """Has every sample, its command and the path sent at once or not, which costs all who send them time.

        What is not published is asked for more often meanwhile.
        """
        if self.motion.follow(wanted) and wanted:
            self._answers.ask_now()

    def watch(self, names: frozenset[str]) -> None:
        """Listens to the arms of these stations; a cell has none."""

    def station(self, name: str) -> msgspec.Struct | None:
        """What was last heard of the arm of a station that is watched; None in a cell."""
        return None

    def ask_again(self) -> None:
        """Asks at once for what may have changed by a command."""
        self._ask_stop = self._ask_watch = True
        self._answers.ask_now()

    @property
    def age(self) -> float | None:
        """Time since the last sample arrived, s; None before the first one."""
        return self.motion.age

    def frame(self) -> Frame:
        """The arm as it was last heard of."""
        return self.motion.frame()

    def state(self) -> CellState:
        """All that changes seldom."""
        summary = self._answers.last(Summary) or Summary({})
        services = self._presence.services(summary)
        watch = self._of("monitoring", WatchState)
        unwatched = MONITORING.sender not in services or (watch is not None and not watch.running)
        verdict = None if unwatched else self.motion.opinion.current(self._clocks.steady())
        identification = self._of("identification", IdentificationState)
        look = self._of("simulation", Look)
        settings, proposals = (None, ()) if look is None else (look.settings, look.proposals)
        states = [health.state for health in services.values()]
        return CellState(
            *self._names,
            doing=doing(self._stop, states, identification, *self.motion.boxes),
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
            events=self._events.last(),
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
        return self._events.fresh()

    def is_here(self, service: str) -> bool:
        """Whether the token of a service is there."""
        return self._presence.is_here(service)

    def _of(self, service: str, message: type[M]) -> M | None:
        """The last message of a service, as long as the service is there."""
        return self._answers.last(message) if self.is_here(service) else None

    def _take_verdict(self, verdict: MonitoringVerdict) -> None:
        self.motion.opinion.update(verdict, self._clocks.steady())

    def _take_identification(self, state: IdentificationState) -> None:
        self._answers.keep(state)
        self.excited.update_state(state)

    def _take_event(self, event: Event) -> None:
        if event.kind in NEWS:
            self.ask_again()

    def _ask_round(self) -> float:
        """Asks for everything once; returns the time until the next round, s."""
        answers = self._answers
        answers.ask(SUMMARY, Summary)
        self.desk.look(self.is_here("bridge"))
        self._ask_settings()
        if self.is_here("monitoring") and (self._ask_watch or WatchState not in answers):
            self._ask_watch = False
            answers.ask(WATCH, WatchState)
        if self.is_here("identification") and IdentificationState not in answers:
            answers.ask(IDENTIFY, IdentificationState)
        # The blocks are looked at only when there is a reason, since that costs the bridge time.
        if self.is_here("bridge") and (self._ask_stop or self._stop != "none"):
            self._ask_stop = False
            if (answer := answers.ask(STOP, StopState)) is not None:
                self._stop = answer.stop
            else:
                self._ask_stop = True
        return ASKING if self.motion.followed else ASKING_UNREAD

    def _ask_settings(self) -> None:
        if self.is_here("simulation"):
            self._answers.ask(LOOK, Look)
