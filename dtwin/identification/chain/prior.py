"""What is known of an arm before its motion is looked at: its data sheet with its tolerances, or told widely.

Where nobody says how far arms differ from their model files, these may be far off. So the data say how many times the
tolerances the arm is away from the data sheet, by how likely they are then (empirical Bayes), or that a body may be
anything of its size.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from dtwin.arm.chain import Actuator, Array, Link, Tolerances
from dtwin.identification.chain.design import Design
from dtwin.identification.chain.fit import Prior, fit, likelihood
from dtwin.identification.chain.intervals import inverse
from dtwin.identification.chain.moments import Moments, layout_of

_WEIGHED: Final = 1e-3
"""Relative standard deviation of a load that was weighed."""
_UNKNOWN_GAIN: Final = 1.0
"""Standard deviation of the logarithm of a gain that nobody knows."""
_WIDE: Final = 10.0
"""Deviation of a basic friction term, in parts of the joint's usual effort."""
_NARROW: Final = 0.3
"""Deviation of any other friction term; a factor of ten to both sides changes the held-out error by a hundredth."""
USUAL: Final = 1.0
_SPREADS: Final = (USUAL, 2.0, 4.0, 8.0, 16.0)
"""How far an arm may be from its data sheet, in parts of its tolerances."""
_SURE: Final = 2.0
"""What the logarithm of the likelihood has to rise by for each parameter of the bodies until a data sheet is not
believed: 1 at most in six-axis arms drawn from their tolerances, 4 or more where the sheet is five times as far off
(`dtwin experiment synthetic`, 900 to 903)."""
_ROTOR: Final = 0.05
"""Relative standard deviation of a rotor's inertia beside that of the drive's constant; files give it as exact."""
_OFFSET: Final = 0.01
"""Standard deviation of a drive's offset, in parts of its largest torque, as the monitor has it."""
_ONE_WAY: Final = 0.15
"""By how much friction may be more in one direction, in parts of what it may be more in both."""
_TURNING: Final = 3.0
"""Deviation of friction by load that turns over at a speed, in parts of the data sheet's; other forms have 1."""
_APART: Final = 0.5
"""By how much entries of an inertia may differ each by itself, in parts of what all may differ together."""
_LEAST: Final = 1e-4
"""Least standard deviation of a parameter of a body, in parts of the body's size, for tolerances of 0."""


def likeliest(
    design: Design, moments: Moments, masses: Mapping[str, float], used: Array
) -> tuple[float | None, Prior]:
    """How far the arm is from its data sheet, in parts of its tolerances, and the prior that says so.

    Args:
        design: the equations.
        moments: their sums.
        masses: of every load that was weighed, kg, by its name.
        used: which unknowns are estimated, (size,).

    Returns:
        None and the wide prior where the data are likelier with that. The data sheet is believed unless the data are
        far likelier without it: a form of friction that no term has looks a little like other bodies.
    """
    priors = {spread: prior_of(design, moments, masses, spread) for spread in (*_SPREADS, None)}
    best: float | None = USUAL
    likely: dict[float | None, float] = {}
    for spread, prior in priors.items():
        likely[spread] = likelihood(moments, prior, fit(moments, prior, used))
        if likely[spread] < likely[best]:
            break
        best = spread
    if likely[best] < likely[USUAL] + _SURE * 10 * len(design.arm):
        best = USUAL
    return best, priors[best]


def prior_of(design: Design, moments: Moments, masses: Mapping[str, float], spread: float | None = None) -> Prior:
    """What is known of everything that is estimated.

    Args:
        design: the equations.
        moments: their sums.
        masses: of every load that was weighed, kg, by its name.
        spread: how far the arm may be from its data sheet, in parts of its tolerances; None tells it widely: a body's
            mass may be twice as large, its moments anything of its size, and friction as large as the effort.
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
    bodies = None
    if spread is not None:
        bodies = np.zeros((10 * len(arm), 10 * len(arm)))
        for link, body in enumerate(arm.links):
            place = slice(10 * link, 10 * link + 10)
            covariance = _differs(body, arm.tolerances, spread)
            deviation[place], bodies[place, place] = np.sqrt(np.diag(covariance)), inverse(covariance)
        for joint in range(len(arm)):
            _rubs(design, joint, spread, mean[layout.friction(joint)], deviation[layout.friction(joint)])
    return Prior(mean, deviation, gain, gain_deviation, design.still, bodies)


def _differs(link: Link, tolerances: Tolerances, spread: float) -> Array:
    """Covariance of a body's ten parameters, (10, 10), as its tolerances give it.

    All ten grow with the mass, those of second order with the inertia about the centre too, and a centre that is
    elsewhere changes moments and inertias together. Beside it each may be a little different by itself.
    """
    mass, inertia, centre = (spread * s for s in (tolerances.mass, tolerances.inertia, tolerances.centre))
    own = np.concatenate([np.zeros(4), link.inertia[np.tril_indices(3)]])
    ways = [mass * link.parameters, inertia * own]
    for axis in centre * np.eye(3):
        sides = [Link(link.name, link.mass, link.centre + side, link.inertia).parameters for side in (axis, -axis)]
        ways.append(0.5 * (sides[0] - sides[1]))
    size = float(np.linalg.norm(link.centre) + np.sqrt(np.trace(link.inertia) / link.mass)) + centre + 1e-3
    least = _LEAST * link.mass * np.array([1.0, *[size] * 3, *[size**2] * 6])
    usual = float(np.trace(link.inertia)) / 3.0
    alone = np.hypot(least, np.repeat([0.0, _APART * inertia * usual], [4, 6]))
    found: Array = np.array(ways).T @ np.array(ways) + np.diag(alone**2)
    return found


def _rubs(design: Design, joint: int, spread: float, mean: Array, deviation: Array) -> None:
    """Writes what the data sheet says of a joint's friction and rotor, where it does, over what was there.

    Motion of a joint in one direction, or without a load, says nothing of the rest, where its friction is that of the
    data sheet.
    """
    sheet, spreads = design.arm.joints[joint], design.arm.tolerances
    part = spread * (spreads.friction + spreads.constant)
    viscous, coulomb, load = sheet.friction.viscous, sheet.friction.coulomb, sheet.friction.load
    known = {
        "viscous": (viscous, part),
        "coulomb": (coulomb, part),
        "load": (load, part),
        "rotor": (sheet.actuator.rotor or 0.0, spread * (_ROTOR + spreads.constant)),
    }
    one_way = {"coulomb asymmetry": _ONE_WAY * part * coulomb, "viscous asymmetry": _ONE_WAY * part * viscous}
    for place, (name, group) in enumerate(zip(design.names[joint], design.groups[joint], strict=True)):
        value, share = known.get(name, (0.0, 0.0))
        most = one_way.get(name, 0.0)
        if name.startswith("load"):
            most = spread * load * (_TURNING if group == "soft" else 1.0)
        if value > 0.0:
            mean[place], deviation[place] = value, max(share, _LEAST) * value
        elif name == "offset" and np.isfinite(sheet.largest):
            deviation[place] = spread * _OFFSET * sheet.largest
        elif most > 0.0:
            deviation[place] = min(deviation[place], most)


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
