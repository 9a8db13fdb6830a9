"""What settings for the blocks of an arm must pass: bounds, stable loops, and the arm's own motion on the twin."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm
from dtwin.arm.model import USUAL_OBSERVER, USUAL_POLE, ArmModel, ArmSettings, ArmTuning
from dtwin.arm.modelled import problem_of, with_model
from dtwin.arm.poses import Poses
from dtwin.emulation.chain.machine import NOMINAL, machine_of
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import ParameterError
from dtwin.run.chain import ChainSettings, run
from dtwin.run.margins.chain import margins

MOST_INERTIA: Final = 3.0
"""Largest and, inverted, least usual inertia of a joint, in parts of the data sheet's."""
TRIED: Final = 8.0
"""Length of the motion on the twin, s."""
SATURATED: Final = 0.05
"""Longest time in it in which a drive may be at its limit, s."""
POLES: Final = (1.0, 60.0)
"""Least and largest triple pole of the errors, rad/s."""
OBSERVERS: Final = (10.0, 500.0)
"""Least and largest pole of the observers, rad/s."""
SLOWEST: Final = 0.1
"""Least speed of paths, in parts of the data sheet's."""
Values = tuple[float, ...]
_POSES: Final = 4
"""Poses at which the loops are looked at."""


@lru_cache(maxsize=16)
def check_model(arm: Arm, model: ArmModel) -> Arm:
    """The arm with a model that lies within all bounds around its data sheet; the same one for equal models.

    Args:
        arm: the arm as its data sheet says.
        model: the model.

    Raises:
        ParameterError: the blocks must not reckon with it; the message says which value and why.
    """
    if problem := problem_of(arm, model):
        raise ParameterError(f"model: {problem}")
    made = with_model(arm, model)
    for number, share in enumerate(usual_inertia(made) / usual_inertia(arm), 1):
        if not 1.0 / MOST_INERTIA <= share <= MOST_INERTIA:
            raise ParameterError(
                f"model: inertia at joint {number}: expected {1.0 / MOST_INERTIA:.3g} to {MOST_INERTIA:g} times the "
                f"data sheet's, got {share:.3g}"
            )
    return made


def tuning_problem(arm: Arm, poses: Poses, tuning: ArmTuning) -> str:
    """Why the blocks of an arm must not have a tuning, "" if they may.

    Args:
        arm: the arm as its data sheet says.
        poses: what it does.
        tuning: the tuning.
    """
    for name, value, (low, high), unit in (
        ("pole", tuning.pole, POLES, "rad/s"),
        ("observer", tuning.observer, OBSERVERS, "rad/s"),
        ("speed", tuning.speed, (SLOWEST, 1.0), "of the data sheet's, which no path may exceed"),
    ):
        if not low <= value <= high:  # which a NaN is not, either
            return f"{name}: expected {low:g} to {high:g} {unit}, got {value:g}"
    if arm.servos and (tuning.pole, tuning.observer) != (USUAL_POLE, USUAL_OBSERVER):
        return f"pole, observer: the drive of {arm.servos[0]} has a loop of its own: expected a speed alone"
    if poses.spacing > 0.0 and tuning.speed != 1.0:
        return f"speed: the path is followed in the time that its file says: expected 1, got {tuning.speed:g}"
    return ""


def check_settings(settings: ChainSettings, wished: ArmSettings) -> Arm:
    """The arm with the model of settings that lie within all bounds.

    Args:
        settings: the run of the cell.
        wished: model and tuning.

    Raises:
        ParameterError: the blocks must not have them; the message says which value and why.
    """
    if problem := tuning_problem(settings.arm, settings.poses, wished.tuning):
        raise ParameterError(f"tuning: {problem}")
    return check_model(settings.arm, wished.model)


def expected_tracking(settings: ChainSettings, wished: ArmSettings) -> Values:
    """The largest distance of each joint from its path under blocks with other settings, (n,), rad or m.

    The twin has their model and does what the arm has to do, for `TRIED` seconds, with the friction and the encoders
    of the data sheet. Drives with loops of their own are tried in that motion alone.

    Args:
        settings: the run of the cell.
        wished: model and tuning.

    Raises:
        ParameterError: they are out of bounds, or the arm would not do its work with them.
    """
    arm, control = check_settings(settings, wished), settings.control.tuned(wished.tuning)
    loops = () if arm.servos else zip(arm.joints, margins(arm, control, _POSES, late=settings.late), strict=True)
    for joint, one in loops:
        if not one.stable:
            raise ParameterError(f"settings: the loop of {joint.name} would not be stable")
    machine = machine_of(NOMINAL, arm)
    ran = run(replace(settings, arm=arm, machine=machine, control=control, faults=(), duration=TRIED))
    if ran.stop:
        raise ParameterError("settings: on the twin the blocks stop the arm")
    for joint, ticks in zip(arm.joints, ran.saturated, strict=True):
        if ticks * arm.period > SATURATED:
            raise ParameterError(
                f"settings: on the twin the drive of {joint.name} is at its limit for {ticks * arm.period:.2f} of "
                f"{TRIED:g} s, expected at most {SATURATED:g} s"
            )
    return tuple(map(float, np.abs(ran.error).max(axis=0)))


def as_before(expected: Values, now: Values, measured: Values) -> Values:
    """What is expected of an arm that is farther from its path than its twin, as far as it is under what is in force.

    Other gains and speeds change neither the arm nor what the blocks do not know of it. Distances from the path are
    nearly linear in that, so that their ratio to the twin's stays.

    Args:
        expected: the twin's largest distance of each joint from its path under other gains and speeds, (n,).
        now: the same under those in force, (n,).
        measured: what the arm had under those, (n,).
    """
    return tuple(x * max(1.0, m / n) if n > 0.0 else x for x, n, m in zip(expected, now, measured, strict=True))
