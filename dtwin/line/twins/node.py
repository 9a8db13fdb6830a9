"""The twin of a station: what its monitor finds, what its arm can still hold, and how long its work takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Final, Literal, Protocol

import numpy as np

from dtwin.errors import ParameterError
from dtwin.line.line import StationPlan
from dtwin.line.station import FREE, WorkTimes, believed_settings
from dtwin.line.stations import rehearsal
from dtwin.logs.collecting import RunLog
from dtwin.monitoring.estimation.belief import NOISE_FLOOR, assumed
from dtwin.monitoring.kinds import arm_state
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PARAMETER_NAMES
from dtwin.recovery.answers import answer_to
from dtwin.recovery.strength import Strength
from dtwin.signals import EventKind

Ability = Literal["all", "some places", "lighter boxes", "nothing"]
"""What an arm can still do."""
AWAY: Final = 0.05
"""Distance of a joint from its path from which on the monitor is asked, rad."""
LATE: Final = 3000
"""Ticks after which an arm that has not finished a box is late."""
BEFORE: Final = 12_000
"""Ticks before a suspicion that the monitor gets: it must see the arm at work to know that its model fits."""
AFTER: Final = 1000
"""Ticks for which it goes on after the last suspicion."""
SETTLED: Final = 800
"""Ticks that an arm takes to come to its path at the start, or after it was released."""
_PATIENCE: Final = 3000
"""Longest wait of a rehearsal for a box, ticks."""
_START: Final = 500
"""Ticks in which an arm comes from where it hangs to where boxes wait."""


@dataclass(frozen=True, slots=True)
class Capability:
    """What an arm can still do, and why.

    Attributes:
        ability: in one word.
        places: the places of its cell to which it can bring the heaviest box of the line.
        why: in words.
    """

    ability: Ability
    places: tuple[str, ...]
    why: str


class Found(Protocol):
    """A finding of a monitor."""

    def text(self) -> str:
        """In words."""


class Node(Protocol):
    """The twin of a station, whatever arm it has; see `NodeTwin`."""

    plan: StationPlan
    capability: Capability

    @property
    def times(self) -> WorkTimes:
        """How long its work takes as long as nothing is wrong."""

    def repaired(self) -> None:
        """The arm is as it was made to be."""

    def stopped(self, why: str) -> None:
        """The arm was stopped, and nobody knows yet what it can do."""

    def watch(self, log: Any, arm: int, stopped: bool = False) -> Sequence[Found]:
        """Looks at what the log of its arm has since the last call; returns what was found out."""

    def state_of(self, finding: Any) -> Literal["failed", "angles unknown"]:
        """What a finding means to the blocks' safe stop."""


class NodeTwin:
    """The twin of a station.

    Args:
        plan: what it is.
        lightest, heaviest: masses of the boxes of the line, kg.
    """

    def __init__(self, plan: StationPlan, lightest: float, heaviest: float) -> None:
        self.plan = plan
        settings = believed_settings(plan)
        self._arm, self._task = settings.arm, settings.task
        noise = max(settings.noise, NOISE_FLOOR)
        self._belief = assumed(self._arm, (noise, noise, noise))
        self._masses = lightest, heaviest
        self._strength = Strength.of(self._arm, heaviest, self._task)
        self.capability = self._able()
        self._monitor: Monitor | None = None
        self._from = self._seen = self._told = self._suspected_until = 0
        self._busy_since: int | None = None
        self._known = False

    def _able(self) -> Capability:
        return Capability("all", self._task.colours, "nothing is wrong")

    @property
    def times(self) -> WorkTimes:
        """How long its work takes as long as nothing is wrong."""
        return rehearsed(self.plan)

    def repaired(self) -> None:
        """The arm is as it was made to be; what it does is watched from here on."""
        self.capability, self._known = self._able(), False
        self._monitor, self._from, self._suspected_until, self._busy_since = None, self._seen, 0, None

    def watch(self, log: RunLog, arm: int, stopped: bool = False) -> list[Finding]:
        """Looks at what the log has since the last call; returns what was found out.

        The monitor is asked when the arm leaves its path, or does not finish a box for long: it takes in the samples
        since BEFORE that, which takes a hundred times longer than to look whether there is a reason.

        Args:
            log: log of the station.
            arm: what the arm does: FREE, OFFERED or HOLDING.
            stopped: whether it is stopped: then it finishes no box, whatever is wrong.
        """
        rows, first = len(log), self._seen
        self._seen = rows
        if self._known or rows == first:
            return []
        new = log.since(first)
        self._busy_since = self._busy_since if arm != FREE and self._busy_since is not None else rows
        away = np.abs(new.stack("target") - new.stack("measured")).max()
        late = arm != FREE and not stopped and rows - self._busy_since > LATE
        if rows > self._from + SETTLED and (away > AWAY or late):
            self._suspected_until = rows + AFTER
        if rows > self._suspected_until:
            self._monitor = None
            return []
        if self._monitor is None:
            self._monitor, self._told = Monitor(self._belief), 0
            new = log.since(max(self._from, first - BEFORE))
        seen = stream(new)
        seen.feed(self._monitor, 0, len(seen))
        found = self._monitor.history[self._told :]
        self._told += len(found)
        for each in found:
            self.capability = self.judged(each)
            self._known = self.capability.ability == "nothing"
        return found

    def stopped(self, why: str) -> None:
        """The arm was stopped, and nobody knows yet what it can do."""
        self.capability = Capability("nothing", (), why)

    def state_of(self, finding: Finding) -> Literal["failed", "angles unknown"]:
        """What a finding means to the blocks' safe stop."""
        return "angles unknown" if arm_state(finding.fault) == "angles unknown" else "failed"

    def judged(self, finding: Finding) -> Capability:
        """What the arm can do with a finding, as recovery's table of answers and the weights at its places say."""
        fault = finding.fault
        answer = answer_to(fault)
        if answer.measure == "go on":
            return self.capability
        name = str(fault)
        if answer.measure == "stop" or name not in PARAMETER_NAMES:
            able = answer.measure != "stop"
            return Capability(
                "all" if able else "nothing", self._task.colours if able else (), f"{finding.text()}: {answer.why}"
            )
        changed = self._arm.with_values({name: max(self._arm.get(name) * (1.0 + finding.size), 1e-6)})
        lightest, heaviest = self._masses
        heavy, light = (set(self._strength.beyond(changed, mass)) for mass in (heaviest, lightest))
        places = () if "pickup" in heavy else tuple(p for p in self._task.colours if p not in heavy)
        ability: Ability = "some places" if places else "nothing"
        if not heavy:
            ability = "all"
        elif not places and not light:
            ability = "lighter boxes"
        beyond = f"it cannot hold {heaviest:g} kg at {', '.join(sorted(heavy))}" if heavy else "it can hold every box"
        return Capability(ability, places, f"{finding.text()}: {beyond}")


def rehearsed(plan: StationPlan) -> WorkTimes:
    """How long the arm of a station takes.

    It is measured in a run of its cell with the arm that the controller believes in.

    Raises:
        DtwinError: the cell cannot be, or its arm brings no box to a place.
    """
    return _rehearsed(replace(plan, name="", node="", operations=(), machine=None, seed=0, faults=()))


@lru_cache(maxsize=256)
def _rehearsed(plan: StationPlan) -> WorkTimes:
    """The same, once for all stations that are alike but for what the twin does not know or need."""
    station, places, mass = rehearsal(plan)
    now = 0

    def brings(colour: str) -> tuple[float, float]:
        """Times at which a box that is brought now is picked and delivered, s."""
        nonlocal now
        station.give("bring", mass, colour)
        times: dict[str, float] = {}
        for _ in range(_PATIENCE):
            report = station.advance(1)
            now += 1
            times |= {event.kind: event.time for event in report.events}
            if report.arm == FREE and EventKind.DELIVERED in times:
                return times[EventKind.PICKED], times[EventKind.DELIVERED]
        raise ParameterError(f"station {plan.cell_file or 'default'}: its arm brings no box to {colour}")

    station.advance(_START)
    now = _START
    grip, carry, back = 0.0, {}, {}
    for colour in places:
        began = 0.01 * now
        picked, delivered = brings(colour)
        grip, carry[colour] = picked - began, delivered - picked
        again, _ = brings(colour)
        back[colour] = again - delivered - grip
        station.advance(_START)
        now += _START
    return WorkTimes(grip, carry, back)
