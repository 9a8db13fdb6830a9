"""What a serial arm of a kind really is: another arm with its own numbers, and effects that its equations leave out.

A machine is `ideal`, which has no friction but the viscous one and encoders without steps; `nominal`, which is as the
data sheet says with all effects; or a number, for which an arm is drawn from the tolerances of its kind.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Actuator, Arm, Friction, Joint, Link
from dtwin.errors import ModelError

IDEAL: Final = "ideal"
NOMINAL: Final = "nominal"
_LARGEST: Final = 10**9


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """A machine.

    Attributes:
        name: ideal, nominal, or its number.
        arm: what it really is.
        friction: whether Coulomb friction and friction that grows with the load act.
        encoders: whether encoders have steps and noise.
    """

    name: str
    arm: Arm
    friction: bool = True
    encoders: bool = True


def machine_of(text: str, arm: Arm) -> Machine:
    """The machine of an arm that a name or a number stands for.

    Raises:
        ModelError: there is no such machine.
    """
    if text == IDEAL:
        return Machine(IDEAL, arm, friction=False, encoders=False)
    if text == NOMINAL:
        return Machine(NOMINAL, arm)
    if text.isascii() and text.isdecimal() and int(text) <= _LARGEST:
        return Machine(text, drawn(arm, int(text)))
    raise ModelError(
        f"machine {text!r}: expected {IDEAL}, {NOMINAL}, or a number up to {_LARGEST}, whose arm is drawn from the "
        "tolerances"
    )


def drawn(arm: Arm, number: int) -> Arm:
    """The arm of a number: the same number is the same arm everywhere.

    Factors are exp(s w) with the relative standard deviation s and a standard normal w, so that nothing changes its
    sign. An inertia has the factor of its mass times its own; centres of mass are shifted along each axis.
    """
    generator = np.random.default_rng(np.random.SeedSequence([0x61726D, number]))
    spread = arm.tolerances

    def factor(deviation: float) -> float:
        return float(np.exp(deviation * generator.standard_normal()))

    links = []
    for link in arm.links:
        mass = factor(spread.mass)
        inertia = mass * factor(spread.inertia)
        centre = link.centre + spread.centre * generator.standard_normal(3)
        links.append(Link(link.name, mass * link.mass, centre, inertia * link.inertia))
    joints = [
        _drawn_joint(joint, *(factor(d) for d in (spread.constant, *[spread.friction] * 3))) for joint in arm.joints
    ]
    return replace(arm, joints=tuple(joints), links=tuple(links))


def _drawn_joint(joint: Joint, constant: float, viscous: float, coulomb: float, load: float) -> Joint:
    actuator, friction = joint.actuator, joint.friction
    made: Actuator = actuator
    if actuator.stiffness is not None:
        made = replace(actuator, stiffness=constant * actuator.stiffness, damping=constant * actuator.damping)
    if actuator.constant is not None and actuator.commanded != "torque":
        made = replace(actuator, constant=constant * actuator.constant)
    lost = Friction(viscous * friction.viscous, coulomb * friction.coulomb, load * friction.load)
    return replace(joint, actuator=made, friction=lost)
