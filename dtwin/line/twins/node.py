"""The twin of a station: what its monitor finds, what its arm can still hold, and how long its work takes."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, Protocol

import numpy as np

from dtwin.bus.line.plant import ArmSettings
from dtwin.line.line import Load, StationPlan
from dtwin.line.station import FREE, WorkTimes, believed_settings
from dtwin.line.twins.rehearsal import AWAY, Rehearsed, longest, rehearsed, rehearsed_anew
from dtwin.logs.collecting import RunLog
from dtwin.monitoring.estimation.belief import NOISE_FLOOR, assumed
from dtwin.monitoring.kinds import RELATIVE, SUPPLY, arm_state
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.verdict import Finding
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, scaled
from dtwin.recovery.answers import answer_to
from dtwin.recovery.strength import Strength

Ability = Literal["all", "slower", "some places", "lighter boxes", "nothing"]
"""What an arm can still do."""
LATE: Final = 3000
"""Ticks after which an arm that has not finished a box is late."""
BEFORE: Final = 12_000
"""Ticks before a suspicion that the monitor gets: it must see the arm at work to know that its model fits."""
AFTER: Final = 1000
"""Ticks for which it goes on after the last suspicion."""
SETTLED: Final = 800
"""Ticks that an arm takes to come to its path at the start, or after it was released."""
TRIAL: Final = 3000
"""Ticks after SETTLED for which settings that were changed are on trial."""
_STANDS: Final = 20
"""Ticks for which the path of an arm at rest has not moved at least."""
_STILL: Final = 0.002
"""Range within which it may have, rad: of a path that was lost on its way, only what encoders read is known."""
_BOXES: Final = 100
"""Number of boxes whose masses are remembered: more than an arm has within BEFORE."""
SLOWER: Final = 1.05
"""Share of its usual time for a box from which on an arm works slower."""
LEAST: Final = 1e-6
"""Least value of a parameter that was found to be less, SI units."""


@dataclass(frozen=True, slots=True)
class Capability:
    """What an arm can still do, and why.

    Attributes:
        ability: in one word.
        places: the places of its cell to which it can bring the heaviest box of the line.
        why: in words.
        settings: settings of its blocks with which it can do that; None for those in force.
        times: how long its work takes with them; None for as long as usual.
        lighter: other places to which it can bring lighter boxes, and the largest mass of their classes, kg.
    """

    ability: Ability
    places: tuple[str, ...]
    why: str
    settings: ArmSettings | None = None
    times: WorkTimes | None = None
    lighter: tuple[Load, ...] = ()

    def holds(self, load: Load) -> bool:
        """Whether it can bring a box of a mass (kg) to a place."""
        place, mass = load
        return place in self.places or mass <= dict(self.lighter).get(place, 0.0)


class Found(Protocol):
    """A finding of a monitor."""

    def text(self) -> str:
        """In words."""


class Node(Protocol):
    """The twin of a station, whatever arm it has; see `NodeTwin`."""

    plan: StationPlan
    capability: Capability
    rests: bool
    """Whether the arm stood when it was looked at last."""

    @property
    def times(self) -> WorkTimes:
        """How long its work takes."""

    @property
    def doubt(self) -> str:
        """Why settings that are on trial make the arm worse, "" if they do not."""

    def repaired(self) -> None:
        """The arm is as it was made to be."""

    def stopped(self, why: str) -> None:
        """The arm was stopped, and nobody knows yet what it can do."""

    def watch(
        self,
        log: Any,
        arm: int,
        stopped: bool = False,
        settings: ArmSettings | None = None,
        mass: float | None = None,
    ) -> Sequence[Found]:
        """Looks at what the log of its arm has since the last call; returns what was found out."""

    def state_of(self, finding: Any) -> Literal["failed", "angles unknown"]:
        """What a finding means to the blocks' safe stop."""


def held_at(places: Sequence[str], heavy: Collection[str], light: Collection[str]) -> tuple[Ability, tuple[str, ...]]:
    """What an arm can do by what its drives can hold at rest, and the places where that is the heaviest box.

    Args:
        places: names of the places of its cell, beside "pickup".
        heavy: places at which it cannot hold the heaviest box.
        light: those at which it cannot hold the lightest one.
    """
    held = () if "pickup" in heavy else tuple(place for place in places if place not in heavy)
    if not heavy:
        return "all", held
    if held:
        return "some places", held
    return ("nothing" if light else "lighter boxes"), held


def heaviest_held(
    places: Sequence[str], classes: Sequence[float], beyond: Mapping[float, Collection[str]]
) -> dict[str, float]:
    """The largest mass of a class of boxes that an arm can hold at rest, by the place, kg.

    Args:
        places: names of the places of its cell, beside "pickup".
        classes: largest masses of the classes, the heaviest first, kg.
        beyond: places at which it cannot hold such a mass.
    """
    found: dict[str, float] = {}
    for mass in classes:
        if "pickup" not in beyond[mass]:
            found |= {place: mass for place in places if place not in beyond[mass] and place not in found}
    return {place: found[place] for place in places if place in found}


class NodeTwin:
    """The twin of a station.

    Args:
        plan: what it is.
        lightest, heaviest: masses of the boxes of the line, kg.
        classes: largest masses of the classes of boxes that can be told apart, the heaviest first, kg.
    """

    def __init__(self, plan: StationPlan, lightest: float, heaviest: float, classes: tuple[float, ...] = ()) -> None:
        self.plan = plan
        settings = believed_settings(plan)
        self._healthy, self._task = settings.arm, settings.task
        self._noise = max(settings.noise, NOISE_FLOOR)
        self._believe(self._healthy)
        self._masses, self._classes = (lightest, heaviest), (heaviest, *classes[1:])
        self._strength = Strength.of(self._healthy, heaviest, self._task)
        self.capability = self._able()
        self._monitor: Monitor | None = None
        self._from = self._seen = self._told = self._suspected_until = 0
        self._busy_since: int | None = None
        self._weighed: deque[tuple[int, float]] = deque(maxlen=_BOXES)
        self._known = False
        self._settings: ArmSettings | None = None
        self.rests = False
        self._before = self._after = 0.0

    def _believe(self, arm: ArmParameters) -> None:
        """Takes the arm to be one with these parameters."""
        self._arm, self._belief = arm, assumed(arm, (self._noise,) * 3)

    def _able(self) -> Capability:
        return Capability("all", self._task.colours, "nothing is wrong")

    @property
    def times(self) -> WorkTimes:
        """How long its work takes: as it was rehearsed with what was found of the arm, or with nothing wrong."""
        return self.capability.times or rehearsed(self.plan)

    @property
    def doubt(self) -> str:
        """Why settings that are on trial make the arm worse, "" if they do not."""
        if self._settings is None or self._after <= max(AWAY, self._before):
            return ""
        return (
            f"with the settings on trial it was {1e3 * self._after:.0f} mrad from its path,"
            f" {1e3 * self._before:.0f} mrad before"
        )

    def repaired(self) -> None:
        """The arm is as it was made to be; what it does is watched from here on."""
        self.capability, self._known, self._settings = self._able(), False, None
        self._believe(self._healthy)
        self._before = self._after = 0.0
        self._monitor, self._from, self._suspected_until, self._busy_since = None, self._seen, 0, None

    def _adopt(self, settings: ArmSettings, rows: int) -> None:
        """Takes note that the blocks have other settings from a tick on, whose model is the arm as it is known."""
        self._settings, self._before, self._after = settings, max(self._before, self._after), 0.0
        self._believe(settings.model)
        self._monitor, self._from, self._suspected_until = None, rows, 0
        if self.capability.settings != settings:
            self.capability = self._rehearsed(settings.model, "other settings are in force")

    def watch(
        self,
        log: RunLog,
        arm: int,
        stopped: bool = False,
        settings: ArmSettings | None = None,
        mass: float | None = None,
    ) -> list[Finding]:
        """Looks at what the log has since the last call; returns what was found out.

        The monitor is asked when the arm leaves its path, or does not finish a box for long: it takes in the samples
        since BEFORE that, which takes a hundred times longer than to look whether there is a reason.

        Args:
            log: log of the station.
            arm: what the arm does: FREE, OFFERED or HOLDING.
            stopped: whether it is stopped: then it finishes no box, whatever is wrong.
            settings: what its blocks have in the place of the settings of its cell; None for nothing.
            mass: mass of the box that it has or is offered, kg; None for a usual one, or none.
        """
        rows, first = len(log), self._seen
        if rows < first:  # the arm has begun anew
            self._monitor, self._busy_since = None, None
            first = self._from = self._suspected_until = log.forgotten
        self._seen = rows
        if mass is not None and (not self._weighed or self._weighed[-1][1] != mass):
            self._weighed.append((first, mass))
        if settings is not None and settings != self._settings:
            self._adopt(settings, first)
        if self._known or rows == first:
            return []
        new = log.since(first)
        self._busy_since = self._busy_since if arm != FREE and self._busy_since is not None else rows
        away = np.abs(new.stack("target") - new.stack("measured")).max()
        late = arm != FREE and not stopped and rows - self._busy_since > LATE
        self._try(away, rows)
        path = new.stack("target")[-_STANDS:]
        self.rests = len(path) == _STANDS and float(np.ptp(path, axis=0).max()) <= _STILL
        if rows > self._from + SETTLED and (away > AWAY or late):
            self._suspected_until = rows + AFTER
        if rows > self._suspected_until:
            self._monitor = None
            return []
        if self._monitor is None:
            self._monitor, self._told = Monitor(self._belief), 0
            first = max(self._from, first - BEFORE)
            new = log.since(first)
        self._feed(self._monitor, stream(new), first)
        found = self._monitor.history[self._told :]
        self._told += len(found)
        for each in found:
            self.capability = self.judged(each)
            self._known = self.capability.ability == "nothing"
        return found

    def _feed(self, monitor: Monitor, seen: Stream, first: int) -> None:
        """Has a monitor take in samples from a number on, with the masses that boxes had meanwhile."""
        done = 0
        for row, mass in self._weighed:
            begin = min(max(row - first, 0), len(seen))
            seen.feed(monitor, done, begin)
            monitor.estimator.box_mass = mass
            done = begin
        seen.feed(monitor, done, len(seen))

    def _try(self, away: float, rows: int) -> None:
        """Takes note of how far the arm was from its path, before settings were changed and on their trial."""
        if self._settings is None:
            self._before = max(away, self._before) if rows > self._from + SETTLED else 0.0
        elif self._from + SETTLED < rows <= self._from + SETTLED + TRIAL:
            self._after = max(away, self._after)

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
        if answer.measure == "stop":
            return Capability("nothing", (), f"{finding.text()}: {answer.why}")
        changed = self._changed(finding)
        if changed is None:
            return replace(self.capability, why=f"{finding.text()}: {answer.why}")
        return self._rehearsed(changed, finding.text())

    def _changed(self, finding: Finding) -> ArmParameters | None:
        """The arm as a finding says that it is; None for a finding that is not about its parameters."""
        name = str(finding.fault)
        if finding.fault.kind == SUPPLY:
            return scaled(self._arm, "K", max(1.0 + finding.size, LEAST))
        if name not in PARAMETER_NAMES:
            return None
        value = self._arm.get(name)
        change = finding.size * (value if finding.fault.about.unit == RELATIVE else 1.0)
        return self._arm.with_values({name: max(value + change, LEAST)})

    def _rehearsed(self, arm: ArmParameters, why: str) -> Capability:
        """What an arm can do, as the weights at its places and a rehearsal with other settings say."""
        lightest, heaviest = self._masses
        beyond = {mass: self._strength.beyond(arm, mass) for mass in (*self._classes, lightest)}
        ability, _ = held_at(self._task.colours, beyond[heaviest], beyond[lightest])
        loads = heaviest_held(self._task.colours, self._classes, beyond)
        found, loads = self._within_reach(arm, loads)
        if found is None:
            heavy = sorted(beyond[heaviest])
            words = f"it cannot hold {heaviest:g} kg at {', '.join(heavy)}" if heavy else "it leaves its path"
            return Capability("nothing" if loads else ability, (), f"{why}: {words}")
        able = tuple(found.times.carry)
        places = tuple(place for place in able if loads[place] == heaviest)
        lighter = tuple((place, loads[place]) for place in able if loads[place] < heaviest)
        usual = longest(rehearsed(self.plan), able)
        ability = "slower" if found.cycle > SLOWER * usual else "all"
        if lighter:
            ability = "lighter boxes"
        if len(able) < len(self._task.colours):
            ability = "some places"
        words = (
            f"with a model of that, and {found.settings.target_time:g} s for a motion, it takes {found.cycle:.1f} s"
            f" for a box of {heaviest if places else max(loads.values()):g} kg instead of {usual:.1f} s,"
            f" to {', '.join(places or able)}"
        )
        if places and lighter:
            words += "; " + ", ".join(f"of {mass:g} kg at most to {place}" for place, mass in lighter)
        return Capability(ability, places, f"{why}: {words}", found.settings, found.times, lighter)

    def _within_reach(self, arm: ArmParameters, loads: dict[str, float]) -> tuple[Rehearsed | None, dict[str, float]]:
        """Settings with which an arm works, and what it brings then: lighter boxes where it leaves its path.

        Args:
            arm: the arm.
            loads: the largest masses that its motors can hold at rest, by the place, kg.
        """
        while True:
            found = rehearsed_anew(self.plan, arm, tuple(loads.items())) if loads else None
            failed = set(loads) - set(() if found is None else found.times.carry)
            lower = {place: [m for m in self._classes if m < loads[place]] for place in failed}
            if not any(lower.values()):
                return found, loads
            loads = {**loads, **{place: masses[0] for place, masses in lower.items() if masses}}
