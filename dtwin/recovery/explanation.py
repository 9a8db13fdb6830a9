"""Whether what the monitor has found explains that the blocks have stopped the arm by themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import msgspec

from dtwin.bus.twin_messages import MonitoredUnit, PredictedMotion
from dtwin.monitoring.kinds import RELATIVE, SUPPLY, parse_fault_id, reference
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, scaled, symbol_of
from dtwin.recovery.tuning import Ability
from dtwin.simulation.checks import TAIL

FOLLOWING: Final = 0.5
"""Distance from its path for which the block SAFE_STOP stops a joint, rad: its input FOLLOWING_LIMIT."""
CUT_OFF: Final = 0.25
"""Time for which a voltage may be at its limit until that block stops the arm, s: its input SATURATION_LIMIT."""
SURE: Final = 2.0
"""Standard deviations by which a change may be smaller than the monitor estimates it."""

TOO_WEAK: Final[dict[Ability, str]] = {
    "without a box": "the arm can work without a box only",
    "not at all": "the arm cannot keep to its paths any more",
}
"""What an arm can still do that no settings let work as before."""


class TooWeak(Exception):
    """Reports that no settings let the arm do its work; the message says what it can still do."""


class Outlook(NamedTuple):
    """What an arm can do that has changed as was found.

    Attributes:
        text: the same for people.
        weak: whether it cannot hold its boxes somewhere, also if it has changed less, by SURE.
    """

    text: str
    weak: bool = False


def certain(found: Sequence[MonitoredUnit]) -> list[MonitoredUnit]:
    """Findings with the part of their sizes that is there for sure."""
    share = (max(1.0 - SURE * unit.deviation / abs(unit.size), 0.0) if unit.size else 0.0 for unit in found)
    return [msgspec.structs.replace(unit, size=part * unit.size) for unit, part in zip(found, share, strict=True)]


def changing(found: MonitoredUnit) -> list[str]:
    """The parameters of the arm that a finding is about; none for one about anything else, such as an encoder."""
    if found.parameter == SUPPLY:
        return [name for name in PARAMETER_NAMES if symbol_of(name) == "K"]
    return [found.parameter] if found.parameter in PARAMETER_NAMES else []


def changed(arm: ArmParameters, healthy: ArmParameters, found: Sequence[MonitoredUnit]) -> ArmParameters:
    """The arm with the changes of its parameters that were found, as the monitor estimates them.

    Args:
        arm: arm as it was before.
        healthy: arm as it was identified, in whose parts relative changes are told.
        found: settled findings.
    """
    values, voltage = {}, 1.0
    for unit in found:
        name = unit.parameter
        if name == SUPPLY:
            voltage = 1.0 + unit.size
        elif changing(unit):
            size = unit.size * (reference(name, healthy) if parse_fault_id(name).about.unit == RELATIVE else 1.0)
            values[name] = max(arm.get(name) + size, 0.0)
    return scaled(arm.with_values(values), "K", voltage)


def knowing(model: ArmParameters, before: ArmParameters, arm: ArmParameters) -> ArmParameters:
    """A controller's model of an arm as it was before, with what has changed of the arm."""
    return model.with_values({name: arm.get(name) for name in PARAMETER_NAMES if arm.get(name) != before.get(name)})


def stopping(expected: Sequence[PredictedMotion], target_time: float) -> list[PredictedMotion]:
    """Those of some motions for which the blocks would stop the arm.

    Args:
        expected: motions on the twin.
        target_time: their duration, s.
    """
    share = CUT_OFF / (target_time + TAIL)
    return [motion for motion in expected if max(motion.tracking) > FOLLOWING or motion.saturated > share]
