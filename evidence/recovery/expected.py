"""What the right answer to a fault is, and what can come of it, by what is known of the fault itself."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple

from dtwin.bus.twin_messages import PredictedMotion
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.faults import Fault, schedule
from dtwin.emulation.machine.sections import IDEAL, Machine
from dtwin.errors import FaultError, ParameterError, choices
from dtwin.identification.machine.record import MachineRecord
from dtwin.monitoring.kinds import NAMED, UNKNOWN
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, Gains, scaled, symbol_of
from dtwin.recovery.answers import ANSWERS, Measure
from dtwin.recovery.margins import LATE, gains_with_margins, settings_for_late, stiffer_with_margins
from dtwin.recovery.strength import Strength, usual_boxes
from dtwin.recovery.tuning import BOUND, Ability, search
from dtwin.simulation.checks import Checker
from dtwin.simulation.proposal import with_rotors
from dtwin.task import DEFAULT_TASK
from dtwin.twin.effects import EFFECT_NAMES, NO_EFFECTS, Effects
from evidence.identification.strangers import truth_of

_HIDDEN: Final = ("pads",)
"""Targets of faults of the gripper of which the monitor has no kind."""


class Expected(NamedTuple):
    """The right answer.

    Attributes:
        measures: all measures to be taken.
        ability: how the arm can work then; None if it stands.
        distance: least distance from its paths that settings with margins can leave, relative to the healthy arm's.
    """

    measures: frozenset[Measure]
    ability: Ability | None
    distance: float = 1.0


_STOP: Final = Expected(frozenset({"stop"}), None)


def kind_of(fault: Fault) -> str:
    """The kind in the table of answers that a fault is of.

    Raises:
        FaultError: the table has no answer to it.
    """
    if fault.target in _HIDDEN:
        raise FaultError(f"fault {fault.target}: expected one that the monitor can name, not {choices(_HIDDEN)}")
    target = NAMED.get(fault.target, fault.target)
    kind = symbol_of(target) if target in PARAMETER_NAMES else target.rstrip("123")
    return kind if kind in ANSWERS else UNKNOWN


def expected_of(
    faults: Sequence[Fault],
    arm: ArmParameters,
    settings: ControlSettings,
    effects: Effects = NO_EFFECTS,
    via: bool = False,
    record: MachineRecord | None = None,
) -> Expected:
    """The right answer to faults, which begin at once.

    An arm that gains with margins keep within BOUND is expected to track as the healthy one does.

    Args:
        faults: the faults.
        arm: the healthy arm.
        settings: settings of the controller before them.
        effects: what the arm has beside its parameters.
        via: whether the arm moves over points that keep clear of bodies.
        record: what is known of the healthy arm, which says what margins have to be kept.
    """
    measures = frozenset(ANSWERS[kind_of(fault)].measure for fault in faults)
    if "stop" in measures:
        return _STOP
    condition, checker = schedule(arm, faults)[0].condition, Checker(effects=effects, via=via)
    now = scaled(condition.parameters, "K", condition.supply)
    boxes = usual_boxes(DEFAULT_TASK)
    masses = [condition.payload(mass) for mass in boxes]
    known = replace(settings, model=with_rotors(now, effects), payload=masses[0])
    reference, strength = _expect(checker, settings, arm, boxes), Strength.of(arm, max(boxes))

    def expect(gains: Gains, target_time: float, late: float = 0.0) -> list[PredictedMotion]:
        tried = replace(known, gains=gains, target_time=target_time)
        return _expect(checker, tried, now, masses, late)

    try:
        gains = gains_with_margins(known, now, record, 0.0)
        stiffer = stiffer_with_margins(known, now, record, 0.0) if gains == known.gains else (1.0,)
        tuned = search(now, max(masses), strength, expect, gains, settings.target_time, reference, stiffer)
        found = tuned
        if tuned.works and condition.late:
            expect_late = partial(expect, late=LATE)
            found = settings_for_late(settings, now, record, max(masses), strength, expect_late, reference)
    except ParameterError:
        return _STOP
    if not (tuned.works and found.works):
        return _STOP
    as_healthy = found.ratio <= (1.0 if condition.late else BOUND)
    return Expected(measures, tuned.ability, 1.0 if as_healthy else found.ratio)


def made_of(machine: Machine, nominal: ArmParameters) -> tuple[ArmParameters, Effects]:
    """What a machine is in truth, in the terms of the twin, as far as it has them."""
    if machine == IDEAL:
        return nominal, NO_EFFECTS
    values = truth_of(machine, nominal)
    arm = nominal.with_values({name: values[name] for name in PARAMETER_NAMES})
    return arm, NO_EFFECTS.with_values({name: values[name] for name in EFFECT_NAMES})


def _expect(
    checker: Checker, settings: ControlSettings, arm: ArmParameters, boxes: Iterable[float], late: float = 0.0
) -> list[PredictedMotion]:
    return [
        PredictedMotion(*motion, f.tracking_rms, f.tracking_max, f.peak_volts, f.saturated)
        for box in boxes
        for motion, f in checker.expect(settings, arm, box, late)
    ]
