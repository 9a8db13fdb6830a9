"""Rehearsals of the cell of a station: how long its arm takes, and settings with which a changed arm still works.

Only what a twin knows is rehearsed: the arm that the controller believes in, or what the monitor has found of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Final, NamedTuple

import numpy as np

from dtwin.arm.chain import Array
from dtwin.bus.line.plant import ArmSettings, Settings
from dtwin.controller.bounds import check_model
from dtwin.errors import ParameterError
from dtwin.line.line import Load, StationPlan
from dtwin.line.station import FREE, EmulatedStation, Station, WorkTimes, believed_settings
from dtwin.line.stations import rehearsal
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, ArmParameters
from dtwin.recovery.tuning import SATURATED, SLOWER
from dtwin.signals import EventKind

AWAY: Final = 0.05
"""Distance of a joint from its path from which on an arm does not follow it, rad."""
_PATIENCE: Final = 3000
"""Longest wait of a rehearsal for a box, ticks."""
_START: Final = 500
"""Ticks in which an arm comes from where it hangs to where boxes wait."""
_FULL: Final = 0.999 * VOLTAGE_LIMIT
"""Voltage that counts as the limit, V."""


class Round(NamedTuple):
    """How long it took until a box was gripped, from then until it was there, and until the arm was back, s."""

    grip: float
    carry: float
    back: float


@dataclass(frozen=True, slots=True)
class Rehearsed:
    """Settings with which an arm works.

    Attributes:
        settings: the settings.
        times: how long it takes then, to the places to which it can bring boxes.
    """

    settings: Settings
    times: WorkTimes

    @property
    def cycle(self) -> float:
        """Longest time from the offer of a box until the arm waits for the next one, s."""
        return longest(self.times, tuple(self.times.carry))


def longest(times: WorkTimes, places: Sequence[str]) -> float:
    """Longest time from the offer of a box for one of some places until the arm waits for the next one, s."""
    return max(times.grip + times.carry[place] + times.back[place] for place in places)


def rehearsed(plan: StationPlan, usual: tuple[float, ...] = ()) -> WorkTimes:
    """How long the arm of a station takes.

    It is measured in a run of its cell with the arm that the controller believes in.

    Args:
        plan: the station.
        usual: mean masses of the boxes of each class, kg; empty for the usual box of its cell.

    Raises:
        DtwinError: the cell cannot be, or its arm brings no box to a place.
    """
    return _rehearsed(known_of(plan), usual)[0]


def expected_deviation(plan: StationPlan, usual: tuple[float, ...] = ()) -> Array:
    """How far each joint of the arm of a station is from its path at most while nothing is wrong with it, (3,), rad.

    It is measured in the run in which `rehearsed` measures its times.

    Args:
        plan: the station, with the thesis's arm.
        usual: mean masses of the boxes of each class, kg; empty for the usual box of its cell.

    Raises:
        DtwinError: the cell cannot be, or its arm brings no box to a place.
    """
    return np.array(_rehearsed(known_of(plan), usual)[1])


def rehearsed_anew(
    plan: StationPlan, arm: ArmParameters, usual: tuple[float, ...], loads: tuple[Load, ...]
) -> Rehearsed | None:
    """The shortest target time at which a changed arm works, with a model of it in its controller.

    It works where it brings its heaviest box to its place without leaving its path, with voltages that are seldom at
    their limit. If no target time lets it reach all places, the shortest with most of them is taken.

    Args:
        plan: the station.
        arm: its arm as it was found to be.
        usual: mean masses of the boxes of each class, kg.
        loads: the places that matter, and the mass of the heaviest box there, kg.

    Returns:
        None where it works with no settings at any place.
    """
    try:
        check_model(arm)
    except ParameterError:
        return None
    return _rehearsed_anew(known_of(plan), arm, usual, loads)


def known_of(plan: StationPlan) -> StationPlan:
    """The same plan for all stations that are alike but for what the twin does not know or need."""
    return replace(plan, name="", node="", operations=(), machine=None, seed=0, faults=())


@lru_cache(maxsize=256)
def _rehearsed(plan: StationPlan, usual: tuple[float, ...]) -> tuple[WorkTimes, tuple[float, ...]]:
    station, places, middle = rehearsal(plan)
    station.advance(_START)
    rounds = {}
    for place in places:
        for kind, mass in enumerate(usual or (middle,)):
            done = _round(station, place, mass)
            if done is None:
                raise ParameterError(
                    f"station {plan.cell_file or 'default'}: its arm brings no box of {mass:g} kg to {place}"
                )
            rounds[place, kind] = done
            station.advance(_START)
    times = times_of({place: rounds[place, 0] for place in places})
    assert times is not None
    away = tuple(_deviation(station).tolist()) if isinstance(station, EmulatedStation) else ()
    return replace(times, classes=_classes(rounds)), away


def _deviation(station: EmulatedStation) -> Array:
    """How far each joint was from its path at most since the arm had come to where boxes wait, (3,), rad."""
    seen = station.log.since(_START)
    return np.asarray(np.abs(seen.stack("target") - seen.stack("measured")).max(axis=0))


def _classes(rounds: Mapping[tuple[str, int], Round]) -> dict[tuple[str, int], float]:
    """How long a box is carried, by the place and the number of its class, s."""
    return {each: done.carry for each, done in rounds.items()}


def with_classes(
    times: WorkTimes, usual: Sequence[float], loads: Sequence[Load], bring: Callable[[Load], Round | None]
) -> WorkTimes:
    """The same times with those of usual boxes of each class, up to the load of a place.

    Args:
        times: how long work takes with the loads.
        usual: mean masses of the boxes of each class, kg.
        loads: the largest mass for each place, kg.
        bring: gives a round with a mass to a place; None where it does not succeed.
    """
    tried = {
        (place, kind): bring((place, mass))
        for place, most in loads
        for kind, mass in enumerate(usual)
        if place in times.carry and mass <= most
    }
    return replace(times, classes=_classes({each: done for each, done in tried.items() if done is not None}))


@lru_cache(maxsize=256)
def _rehearsed_anew(
    plan: StationPlan, arm: ArmParameters, usual: tuple[float, ...], loads: tuple[Load, ...]
) -> Rehearsed | None:
    target_time = believed_settings(plan).control.target_time
    best: tuple[ArmSettings, WorkTimes] | None = None
    for slower in SLOWER:
        settings = ArmSettings(slower * target_time, arm)
        times = times_of({load[0]: _followed(plan, settings, load) for load in loads})
        if times is not None and (best is None or len(times.carry) > len(best[1].carry)):
            best = settings, times
        if times is not None and len(times.carry) == len(loads):
            break
    if best is None:
        return None
    settings, times = best
    return Rehearsed(settings, with_classes(times, usual, loads, partial(_followed, plan, settings)))


def times_of(rounds: Mapping[str, Round | None]) -> WorkTimes | None:
    """How long work takes, from rounds to places by their names; None if none of them succeeded."""
    able = {place: each for place, each in rounds.items() if each is not None}
    if not able:
        return None
    return WorkTimes(
        max(each.grip for each in able.values()),
        {place: each.carry for place, each in able.items()},
        {place: each.back for place, each in able.items()},
    )


def _followed(plan: StationPlan, settings: ArmSettings, load: Load) -> Round | None:
    """A round of a changed arm within its limits; None if it leaves them."""
    usual = believed_settings(plan)
    control = replace(usual.control, target_time=settings.target_time, model=settings.model)
    station = EmulatedStation(plan, replace(usual, arm=settings.model, control=control))
    found = first_round(station, *load)
    seen = station.log.since(_START)
    away = _deviation(station).max()
    full = (np.abs(seen.stack("volts")[:, :3]) >= _FULL).any(axis=1).mean()
    return found if away <= AWAY and full <= SATURATED else None


def first_round(station: Station, place: str, mass: float) -> Round | None:
    """A round of the arm of a station that has just begun, to a place with a box of a mass (kg)."""
    station.advance(_START)
    return _round(station, place, mass)


def _round(station: Station, place: str, mass: float) -> Round | None:
    """A round to a place; None if the arm does not bring the box there, or the next one."""
    first = _brings(station, place, mass)
    again = None if first is None else _brings(station, place, mass)
    if first is None or again is None:
        return None
    return Round(first[0], first[1], again[0] + PERIOD - first[0])


def _brings(station: Station, place: str, mass: float) -> tuple[float, float] | None:
    """How long it takes until a box that is brought now is picked, and from then until it is delivered, s."""
    station.give("bring", mass, place)
    picked = 0.0
    for tick in range(1, _PATIENCE + 1):
        report = station.advance(1)
        kinds = [event.kind for event in report.events]
        if EventKind.PICKED in kinds:
            picked = PERIOD * (tick - 1)
        if report.stop or EventKind.MISPLACED in kinds or EventKind.SLIPPED in kinds:
            return None
        if report.arm == FREE and EventKind.DELIVERED in kinds:
            return picked, PERIOD * (tick - 1) - picked
    return None
