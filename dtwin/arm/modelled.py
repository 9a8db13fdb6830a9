"""Arms with other models than those of their data sheets, and which models their blocks may reckon with."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Final

import numpy as np

from dtwin.arm.chain import Actuator, Arm, Array, Friction, Joint, symmetric
from dtwin.arm.model import ArmModel

MOST_MASS: Final = 3.0
"""Largest and, inverted, least mass of all links together, in parts of the data sheet's."""
MOST_CONSTANT: Final = 2.0
"""The same for the constant of a drive."""
MOST_FRICTION: Final = 3.0
"""Largest friction, in parts of the data sheet's, where that is more than `LOST`."""
LOST: Final = 0.5
"""Friction that any joint may have at its largest speed, in parts of what its drive gives."""
MOST_SHARE: Final = 0.5
"""Largest friction in parts of the torque that a gear carries."""
_ROUNDING: Final = 1e-9
"""Negative part of a body's spread, in parts of all of it, that is rounding."""


def with_model(arm: Arm, model: ArmModel) -> Arm:
    """The arm with a model in the place of its data sheet's."""
    joints = tuple(_joint(model, joint, k) for k, joint in enumerate(arm.joints))
    return replace(arm.with_parameters(np.array(model.bodies).ravel()), joints=joints)


def _joint(model: ArmModel, joint: Joint, k: int) -> Joint:
    actuator: Actuator = replace(joint.actuator, constant=model.constant[k], rotor=model.rotor[k])
    friction = Friction(model.viscous[k], model.coulomb[k], model.share[k])
    return replace(joint, actuator=actuator, friction=friction)


def problem_of(arm: Arm, model: ArmModel) -> str:
    """Why the blocks of an arm must not reckon with a model, "" if it is within the bounds around its data sheet."""
    return next(chain(_shapes(arm, model), _bodies(arm, model), _joints(arm, model)), "")


def _shapes(arm: Arm, model: ArmModel) -> Iterator[str]:
    for name in ArmModel.__slots__:
        values = getattr(model, name)
        if len(values) != len(arm):
            yield f"{name}: expected {len(arm)} values, one of each joint, got {len(values)}"
    for number, body in enumerate(model.bodies, 1):
        if len(body) != 10:
            yield f"body {number}: expected 10 inertial parameters, got {len(body)}"
    numbers = [*chain(*model.bodies), *model.constant, *model.rotor, *model.viscous, *model.coulomb, *model.share]
    if not np.isfinite(numbers).all():
        yield "expected finite numbers"


def _bodies(arm: Arm, model: ArmModel) -> Iterator[str]:
    for number, body in enumerate(model.bodies, 1):
        spread = np.linalg.eigvalsh(_pseudo_inertia(np.array(body)))
        if spread[0] < -_ROUNDING * max(abs(spread[-1]), 1e-12):
            yield f"body {number}: no body has such a mass, centre and inertia"
    mass, usual = sum(body[0] for body in model.bodies), sum(link.mass for link in arm.links)
    if not usual / MOST_MASS <= mass <= MOST_MASS * usual:
        yield f"mass of all links: expected {usual / MOST_MASS:.3g} to {MOST_MASS * usual:.3g} kg, got {mass:.3g}"


def _joints(arm: Arm, model: ArmModel) -> Iterator[str]:
    for number, joint in enumerate(arm.joints, 1):
        k, constant = number - 1, joint.actuator.constant or 1.0
        if not 1.0 / MOST_CONSTANT <= model.constant[k] / constant <= MOST_CONSTANT:
            yield (
                f"constant of joint {number}: expected {1.0 / MOST_CONSTANT:g} to {MOST_CONSTANT:g} times "
                f"{constant:.4g}, got {model.constant[k]:.4g}"
            )
        if model.rotor[k] < 0.0:
            yield f"rotor of joint {number}: expected at least 0, got {model.rotor[k]:.4g}"
        usual, most = joint.friction, LOST * joint.largest
        for name, value, least in (
            ("viscous", model.viscous[k], max(MOST_FRICTION * usual.viscous, most / joint.speed)),
            ("coulomb", model.coulomb[k], max(MOST_FRICTION * usual.coulomb, most)),
            ("share", model.share[k], MOST_SHARE),
        ):
            if not 0.0 <= value <= least:
                yield f"{name} of joint {number}: expected 0 to {least:.4g}, got {value:.4g}"


def _pseudo_inertia(parameters: Array) -> Array:
    """The pseudo-inertia of a body, (4, 4); it is positive semidefinite for whatever can be (Wensing et al. 2018)."""
    inertia, moments = symmetric(parameters[4:]), parameters[1:4]
    spread: Array = np.zeros((4, 4))
    spread[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    spread[:3, 3] = spread[3, :3] = moments
    spread[3, 3] = parameters[0]
    return spread
