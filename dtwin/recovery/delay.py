"""Settings with which the loop stands commands that act a period late, found on the twin in this process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

from dtwin.bus.twin_messages import PredictedMotion, Upload
from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError
from dtwin.parameters import ArmParameters, Gains
from dtwin.recovery.tuning import Tuned, search, times
from dtwin.simulation.checks import MOTIONS, motion_case
from dtwin.simulation.margins.demands import DEMANDS, cases
from dtwin.simulation.margins.loop import lateness, later
from dtwin.simulation.margins.poses import places
from dtwin.simulation.whatif import Simulator
from dtwin.twin.effects import Effects

LATE: Final = 1.0
"""ticks that a late command acts after its own"""
SOFTER: Final = (1.0, 0.9, 0.8, 0.7, 0.6, 0.5)
"""factors on the speed of the loop that are tried, in this order"""


def settings_for_late(
    in_force: Upload,
    arm: ArmParameters,
    effects: Effects,
    boxes: Sequence[float],
    reference: Sequence[PredictedMotion],
) -> Tuned:
    """The gains nearest to those in force with the demanded margins at all places though commands are late, and the
    shortest target time with which the arm then tracks as well as the healthy one.

    Args:
        in_force: settings in force.
        arm: arm as it is known.
        effects: what it had beside its parameters before commands came late.
        boxes: masses of the boxes, kg.
        reference: what the healthy arm's motions are expected to be.

    Raises:
        ParameterError: no gains have the margins.
    """
    settings = ControlSettings(in_force.target_time, in_force.gains, in_force.law, in_force.model, in_force.payload)
    simulator, late = Simulator(), later(effects, LATE)
    gains = _with_margins(simulator, settings, arm, late)

    def expect(gains: Gains, target_time: float) -> list[PredictedMotion]:
        return _expect(simulator, replace(settings, gains=gains, target_time=target_time), arm, late, boxes)

    return search(arm, max(boxes), expect, gains, settings.target_time, reference, stiffer=(1.0,))


def _with_margins(simulator: Simulator, settings: ControlSettings, arm: ArmParameters, late: Effects) -> Gains:
    """A loop that is slower by a factor f has Kp times f^2, Ki times f^3 and Kd times f."""
    demands = DEMANDS[settings.law]
    for factor in SOFTER:
        tried = replace(settings, gains=_slowed(settings.gains, factor))
        found = cases(simulator.controller, tried, arm, places(), lateness(late), late)
        if all(demands.shortfall(case.margins) is None for case in found):
            return tried.gains
    raise ParameterError(f"late commands: no gains have the margins, down to {SOFTER[-1]:g} times the loop's speed")


def _expect(
    simulator: Simulator, settings: ControlSettings, arm: ArmParameters, late: Effects, boxes: Sequence[float]
) -> list[PredictedMotion]:
    found = []
    for box in boxes:
        for motion in MOTIONS:
            f = simulator.run(motion_case(motion, settings, arm, box, effects=late)).figures
            found.append(PredictedMotion(*motion, f.tracking_rms, f.tracking_max, f.peak_volts, f.saturated))
    return found


def _slowed(gains: Gains, factor: float) -> Gains:
    return Gains(times(factor**2, gains.kp), times(factor**3, gains.ki), times(factor, gains.kd))
