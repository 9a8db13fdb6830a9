"""The watch of a zone: its node twins look at what the arms do, and an arm that can no longer do all is stopped."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Literal

from dtwin.line.twins.decisions import Decision, Note
from dtwin.line.twins.node import Capability, Node

StopState = Literal["failed", "angles unknown"]
"""What the blocks of a station are told of an arm that is to be stopped."""
StopArm = Callable[[str, StopState, str], None]
"""Has the blocks of a station stop its arm: called with the station, the state of the arm, and why."""


class Guard:
    """The watch of some stations.

    Args:
        nodes: the twins of the stations, by their names.
        stop: has the blocks of a station stop its arm.
        note: keeps what is decided.

    Attributes:
        stopped: names of the stations whose arms are stopped, or are to be in the next cycle.
    """

    def __init__(self, nodes: Mapping[str, Node], stop: StopArm, note: Note) -> None:
        self._nodes, self._stop, self._note = nodes, stop, note
        self.stopped: set[str] = set()

    def capability(self, station: str) -> Capability:
        """What the arm of a station can still do, as its twin says."""
        return self._nodes[station].capability

    def known(self, station: str, why: str) -> list[str]:
        """Takes note of why somebody else has stopped an arm; reasons to share the work out otherwise."""
        if station in self.stopped:
            return []
        self.stopped.add(station)
        self._nodes[station].stopped(why)
        return [f"{station} can do nothing"]

    def look(self, station: str, log: Any, arm: int, stop: int, time: float) -> list[str]:
        """Looks at what an arm has done since the last look.

        Args:
            station: its station.
            log: log of the station.
            arm: what the arm does: FREE, OFFERED or HOLDING.
            stop: number of the stop in force, 0 for none.
            time: plant time, s.

        Returns:
            Reasons to share the work out otherwise, in words.
        """
        node, reasons = self._nodes[station], []
        for finding in node.watch(log, arm, stop != 0):
            self._note(Decision(time, f"monitor of {station}", "finding", finding.text(), station))
            able = node.capability
            if able.ability == "all":
                continue
            if station not in self.stopped:
                why = f"{able.ability}: {able.why}"
                self._stop(station, node.state_of(finding), why)
                self.stopped.add(station)
                self._note(Decision(time, f"twin of {station}", "stop", why, station))
            reasons.append(f"{station} can do {able.ability}")
        if stop and station not in self.stopped:
            self.stopped.add(station)
            node.stopped("the blocks have stopped the arm; what is wrong is not known yet")
            self._note(Decision(time, f"blocks of {station}", "stop", "the arm left its path", station))
            reasons.append(f"{station} can do nothing")
        return reasons

    def by_hand(self, station: str, who: str, why: str, time: float) -> str:
        """Stops an arm because somebody says so; the reason to share the work out otherwise."""
        self._note(Decision(time, who, "stop", why, station))
        if station not in self.stopped:
            self._stop(station, "failed", f"it was stopped by {who}: {why}")
            self.stopped.add(station)
            self._nodes[station].stopped(f"it was stopped by {who}: {why}")
        return f"{station} was stopped by {who}"

    def repaired(self, station: str, time: float, who: str, why: str) -> str:
        """Believes that an arm which was released is as it was made; the reason to give it its work back."""
        self._nodes[station].repaired()
        self.stopped.discard(station)
        self._note(Decision(time, who, "repair", why, station))
        return f"{station} is repaired"
