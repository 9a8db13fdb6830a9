"""The watch of a zone: its node twins look at what the arms do; an arm that can do less works otherwise, or stops."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal

from dtwin.bus.line.plant import Settings
from dtwin.line.line import Load
from dtwin.line.station import FREE
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Decision, Mode, Note
from dtwin.line.twins.node import Node
from dtwin.line.twins.rehearsal import longest

StopState = Literal["failed", "angles unknown"]
"""What the blocks of a station are told of an arm that is to be stopped."""
StopArm = Callable[[str, StopState, str], None]
"""Has the blocks of a station stop its arm: called with the station, the state of the arm, and why."""
SetArm = Callable[[str, Settings, str], None]
"""Has the blocks of a station work with other settings: called with the station, the settings, and why."""
OVERDUE: Final = 45.0
"""Least time for a box after which an arm is stopped, s: its twin has asked its monitor why it is late by then."""
EXPLAINED: Final = 15.0
"""Time after a stop by the blocks until which its cause is found, if it is found at all, s."""
PATIENCE: Final = 3.0
"""Least time for a box after which an arm is stopped, as a multiple of the longest that it takes for one."""
OTHERWISE: Final = 0.1
"""Change of an arm's slowness from which on the work is shared out otherwise, though nothing is found of it."""


@dataclass(frozen=True, slots=True)
class Hands:
    """What a watch has done by others.

    Attributes:
        stop: has the blocks of a station stop its arm.
        settle: has the blocks of a station work with other settings.
        needed: tells what a station brings to which places of its cell now.
        works: tells the box that its arm holds, or is offered, now; None for none, or a usual one.
        box: tells the number of that box; 0 for none.
        note: keeps what is decided.
    """

    stop: StopArm
    settle: SetArm
    needed: Callable[[str], Collection[Load]]
    works: Callable[[str], Load | None]
    box: Callable[[str], int]
    note: Note


class Guard:
    """The watch of some stations.

    Args:
        nodes: the twins of the stations, by their names.
        mode: what the twins may do.
        hands: what it has done by others.

    Attributes:
        stopped: names of the stations whose arms are stopped, or are to be in the next cycle.
    """

    def __init__(self, nodes: Mapping[str, Node], mode: Mode, hands: Hands) -> None:
        self._nodes, self._mode, self._hands, self._note = nodes, mode, hands, hands.note
        self.stopped: set[str] = set()
        self._proposed: dict[str, str] = {}
        self._waiting: set[str] = set()
        self._begun: dict[str, tuple[int, float]] = {}
        self._unexplained: dict[str, float] = {}
        self._slowness: dict[str, float] = {}
        self._found: dict[str, str] = {}
        self._said: dict[str, str] = {}

    def capability(self, station: str) -> Capability:
        """What the arm of a station can still do, as its twin says."""
        return self._nodes[station].capability

    def known(self, station: str, why: str) -> list[str]:
        """Takes note of why somebody else has stopped an arm; reasons to share the work out otherwise.

        One that is stopped already is no longer to be released with other settings: somebody has a reason of his own.
        """
        if station in self.stopped and why == self._said.get(station):
            return []
        before = station in self.stopped
        self.stopped.add(station)
        self._said[station] = why
        self._nodes[station].stopped(why)
        return [] if before else [f"{station} can do nothing"]

    def look(
        self, station: str, log: Any, arm: int, stop: int, time: float, settings: Settings | None = None
    ) -> list[str]:
        """Looks at what an arm has done since the last look.

        Args:
            station: its station.
            log: log of the station.
            arm: what the arm does: FREE, OFFERED or HOLDING.
            stop: number of the stop in force, 0 for none.
            time: plant time, s.
            settings: what its blocks have in the place of the settings of its cell; None for nothing.

        Returns:
            Reasons to share the work out otherwise, in words.
        """
        node, reasons = self._nodes[station], []
        then = node.capability.once_released
        if station in self.stopped and not stop and then is not None and then.settings == settings:
            self._forget(station)
            reasons.append(f"{station} can do {then.ability}")
        load, places = self._hands.works(station), [place for place, _ in self._hands.needed(station)]
        for finding in node.watch(log, arm, stop != 0, settings, None if load is None else load[1], places):
            if finding.text() != self._found.get(station):  # what only waits for people is found with every box
                self._found[station] = finding.text()
                self._note(Decision(time, f"monitor of {station}", "finding", finding.text(), station))
            self._unexplained.pop(station, None)
            able = node.capability
            if station in self.stopped:
                self._offer(station, able, arm, settings, time)
                continue
            if not stop and all(map(able.holds, self._hands.needed(station))):
                reasons += self._go_on(station, able, time)
                continue
            if not stop and able.lighter and self._too_heavy(station) is None:
                reasons += self._go_on(station, able, time) or [f"{station} can do {able.ability}"]
                continue
            if able.ability == "all":
                continue
            reasons.append(f"{station} can do nothing")
            self._stop(station, node.state_of(finding), f"{able.ability}: {able.why}", time)
            self._offer(station, able, arm, settings, time)
        heavy = self._too_heavy(station) if node.capability.lighter and not stop else None
        if heavy is not None and station not in self.stopped:
            reasons.append(f"{station} can do nothing")
            why = f"{node.capability.why}; it was to bring {heavy[1]:g} kg to {heavy[0]}"
            self._stop(station, "failed", why, time)
        if station in self._waiting and arm == FREE and node.rests and not stop and station not in self.stopped:
            self._settle(station, time)
        if node.doubt and station not in self.stopped:
            reasons.append(f"{station} can do nothing")
            self._stop(station, "failed", node.doubt, time)
        overdue = self._overdue(station, stop, time)
        if overdue and station not in self.stopped:
            reasons.append(f"{station} can do nothing")
            self._stop(station, "failed", overdue, time)
        if stop and station not in self.stopped:
            self._note(Decision(time, f"blocks of {station}", "stop", "the arm left its path", station))
            self._take_note(station, arm, settings, time)
            reasons.append(f"{station} can do nothing")
        self._tell_unexplained(station, stop, time)
        return reasons or self._takes_otherwise(station, time)

    def _take_note(self, station: str, arm: int, settings: Settings | None, time: float) -> None:
        """Takes note that the blocks have stopped an arm, of which may be known with which settings it would work."""
        self.stopped.add(station)
        node = self._nodes[station]
        able = node.capability
        if able.settings in (None, settings):
            node.stopped("the blocks have stopped the arm; what is wrong is not known yet")
            self._unexplained[station] = time
        else:
            self._offer(station, able, arm, settings, time)

    def _takes_otherwise(self, station: str, time: float) -> list[str]:
        """That an arm has become slower, or faster, since it was told so last, whatever is wrong with it."""
        node = self._nodes[station]
        slowness = node.slowness
        if slowness is None:  # it was repaired, or has other settings, and nothing was measured since
            self._slowness.pop(station, None)
            return []
        if station in self.stopped or abs(slowness - self._slowness.get(station, 1.0)) <= OTHERWISE:
            return []
        self._slowness[station] = slowness
        words = f"takes {slowness:.2f} times as long to bring a box as at first"
        node.capability = node.capability.slowed(f"it {words}" if slowness > 1.0 + OTHERWISE else "")
        self._note(Decision(time, f"twin of {station}", "finding", f"it {words}", station))
        return [f"{station} {words}"]

    def _tell_unexplained(self, station: str, stop: int, time: float) -> None:
        """Says once that a stop by the blocks is explained by nothing: an arm that stands tells no more of itself."""
        if time - self._unexplained.get(station, time) > EXPLAINED:
            del self._unexplained[station]
            if stop:
                why = (
                    f"nothing explains within {EXPLAINED:g} s why the blocks stopped the arm: it may have moved too"
                    " little before; once it is released it is watched again"
                )
                self._note(Decision(time, f"monitor of {station}", "no finding", why, station))

    def _overdue(self, station: str, stop: int, time: float) -> str:
        """Why an arm counts as one that never finishes the box that it has or is offered, "" if it does not.

        It may have stood still before anybody could learn it, or fail in a way that no monitor knows.
        """
        box = self._hands.box(station)
        begun, since = self._begun.get(station, (0, time))
        if stop or not box or box != begun:
            self._begun[station] = box, time
        elif time - since > OVERDUE:
            times = self._nodes[station].times
            if time - since > PATIENCE * longest(times, tuple(times.carry)):
                return f"it has had box {box} for {time - since:.0f} s without finishing it, and why is not known"
        return ""

    def _too_heavy(self, station: str) -> Load | None:
        """What an arm holds, or is offered, now and cannot hold where it shall bring it."""
        load = self._hands.works(station)
        return None if load is None or self.capability(station).holds(load) else load

    def _go_on(self, station: str, able: Capability, time: float) -> list[str]:
        """Lets an arm work on, with other settings if it needs any; the reasons to share the work out otherwise."""
        if able.settings is None or station in self._proposed:
            return []
        if self._mode == "act":
            self._waiting.add(station)
        else:
            self._proposed[station] = ""
            self._note(Decision(time, f"twin of {station}", "proposal", f"{able.ability}: {able.why}", station))
        return [] if able.ability == "all" else [f"{station} can do {able.ability}"]

    def _settle(self, station: str, time: float) -> None:
        """Gives an arm that stands, without a box, its other settings: in mid-motion a new model would jerk it."""
        self._waiting.discard(station)
        able = self._nodes[station].capability
        if able.settings is not None:
            why = f"{able.ability}: {able.why}"
            self._hands.settle(station, able.settings, why)
            self._note(Decision(time, f"twin of {station}", "settings", why, station))

    def _offer(self, station: str, able: Capability, arm: int, settings: Settings | None, time: float) -> None:
        """Proposes to release a stopped arm with the settings that it needs, if it brings the box that it has then.

        Only people release an arm: nobody but they can see whether something is in its way.

        Args:
            station: its station.
            able: what it can do with them.
            arm: what it does: FREE, OFFERED or HOLDING.
            settings: those in force; None for those of its cell.
            time: plant time, s.
        """
        node, load, why = self._nodes[station], self._hands.works(station), f"{able.ability}: {able.why}"
        brings = able.ability in ("all", "slower") or (arm == FREE if load is None else able.holds(load))
        if able.settings is None or able.settings == settings or able.ability == "nothing" or not brings:
            node.stopped(why)
            return
        node.stopped(able.why, able)
        proposed = f"{able.ability} with {able.settings.text()}"  # what is found again is a little larger or smaller
        if proposed != self._proposed.get(station):
            self._proposed[station] = proposed
            words = f"a person can release it with other settings: {why}"
            self._note(Decision(time, f"twin of {station}", "proposal", words, station))

    def _stop(self, station: str, state: StopState, why: str, time: float) -> None:
        """Has an arm stopped, which does nothing from then on, whatever it could."""
        if station not in self.stopped:
            self._hands.stop(station, state, why)
            self.stopped.add(station)
            self._said[station] = why[:1000]
            self._note(Decision(time, f"twin of {station}", "stop", why, station))
        self._nodes[station].stopped(why)

    def by_hand(self, station: str, who: str, why: str, time: float) -> str:
        """Stops an arm because somebody says so; the reason to share the work out otherwise."""
        self._note(Decision(time, who, "stop", why, station))
        if station not in self.stopped:
            self._hands.stop(station, "failed", f"it was stopped by {who}: {why}")
            self.stopped.add(station)
        self._nodes[station].stopped(f"it was stopped by {who}: {why}")
        return f"{station} was stopped by {who}"

    def repaired(self, station: str, time: float, who: str, why: str) -> str:
        """Believes that an arm which was released is as it was made; the reason to give it its work back."""
        self._nodes[station].repaired()
        self._forget(station)
        self._note(Decision(time, who, "repair", why, station))
        return f"{station} is repaired"

    def _forget(self, station: str) -> None:
        """Forgets what was with an arm that people have let move again."""
        self.stopped.discard(station)
        self._waiting.discard(station)
        for noted in (self._unexplained, self._found, self._said, self._proposed):
            noted.pop(station, None)
