"""What the arm of a station can still do: what it can hold at rest, and where it brings that in a rehearsal."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from dtwin.bus.line.plant import Ability, Settings, StationAbility
from dtwin.line.line import Load, Source
from dtwin.line.station import WorkTimes
from dtwin.line.twins.rehearsal import Rehearsed, longest

SLOWER: Final = 1.05
"""Share of its usual time for a box from which on an arm works slower."""
NOTHING_WRONG: Final = "nothing is wrong"
"""Why an arm can do all."""


@dataclass(frozen=True, slots=True)
class Capability:
    """What an arm can still do, and why.

    Attributes:
        ability: in one word.
        places: the places of its cell to which it can bring the heaviest box of the line.
        why: in words.
        settings: settings of its blocks with which it can do that; None for those in force.
        once_released: what an arm that is stopped, and can do nothing, can do with other settings once a person
            releases it; None for one that is not, or for which nobody knows such settings.
        times: how long its work takes with them; None for as long as usual.
        lighter: other places to which it can bring lighter boxes, and the largest mass of their classes, kg.
    """

    ability: Ability
    places: tuple[str, ...]
    why: str
    settings: Settings | None = None
    times: WorkTimes | None = None
    lighter: tuple[Load, ...] = ()
    once_released: Capability | None = None

    def holds(self, load: Load) -> bool:
        """Whether it can bring a box of a mass (kg) to a place."""
        place, mass = load
        return place in self.places or mass <= dict(self.lighter).get(place, 0.0)

    def times_with(self, settings: Settings | None) -> WorkTimes | None:
        """How long its work takes with the settings that it needs, where they are still to come in the place of those
        in force: what it took with these tells nothing then. None where they are in force, or none are needed."""
        return self.times if self.settings != settings else None

    def stopped(self, why: str) -> Capability:
        """The same of an arm that is stopped: nothing, until a person releases it with the settings that it needs."""
        return Capability("nothing", (), f"{self.ability}: {why}", once_released=self)

    def told(self, station: str) -> StationAbility:
        """The same of the arm of a station as a message."""
        then, settings = self.once_released, self.settings
        if then is not None:
            settings = then.settings
        return StationAbility(
            *(station, self.ability, self.places, self.why[:1000], settings, self.lighter),
            None if then is None else then.ability,
        )

    @classmethod
    def heard(cls, told: StationAbility) -> Capability:
        """What was told of an arm; not how long its work takes, nor where it brings boxes once it is released."""
        if told.once_released is None:
            return cls(told.ability, told.places, told.why, told.settings, lighter=told.lighter)
        why = told.why.removeprefix(f"{told.once_released}: ")
        return cls("nothing", (), told.why, once_released=cls(told.once_released, (), why, told.settings))

    def slowed(self, why: str) -> Capability:
        """The same of an arm that brings all but is slower than it was, "" if it is so no more."""
        if self.ability not in ("all", "slower") or self.settings is not None:
            return self
        return replace(self, ability="slower" if why else "all", why=why or NOTHING_WRONG)


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


@dataclass(frozen=True, slots=True)
class Trials:
    """Rehearsals of an arm that has changed.

    Attributes:
        anew: finds settings with which it brings loads, the largest mass to each place; None where there are none.
        usual: how long the arm took before.
    """

    anew: Callable[[tuple[Load, ...]], Rehearsed | None]
    usual: WorkTimes


@dataclass(frozen=True, slots=True)
class Boxes:
    """The boxes that an arm has to bring.

    Attributes:
        places: names of the places of its cell, beside "pickup".
        masses: largest masses of their classes, the heaviest first, and the mass of the lightest one, kg.
        usual: mean masses of the boxes of these classes, kg.
    """

    places: tuple[str, ...]
    masses: tuple[float, ...]
    usual: tuple[float, ...]

    @classmethod
    def of(cls, places: Iterable[str], source: Source) -> Boxes:
        """The boxes of a line, which come in at its source, for the places of an arm."""
        lighter = (each.heaviest for each in source.classes[1:])
        return cls(tuple(places), (source.heaviest, *lighter, source.lightest), source.usual)

    def kind(self, mass: float | None) -> int:
        """Number of the class of a mass, kg, from 0, the heaviest; 0 for an unknown one."""
        return 0 if mass is None else sum(mass <= each for each in self.masses[1:-1])

    def all_brought(self) -> Capability:
        """What an arm can do with which nothing is wrong."""
        return Capability("all", self.places, NOTHING_WRONG)

    def brought(
        self, beyond: Callable[[float], Collection[str]], trials: Trials, why: str, needed: Collection[str] = ()
    ) -> Capability:
        """What an arm can do, as the weights at its places and a rehearsal with other settings say.

        Args:
            beyond: gives the places at which it cannot hold a mass (kg) at rest.
            trials: rehearsals of it.
            why: what was found of it, in words.
            needed: where its boxes belong now: one that does not work everywhere works there as fast as it can.
        """
        masses, places = self.masses, self.places
        heavy_at = {mass: beyond(mass) for mass in masses}
        heaviest, classes = masses[0], masses[:-1]
        ability, _ = held_at(places, heavy_at[heaviest], heavy_at[masses[-1]])
        found, loads = _within_reach(trials, classes, heaviest_held(places, classes, heavy_at))
        if found is None:
            heavy = sorted(heavy_at[heaviest])
            words = f"it cannot hold {heaviest:g} kg at {', '.join(heavy)}" if heavy else "it leaves its path"
            return Capability("nothing" if loads else ability, (), f"{why}: {words}")
        now = tuple((place, loads[place]) for place in found.times.carry if place in needed)
        if 0 < len(now) < len(found.times.carry) < len(loads):
            found = trials.anew(now) or found
        able = tuple(found.times.carry)
        full = tuple(place for place in able if loads[place] == heaviest)
        lighter = tuple((place, loads[place]) for place in able if loads[place] < heaviest)
        usual = longest(trials.usual, able)
        ability = "slower" if found.cycle > SLOWER * usual else "all"
        if lighter:
            ability = "lighter boxes"
        if len(able) < len(places):
            ability = "some places"
        words = (
            f"with {found.settings.text()}, it takes {found.cycle:.1f} s"
            f" for a box of {heaviest if full else max(loads.values()):g} kg instead of {usual:.1f} s,"
            f" to {', '.join(full or able)}"
        )
        if full and lighter:
            words += "; " + ", ".join(f"of {mass:g} kg at most to {place}" for place, mass in lighter)
        if heavy := sorted(set(heavy_at[heaviest]) - set(loads)):
            words += f"; it cannot hold {heaviest:g} kg at {', '.join(heavy)}"
        return Capability(ability, full, f"{why}: {words}", found.settings, found.times, lighter)


def _within_reach(
    trials: Trials, classes: Sequence[float], loads: dict[str, float]
) -> tuple[Rehearsed | None, dict[str, float]]:
    """Settings with which an arm works, and what it brings then: lighter boxes where it leaves its path.

    Args:
        trials: rehearsals of it.
        classes: largest masses of the classes of boxes, the heaviest first, kg.
        loads: the largest masses that its motors can hold at rest, by the place, kg.
    """
    while True:
        found = trials.anew(tuple(loads.items())) if loads else None
        failed = set(loads) - set(() if found is None else found.times.carry)
        lower = {place: [mass for mass in classes if mass < loads[place]] for place in failed}
        if not any(lower.values()):
            return found, loads
        loads = {**loads, **{place: masses[0] for place, masses in lower.items() if masses}}
