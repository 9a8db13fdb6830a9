"""A line while it runs: what another set-up would bring, and set-ups, stops and releases that somebody asks for."""

from __future__ import annotations

from dtwin.bus.line.messages import FlowEffect, ZoneFlow
from dtwin.errors import ParameterError, choices
from dtwin.line.line import Assignment
from dtwin.line.run import LineRun
from dtwin.line.twins.node import Capability


class AskedRun(LineRun):
    """A line that people, twins and an AI can ask, and have set up otherwise."""

    def prepare(self) -> None:
        """Lets the twins find out beforehand what every way to share the work out brings, which takes a while."""
        self._overall.choose(self.assignment)

    def capability(self, station: str) -> Capability:
        """What the arm of a station can still do, as its twin says."""
        return self._nodes[station].capability

    def is_stopped(self, station: str) -> bool:
        """Whether the arm of a station is stopped, or is to be in the next cycle."""
        return station in self._stopped or bool(self.plant.stations[station].report.stop)

    def effect(self, changes: Assignment) -> FlowEffect:
        """What the twins expect of a set-up beside the one in force.

        Args:
            changes: the station of each operation that another one shall do; empty for the best set-up there is.

        Raises:
            ParameterError: the stations cannot do it, or nothing is changed, or there is no set-up that they can do.
        """
        assignment = self.changed(changes) if changes else self._best()
        zones = zip(self.line.zones, self._flows(assignment), self._flows(self.assignment), strict=True)
        flows = tuple(ZoneFlow(zone.name, after, before) for zone, after, before in zones)
        difference = tuple(
            f"{name}: {before} becomes {assignment[name]}"
            for name, before in self.assignment.items()
            if before != assignment[name]
        )
        now = self._whole([flow.rate_now for flow in flows]) if self._possible(self.assignment) else 0.0
        return FlowEffect(assignment, self._whole([flow.rate for flow in flows]), now, flows, difference)

    def changed(self, changes: Assignment) -> dict[str, str]:
        """The set-up in force with some operations done by other stations.

        Raises:
            ParameterError: there is no such operation, the stations cannot do it, or nothing is changed.
        """
        for name in changes:
            if name not in self.assignment:
                raise ParameterError(f"operation {name}: expected {choices(list(self.assignment))}")
        assignment = {**self.assignment, **changes}
        self.check(assignment)
        if assignment == self.assignment:
            raise ParameterError("set-up: expected another one than is in force")
        return assignment

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
        """Boxes an hour that each zone lets through with a set-up; 0 for one that has nothing to do."""
        shares = [{n: s for n, s in assignment.items() if s in zone.stations} for zone in self._zones]
        return [zone.rate(share) if share else 0.0 for zone, share in zip(self._zones, shares, strict=True)]

    def _whole(self, flows: list[float]) -> float:
        return min([3600.0 / self.line.source.every, *(flow for flow in flows if flow)])

    def check(self, assignment: Assignment) -> None:
        """Checks that stations can do a set-up: as they were built, and as their twins say that they are now.

        Raises:
            ParameterError: one cannot; the message says which and why.
        """
        self.line.check_assignment(assignment)
        for operation in self.line.operations:
            station = assignment[operation.name]
            able = self.capability(station)
            if operation.place not in able.places:
                raise ParameterError(
                    f"assignment.{operation.name}: {station} can do {able.ability} there now: {able.why}"
                )

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
        if not self.control.set_up(effect.set_up):
            raise ParameterError("set-up: a zone refuses it, because boxes could not leave then that can leave now")
        self._pending = None
        self.assignment = effect.set_up
        self.version += 1
        self._decide(who, "set-up", why, "", effect.set_up, effect.rate)
        return effect

    def stop(self, station: str, who: str, why: str) -> None:
        """Stops the arm of a station, which keeps its box; the twins then give its work to others, if they may.

        Raises:
            ParameterError: there is no such station.
        """
        self._check_station(station)
        self._decide(who, "stop", why, station)
        if station not in self._stopped:
            self.emulated[station].give("failed")
            self._stopped.add(station)
            self._nodes[station].stopped(f"it was stopped by {who}: {why}")
            if self.settings.twins != "off":
                self._set_up(self.assignment, f"{station} was stopped by {who}", station)

    def release(self, station: str, who: str, why: str) -> None:
        """Lets a stopped arm move again, as one that is repaired.

        Raises:
            ParameterError: there is no such station, or its arm is not stopped.
        """
        self._check_station(station)
        if not self.is_stopped(station):
            raise ParameterError(f"station {station}: expected one whose arm is stopped")
        self._repair(station, who, why)

    def _check_station(self, name: str) -> None:
        if name not in self.emulated:
            raise ParameterError(f"station: expected {choices(list(self.emulated))}, got {name!r}")
