"""What a model for the blocks of an arm must pass: bounds, stable loops, and the arm's own motion on the twin."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm
from dtwin.arm.model import ArmModel
from dtwin.arm.modelled import problem_of, with_model
from dtwin.emulation.chain.machine import NOMINAL, machine_of
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import ParameterError
from dtwin.run.chain import ChainSettings, run
from dtwin.simulation.margins.chain import margins

MOST_INERTIA: Final = 3.0
"""Largest and, inverted, least usual inertia of a joint, in parts of the data sheet's."""
TRIED: Final = 8.0
"""Length of the motion on the twin, s."""
SATURATED: Final = 0.05
"""Longest time in it in which a drive may be at its limit, s."""
_POSES: Final = 4
"""Poses at which the loops are looked at."""


def check_model(arm: Arm, model: ArmModel) -> Arm:
    """The arm with a model that lies within all bounds around its data sheet.

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


def expected_tracking(settings: ChainSettings, model: ArmModel) -> tuple[float, ...]:
    """The largest distance of each joint from its path where arm and blocks have a model, (n,), rad or m.

    The twin does what the arm has to do, for `TRIED` seconds, with the friction and the encoders of the data sheet.

    Args:
        settings: the run of the cell.
        model: the model.

    Raises:
        ParameterError: it is out of bounds, or the arm would not do its work with it.
    """
    arm = check_model(settings.arm, model)
    for joint, one in zip(arm.joints, margins(arm, settings.control, _POSES, late=settings.late), strict=True):
        if not one.stable:
            raise ParameterError(f"model: the loop of {joint.name} would not be stable")
    ran = run(replace(settings, arm=arm, machine=machine_of(NOMINAL, arm), faults=(), duration=TRIED))
    if ran.stop:
        raise ParameterError("model: on the twin the blocks stop the arm")
    for joint, ticks in zip(arm.joints, ran.saturated, strict=True):
        if ticks * arm.period > SATURATED:
            raise ParameterError(
                f"model: on the twin the drive of {joint.name} is at its limit for {ticks * arm.period:.2f} of "
                f"{TRIED:g} s, expected at most {SATURATED:g} s"
            )
    return tuple(map(float, np.abs(ran.error).max(axis=0)))
