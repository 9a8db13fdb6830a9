"""What is known of an arm before its motion is looked at: its data sheet, told widely."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from dtwin.arm.chain import Actuator, Array
from dtwin.identification.chain.design import Design
from dtwin.identification.chain.fit import Prior
from dtwin.identification.chain.moments import Moments, layout_of

_WEIGHED: Final = 1e-3
"""Relative standard deviation of a load that was weighed."""
_UNKNOWN_GAIN: Final = 1.0
"""Standard deviation of the logarithm of a gain that nobody knows."""
_WIDE: Final = 10.0
"""Deviation of a basic friction term, in parts of the joint's usual effort."""
_NARROW: Final = 0.3
"""Deviation of any other friction term; a factor of ten to both sides changes the held-out error by a hundredth."""


def prior_of(design: Design, moments: Moments, masses: Mapping[str, float]) -> Prior:
    """The data sheet, told widely: a body's mass may be twice as large, its moments anything of its size.

    Args:
        design: the equations.
        moments: their sums.
        masses: of every load that was weighed, kg, by its name.
    """
    arm, layout = design.arm, moments.layout
    products, count = moments.without(None)
    mean, deviation = np.zeros(layout.size), np.full(layout.size, np.inf)
    mean[: 10 * len(arm)] = arm.parameters
    total = sum(link.mass for link in arm.links)
    reach = max(float(np.linalg.norm(joint.translation)) for joint in arm.joints) or 0.1
    unit = np.array([1.0, *[reach] * 3, *[reach**2] * 6])
    for link, body in enumerate(arm.links):
        deviation[10 * link : 10 * link + 10] = max(body.mass, 0.05 * total) * unit
    for name in layout.loads:
        place = layout.load(name)
        deviation[place] = 0.3 * total * unit
        if name in masses:
            mean[place.start], deviation[place.start] = masses[name], _WEIGHED * masses[name]
    gain, gain_deviation = _gain_prior(design, products, count)
    for joint, groups in enumerate(design.groups):
        place = layout.friction(joint)
        size = np.sqrt(np.diag(products[joint])[place] / count) + 1e-12
        effort = gain[joint] * np.sqrt(products[joint, -1, -1] / count)
        deviation[place] = np.where(np.isin(groups, ("basic", "soft")), _WIDE, _NARROW) * effort / size
    return Prior(mean, deviation, gain, gain_deviation)


def _gain_prior(design: Design, products: Array, count: float) -> tuple[Array, Array]:
    """Gains as the arm's file gives them; where it does not, as the data sheet's masses would have them.

    A torque has its scale, but of a drive with a loop of its own only as far as its stiffness is known.
    """
    actuators = [joint.actuator for joint in design.arm.joints]
    if design.kind == "torque":
        own = [actuator.tolerance if actuator.commanded == "position" else 0.0 for actuator in actuators]
        return np.ones(len(own)), np.array(own)
    constants = [constant_of(actuator, design.kind) for actuator in actuators]
    known = np.array([np.nan if constant is None else constant for constant in constants])
    tolerance = np.array(
        [_UNKNOWN_GAIN if c is None else a.tolerance for a, c in zip(actuators, constants, strict=True)]
    )
    by_weight = np.array([_by_weight(design, products[joint], joint) for joint in range(len(actuators))])
    likely = np.nanmedian(by_weight) if np.isfinite(by_weight).any() else 1.0
    guessed = np.where(np.isfinite(by_weight), by_weight, likely)
    gain = np.where(np.isfinite(known), known, guessed)
    return gain, tolerance


def constant_of(actuator: Actuator, kind: str) -> float | None:
    """Torque per unit of what was logged; that of another quantity says nothing of it."""
    return actuator.constant if actuator.commanded == kind else None


def _by_weight(design: Design, products: Array, joint: int) -> float:
    """The gain by which the effort explains the torque of the data sheet's arm, beside basic friction.

    NaN where it explains next to nothing.
    """
    layout = layout_of(design)
    place = layout.friction(joint)
    basic = place.start + np.flatnonzero(np.array(design.groups[joint]) == "basic")
    inertial = np.zeros(layout.size + 1)
    inertial[: 10 * len(design.arm)] = design.arm.parameters
    directions = np.stack([inertial, *np.eye(layout.size + 1)[basic]])
    normal = directions @ products @ directions.T
    right = directions @ products[:, -1]
    inverse = np.linalg.pinv(normal, rcond=1e-10)
    slope = float((inverse @ right)[0])
    explained = slope**2 / inverse[0, 0] / products[-1, -1]
    return 1.0 / slope if slope > 0.0 and explained > 0.01 else float("nan")
