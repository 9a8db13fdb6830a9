"""Who does what in a line, and who has it changed: the twin of the line, and people who ask.

It knows zones and what their stations can do, but neither plant nor logs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from dtwin.bus.line.messages import FlowEffect, ZoneFlow
from dtwin.errors import ParameterError, UnansweredError, choices
from dtwin.line.line import Assignment, Line
from dtwin.line.twins.decisions import Decision, Mode, Note
from dtwin.line.twins.forward import SOON
from dtwin.line.twins.overall import Choice, OverallTwin, Zone, changed
from dtwin.line.twins.zone import AHEAD, HOUR

LOOKS: Final = (30.0, 270.0)
"""Times from an answer to a second look at it, and from that to a third one, s.

By the third one arms have brought boxes of all classes, and their twins know how long that takes.
"""


@dataclass(frozen=True, slots=True)
class Doors:
    """What a reorganisation needs of the rest.

    Attributes:
        set_up: tells the zones which station does what from now on; whether they take it. It may raise
            UnansweredError, when nobody answers in time.
        clock: gives the plant time, s.
        note: keeps what is decided.
        propose: lays before a person what the twins would do, and why.
    """

    set_up: Callable[[Assignment], bool]
    clock: Callable[[], float]
    note: Note
    propose: Callable[[Choice, str], None] = lambda choice, why: None


@dataclass(frozen=True, slots=True)
class _Wanted:
    """What the zones refused a moment ago, and are to take soon.

    Attributes:
        choice: the work shared out otherwise.
        until: plant time until which they have time, s.
        because: why.
        station: station that it is about.
        towards: from which as little as possible shall be changed.
        look: number of looks that were taken at the same before.
    """

    choice: Choice
    until: float
    because: str
    station: str
    towards: Assignment
    look: int


class Reorganisation:
    """Shares the work out, and shares it out otherwise when there is a reason.

    Args:
        line: the line.
        mode: what the twins may do.
        zones: the twins of the zones, in their order.
        doors: what it needs of the rest.

    Attributes:
        assignment: which station does what now.
        version: number of set-ups since the start.
    """

    def __init__(self, line: Line, mode: Mode, zones: Sequence[Zone], doors: Doors) -> None:
        self._line, self._mode, self._zones, self._doors = line, mode, zones, doors
        self._overall = OverallTwin(line, zones)
        self._pending: tuple[Assignment, str, str] | None = None
        self._again: tuple[float, int, str, str] | None = None
        self._wanted: _Wanted | None = None
        self._proposed: Assignment | None = None
        self._impossible = ""
        self.assignment: Assignment = dict(line.assignment)
        self.version = 0

    def prepare(self) -> None:
        """Lets the twins find out beforehand what every way to share the work out brings, which takes a while."""
        self._overall.choose(self.assignment)

    def reconsider(
        self,
        because: str,
        station: str,
        towards: Assignment | None = None,
        look: int = 0,
        refused: Sequence[Assignment] = (),
    ) -> None:
        """Shares the work out as is best now; what cannot be done yet is tried again with `retry`.

        An arm that fails is answered at once, from a short simulation; later `retry` looks at that again, for an hour
        ahead. What zones refuse first they have SOON for, as some box is often where it could not leave for a moment;
        after that the next best is done.

        Args:
            because: why.
            station: station that it is about.
            towards: from which as little as possible shall be changed; what is in force if not given.
            look: number of looks that were taken at the same before.
            refused: what zones have refused for so long.
        """
        if self._mode == "off":
            return
        now, ahead = self.assignment if towards is None else towards, HOUR if look else AHEAD
        self._pending = self._again = self._wanted = None
        refused = list(refused)
        while choice := (back := self._back(towards, refused)) or self._overall.choose(now, refused, ahead):
            if back is None and (look < len(LOOKS) or refused):
                done = min(look, len(LOOKS) - 1)
                self._again = (self._doors.clock() + LOOKS[done], done + 1, because, station)
            if look and choice.assignment == self._proposed:
                return
            if not changed(self.assignment, choice.assignment):
                if not self._possible(self.assignment):  # nobody could tell anything better
                    self._pending = (now, because, station)
                return
            try:
                if self._mode == "act" and not self._doors.set_up(choice.assignment):
                    if not refused:
                        until = self._doors.clock() + SOON
                        self._wanted = _Wanted(choice, until, because, station, now, look)
                        return
                    refused.append(choice.assignment)
                    continue
            except UnansweredError:
                self._pending = (now, because, station)
                return
            self._adopt(choice, because, station)
            return
        self._pending = (now, because, station)
        if not refused and because != self._impossible:
            self._impossible = because
            why = f"{because}: no station can do all that is left"
            self._decide("overall twin", "none possible", why, station)

    def _back(self, towards: Assignment | None, refused: Sequence[Assignment]) -> Choice | None:
        """What was before, when all arms are well again; None else."""
        if towards is None or towards in refused:
            return None
        abilities = {zone.capability(station).ability for zone in self._zones for station in zone.stations}
        if abilities != {"all"}:
            return None
        rate = self._whole(self._flows(towards))
        return Choice(dict(towards), rate, f"all arms are well again; {rate:.1f} boxes/h")

    def retry(self) -> None:
        """Tries again what could not be done, if anything, or takes another look at what was done."""
        if self._wanted is not None:
            self._insist(self._wanted)
        elif self._pending is not None:
            now, because, station = self._pending
            self.reconsider(because, station, now)
        elif self._again is not None and self._again[0] <= self._doors.clock():
            _, look, because, station = self._again
            self.reconsider(because, station, look=look)

    def _insist(self, wanted: _Wanted) -> None:
        """Has the zones take what they refused, or looks for the next best once they have had their time."""
        try:
            taken = self._doors.set_up(wanted.choice.assignment)
        except UnansweredError:
            return
        if taken:
            self._wanted = None
            self._adopt(wanted.choice, wanted.because, wanted.station)
        elif self._doors.clock() >= wanted.until:
            refused = [wanted.choice.assignment]
            self.reconsider(wanted.because, wanted.station, wanted.towards, wanted.look, refused)

    def adopt(self, assignment: Assignment, version: int) -> None:
        """Takes note of a set-up that came into force without this twin."""
        self.assignment, self.version = dict(assignment), version

    def effect(self, changes: Assignment) -> FlowEffect:
        """What the twins expect of a set-up beside the one in force.

        Args:
            changes: the station of each operation that another one shall do; empty for the best set-up there is.

        Raises:
            ParameterError: the stations cannot do it, or nothing is changed, or there is no set-up that they can do.
        """
        assignment = self.changed(changes) if changes else self._best()
        zones = zip(self._zones, self._flows(assignment), self._flows(self.assignment), strict=True)
        flows = tuple(ZoneFlow(zone.name, after, before) for zone, after, before in zones)
        difference = tuple(
            f"{name}: {before} becomes {assignment[name]}"
            for name, before in self.assignment.items()
            if before != assignment[name]
        )
        now = self._whole([flow.rate_now for flow in flows]) if self._possible(self.assignment) else 0.0
        return FlowEffect(dict(assignment), self._whole([flow.rate for flow in flows]), now, flows, difference)

    def changed(self, changes: Assignment) -> dict[str, str]:
        """The set-up in force with some operations done by other stations.

        Raises:
            ParameterError: there is no such operation, the stations cannot do it, or nothing is changed.
        """
        changes = self._line.whole(changes)
        for name in changes:
            if name not in self.assignment:
                raise ParameterError(f"operation {name}: expected {choices(list(self.assignment))}")
        assignment = {**self.assignment, **changes}
        self.check(assignment)
        if assignment == self.assignment:
            raise ParameterError("set-up: expected another one than is in force")
        return assignment

    def check(self, assignment: Assignment) -> None:
        """Checks that stations can do a set-up: as they were built, and as their twins say that they are now.

        Raises:
            ParameterError: one cannot; the message says which and why.
        """
        self._line.check_assignment(assignment)
        for job in self._line.jobs:
            station = assignment[job.name]
            able = self._zones[self._line.zone_of(station)].capability(station)
            if not able.holds(job.load):
                raise ParameterError(f"assignment.{job.name}: {station} can do {able.ability} there now: {able.why}")

    def set_up(self, changes: Assignment, who: str, why: str) -> FlowEffect:
        """Sets stations up as somebody asks, if they can do it and the zones take it.

        Args:
            changes: the station of each operation that another one shall do.
            who: name of who asks.
            why: reason.

        Raises:
            ParameterError: a station cannot do it, nothing is changed, or a zone refuses it.
        """
        self.changed(changes)
        effect = self.effect(changes)
        if not self._doors.set_up(effect.set_up):
            raise ParameterError("set-up: a zone refuses it, because boxes could not leave then that can leave now")
        self._pending = self._wanted = None
        self.assignment = effect.set_up
        self.version += 1
        self._decide(who, "set-up", why, "", effect.set_up, effect.rate)
        return effect

    def _best(self) -> dict[str, str]:
        choice = self._overall.choose(self.assignment)
        if choice is None:
            raise ParameterError("set-up: there is none, because no station can do all that is left")
        return choice.assignment

    def _possible(self, assignment: Assignment) -> bool:
        try:
            self.check(assignment)
        except ParameterError:
            return False
        return True

    def _flows(self, assignment: Assignment) -> list[float]:
        """Boxes an hour that each zone lets through with a set-up; 0 for one that has nothing to do, or cannot."""
        shares = [{n: s for n, s in assignment.items() if s in zone.stations} for zone in self._zones]
        return [
            zone.rate(share) if share and self._able(zone, share) else 0.0
            for zone, share in zip(self._zones, shares, strict=True)
        ]

    def _able(self, zone: Zone, share: Assignment) -> bool:
        """Whether the arms of a zone can do its share of the operations now."""
        loads = {job.name: job.load for job in self._line.jobs}
        return all(zone.capability(station).holds(loads[name]) for name, station in share.items())

    def _whole(self, flows: list[float]) -> float:
        return min([3600.0 / self._line.source.every, *(flow for flow in flows if flow)])

    def _adopt(self, choice: Choice, because: str, name: str) -> None:
        """Notes what the zones do from now on, or would do."""
        acts = self._mode == "act"
        self._impossible = ""
        moved = ", ".join(
            f"{operation} from {self.assignment[operation]} to {station}"
            for operation, station in choice.assignment.items()
            if self.assignment[operation] != station
        )
        why, what = f"{because}: {moved}; {choice.why}", "set-up" if acts else "proposal"
        self._decide("overall twin", what, why, name, choice.assignment, choice.rate)
        if acts:
            self.assignment = choice.assignment
            self.version += 1
        else:
            self._proposed = choice.assignment
            self._doors.propose(choice, why)

    def _decide(
        self,
        who: str,
        what: str,
        why: str,
        station: str = "",
        assignment: Mapping[str, str] | None = None,
        rate: float = 0.0,
    ) -> None:
        self._doors.note(Decision(self._doors.clock(), who, what, why, station, dict(assignment or {}), rate))
