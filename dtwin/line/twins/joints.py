"""Rehearsals of the cell of another arm that has changed: settings with which it works, and how long that takes.

What a finding says of it is put into an arm of the data sheet, with its friction and its encoders, whose blocks count
on the same. Its paths are slowed down until its drives can follow them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache, partial
from typing import Final

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.model import ArmTuning
from dtwin.bus.line.plant import JointSettings
from dtwin.emulation.chain.faults import ChainFault
from dtwin.line.chain.cell import believed_arm, check_joint_settings
from dtwin.line.chain.station import ChainStation
from dtwin.line.line import Load, StationPlan
from dtwin.line.station import WorkTimes, settings_text
from dtwin.line.twins.rehearsal import AWAY, Rehearsed, Round, first_round, known_of, times_of, with_classes
from dtwin.recovery.tuning import BOUND, SATURATED, SLOWER
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.checks import SLOWEST

_SINCE: Final = 5.0
"""Time after which the path counts, s: by then the arm stands where boxes wait."""


def joints_rehearsed(
    plan: StationPlan, adjustment: Adjustment, usual: tuple[float, ...], loads: tuple[Load, ...]
) -> Rehearsed | None:
    """The fastest settings at which an arm works of which something is known beside its data sheet.

    It works where it brings its heaviest box to its place, no farther from its path than AWAY or a healthy arm, with
    drives that are seldom at their limit. If no speed lets it reach all places, the fastest with most of them is
    taken.

    Args:
        plan: the station.
        adjustment: what was found of it, on which its blocks count.
        usual: mean masses of the boxes of each class, kg.
        loads: the places that matter, and the mass of the heaviest box there, kg.

    Returns:
        None where it works with no settings at any place.

    Raises:
        ParameterError: its blocks must not count on that.
    """
    return _rehearsed(known_of(plan), adjustment, usual, loads)


@lru_cache(maxsize=256)
def _rehearsed(
    plan: StationPlan, adjustment: Adjustment, usual: tuple[float, ...], loads: tuple[Load, ...]
) -> Rehearsed | None:
    believed = believed_arm(plan)
    best: tuple[JointSettings, WorkTimes] | None = None
    assert believed is not None
    tuning = believed.control.tuning
    for slower in SLOWER:
        settings = JointSettings(replace(tuning, speed=tuning.speed / slower), adjustment)
        if settings.tuning.speed < SLOWEST:
            break
        check_joint_settings(believed, settings)
        times = times_of({load[0]: _followed(plan, believed, settings, load) for load in loads})
        if times is not None and (best is None or len(times.carry) > len(best[1].carry)):
            best = settings, times
        if times is not None and len(times.carry) == len(loads):
            break
    if best is None:
        return None
    settings, times = best
    bring = partial(_followed, plan, believed, settings)
    return Rehearsed(settings, with_classes(times, usual, loads, bring))


@lru_cache(maxsize=256)
def _away(plan: StationPlan, tuning: ArmTuning, load: Load) -> float:
    """How far a healthy arm is from its path in a round, rad or m."""
    believed = believed_arm(plan)
    assert believed is not None
    return _tried(believed, JointSettings(tuning, Adjustment.none(len(believed.arm))), load)[1]


def _followed(plan: StationPlan, believed: ChainSettings, settings: JointSettings, load: Load) -> Round | None:
    """A round of a changed arm within its limits; None if it leaves them."""
    found, away, full = _tried(believed, settings, load)
    usual = _away(plan, settings.tuning, load)
    return found if away <= max(AWAY, BOUND * usual) and full <= SATURATED else None


def _tried(believed: ChainSettings, settings: JointSettings, load: Load) -> tuple[Round | None, float, float]:
    """A round of an arm, its largest distance from its path (rad or m), and the share of ticks at a drive's limit."""
    station = ChainStation(replace(believed, faults=tuple(_faults(settings.adjustment))))
    station.give("settings", text=settings_text(settings))
    found = first_round(station, *load)
    run = station.log.run()
    counted = run.t >= _SINCE
    away = np.abs(run.target - run.true)[counted].max(initial=0.0)
    return found, float(away), float(run.at_limit[counted].any(axis=1).mean()) if counted.any() else 0.0


def _faults(adjustment: Adjustment) -> Iterator[ChainFault]:
    """What is otherwise than the data sheet says of an arm of which something was found."""
    for joint, (offset, strength, friction) in enumerate(
        zip(adjustment.offset, adjustment.strength, adjustment.friction, strict=True)
    ):
        if offset:
            yield ChainFault("bias", joint, offset, 0.0)
        if strength != 1.0:
            yield ChainFault("K", joint, strength, 0.0)
        if friction != 1.0:
            yield ChainFault("friction", joint, friction, 0.0)
    if adjustment.load:
        yield ChainFault("load", 0, adjustment.load, 0.0)
