"""Gains with which the loop stands commands that act a period late."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from dtwin.bus.twin_messages import Upload
from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.parameters import ArmParameters, Gains, Triple
from dtwin.simulation.margins.demands import DEMANDS, cases
from dtwin.simulation.margins.poses import Pose, places

LATE: Final = 1.0
"""ticks that a late command acts after its own"""
SOFTER: Final = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
"""factors on the speed of the loop that are tried, in this order"""


def late_gains(in_force: Upload, arm: ArmParameters) -> Gains:
    """The gains nearest to those in force with the demanded margins at all places though commands are late.

    A loop that is slower by a factor f has Kp times f^2, Ki times f^3 and Kd times f.

    Args:
        in_force: settings in force.
        arm: arm as it is known.

    Raises:
        ParameterError: no gains have the margins.
    """
    settings = ControlSettings(in_force.target_time, in_force.gains, in_force.law, in_force.model, in_force.payload)
    controller, poses = MotionController(), places()
    for factor in SOFTER:
        tried = replace(settings, gains=_slowed(settings.gains, factor))
        if _has_margins(controller, tried, arm, poses):
            return tried.gains
    raise ParameterError(
        f"late commands: no gains from {SOFTER[-1]:g} times the speed of the loop on have the margins"
    )


def _has_margins(
    controller: MotionController, settings: ControlSettings, arm: ArmParameters, poses: list[Pose]
) -> bool:
    demands = DEMANDS[settings.law]
    return all(demands.shortfall(case.margins) is None for case in cases(controller, settings, arm, poses, LATE))


def _slowed(gains: Gains, factor: float) -> Gains:
    return Gains(_times(factor**2, gains.kp), _times(factor**3, gains.ki), _times(factor, gains.kd))


def _times(factor: float, gains: Triple) -> Triple:
    first, second, third = gains
    return factor * first, factor * second, factor * third
