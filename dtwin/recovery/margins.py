"""Settings with which the loop of an arm that has changed keeps its margins, found on the twin in this process."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from typing import Final

from dtwin.bus.twin_messages import PredictedMotion, Upload
from dtwin.controller.settings import ControlSettings, Law
from dtwin.errors import ParameterError
from dtwin.identification.machine.record import MachineRecord
from dtwin.parameters import ArmParameters, Gains
from dtwin.recovery.strength import Strength
from dtwin.recovery.tuning import STIFFER, Expect, Tuned, search, stiffened, times
from dtwin.simulation.checks import Checker
from dtwin.simulation.proposal import tolerated

LATE: Final = 1.0
"""ticks that a late command acts after its own"""
SOFTER: Final = (1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6, 0.55, 0.5)
"""factors on the speed of the loop that are tried, in this order"""
INTEGRAL: Final = (1.0, 0.8, 0.6)
"""factors on Ki that are tried at each speed: a slower loop of an arm that gravity turns over needs less of it"""


def settings_for_late(
    settings: ControlSettings,
    arm: ArmParameters,
    record: MachineRecord | None,
    heaviest: float,
    strength: Strength,
    expect: Expect,
    reference: Sequence[PredictedMotion],
) -> Tuned:
    """The gains with margins though commands are late, see `gains_with_margins`, and the shortest target time with
    which the arm then tracks as well as the healthy one.

    Args:
        settings: settings of the controller.
        arm: arm as it is known.
        record: record of an arm that does not obey the equations of motion.
        heaviest: mass of the heaviest box, kg.
        strength: what holding the healthy arm takes.
        expect: tells what to expect of settings though commands are late.
        reference: what the healthy arm's motions are expected to be.

    Raises:
        ParameterError: no gains have the margins.
    """
    gains = gains_with_margins(settings, arm, record, LATE)
    return search(arm, heaviest, strength, expect, gains, settings.target_time, reference, stiffer=(1.0,))


def control_settings(upload: Upload, record: MachineRecord | None) -> ControlSettings:
    """Settings in force as settings of a controller: what no upload changes is as the record of the arm proposes."""
    proposed = record.settings if record is not None else None
    usual = ControlSettings() if proposed is None or proposed.refused else proposed.control
    return replace(
        usual,
        target_time=upload.target_time,
        gains=upload.gains,
        law=upload.law,
        model=upload.model,
        payload=upload.payload,
    )


def gains_with_margins(
    settings: ControlSettings,
    arm: ArmParameters,
    record: MachineRecord | None,
    late: float,
    before: Sequence[ControlSettings] = (),
) -> Gains:
    """The gains nearest to those of settings with the margins at all places that uploads to the arm have to keep.

    A loop that is slower by a factor f has Kp times f^2, Ki times f^3 or less, and Kd times f.

    Args:
        settings: settings of the controller, with the model that it is to have.
        arm: arm as it is known.
        record: record of an arm that does not obey the equations of motion.
        late: ticks by which commands act later than they did.
        before: settings with which the gains are in force before, and have to have the margins too.

    Raises:
        ParameterError: no gains have the margins.
    """
    checker = _checker(settings.law, record)
    for speed, integral in product(SOFTER, INTEGRAL):
        gains = _slowed(settings.gains, speed, integral)
        if all(checker.keeps_margins(replace(each, gains=gains), arm, late) for each in (settings, *before)):
            return gains
    raise ParameterError(
        f"no gains have {checker.least(late):.0%} of the margins, down to {SOFTER[-1]:g} times the loop's speed"
        f"{', though commands are late' if late else ''}"
    )


def stiffer_with_margins(
    settings: ControlSettings, arm: ArmParameters, record: MachineRecord | None, late: float
) -> tuple[float, ...]:
    """The factors of STIFFER with which settings have the margins; 1 is among them in any case.

    Args:
        settings: settings of the controller, with the model and the payload that it is to have.
        arm: arm as it is known.
        record: record of an arm that does not obey the equations of motion.
        late: ticks by which commands act later than they did.
    """
    checker = _checker(settings.law, record)
    tried = {factor: replace(settings, gains=stiffened(settings.gains, factor)) for factor in STIFFER[1:]}
    return STIFFER[:1] + tuple(f for f, each in tried.items() if checker.keeps_margins(each, arm, late))


def _checker(law: Law, record: MachineRecord | None) -> Checker:
    """A checker that asks for the margins that uploads to the arm have to keep."""
    if record is None:
        return Checker()
    checker = Checker(effects=record.effects)
    tolerated(record, law, checker)
    return checker


def _slowed(gains: Gains, speed: float, integral: float) -> Gains:
    return Gains(times(speed**2, gains.kp), times(integral * speed**3, gains.ki), times(speed, gains.kd))
