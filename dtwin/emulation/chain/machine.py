"""What a serial arm of a kind really is: another arm with its own numbers, and effects that its equations leave out.

A machine is `ideal`, which has no friction but the viscous one, gears that do not yield, encoders without steps, and
no stops; `nominal`, which is as the data sheet says with all effects; a number, for which an arm is drawn from the
tolerances of its kind; or a file, which changes some numbers of one of these:

base = "7"                 # ideal, nominal or a number; nominal without it

[joints.lift]              # keys of the arm's own file
gear_stiffness = 8000.0    # N m/rad
backlash = 3e-4            # rad
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.arm.chain import Actuator, Arm, Array, Friction, Joint, Link
from dtwin.arm.file import SUFFIX, content_of, joints_of, with_joints
from dtwin.errors import ModelError, choices

IDEAL: Final = "ideal"
NOMINAL: Final = "nominal"
_LARGEST: Final = 10**9


@dataclass(frozen=True, slots=True, eq=False)
class Machine:
    """A machine.

    Attributes:
        name: ideal, nominal, its number, or its file.
        arm: what it really is.
        friction: whether Coulomb friction and friction that grows with the load act.
        encoders: whether encoders have steps and noise.
        stops: whether joints have stops beyond their ranges.
    """

    name: str
    arm: Arm
    friction: bool = True
    encoders: bool = True
    stops: bool = False


def machine_of(text: str, arm: Arm) -> Machine:
    """The machine of an arm that a name, a number or a file stands for.

    Raises:
        ModelError: there is no such machine, or its file cannot be used.
    """
    if text.endswith(SUFFIX):
        return _of_file(Path(text), arm)
    if text == IDEAL:
        return Machine(IDEAL, rigid(arm), friction=False, encoders=False)
    if text == NOMINAL:
        return Machine(NOMINAL, arm, stops=True)
    if text.isascii() and text.isdecimal() and int(text) <= _LARGEST:
        return Machine(text, drawn(arm, int(text)), stops=True)
    raise ModelError(
        f"machine {text!r}: expected {IDEAL}, {NOMINAL}, a number up to {_LARGEST}, whose arm is drawn from the "
        f"tolerances, or a file (*{SUFFIX})"
    )


def told(machine: str, arm: Arm) -> Arm:
    """The arm as the data sheet of a machine tells it: that of the ideal one has no dry friction.

    A controller that made friction good which is not there would lead the ideal machine off its path.
    """
    if machine != IDEAL:
        return arm
    joints = (replace(joint, friction=Friction(joint.friction.viscous)) for joint in arm.joints)
    return replace(arm, joints=tuple(joints))


def rigid(arm: Arm) -> Arm:
    """The arm with gears that do not yield."""
    return replace(arm, joints=tuple(replace(joint, transmission=None) for joint in arm.joints))


def _of_file(path: Path, arm: Arm) -> Machine:
    content = content_of(path, "a machine")
    keys = ("base", "joints")
    for key in content:
        if key not in keys:
            raise ModelError(f"{path}: {key}: unknown key: expected {choices(keys)}")
    base = content.get("base", NOMINAL)
    if not isinstance(base, str) or base.endswith(SUFFIX):
        raise ModelError(f"{path}: base: expected {IDEAL}, {NOMINAL} or a number as text, got {base!r}")
    try:
        found, joints = machine_of(base, arm), joints_of(content)
    except ModelError as error:
        raise ModelError(f"{path}: {error}") from None
    return replace(found, name=path.stem, arm=with_joints(found.arm, path, joints))


def drawn(arm: Arm, number: int) -> Arm:
    """The arm of a number: the same number is the same arm everywhere.

    Factors are exp(s w) with the relative standard deviation s and a standard normal w, so that nothing changes its
    sign. An inertia has the factor of its mass times its own; centres of mass are shifted along each axis. Gears have
    a generator of their own, so that an arm is the same one whether they yield or not.
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
    own = np.random.default_rng(np.random.SeedSequence([0x67656172, number]))
    joints = [_drawn_gear(joint, np.exp(spread.gear * own.standard_normal(3))) for joint in joints]
    return replace(arm, joints=tuple(joints), links=tuple(links))


def _drawn_gear(joint: Joint, factors: Array) -> Joint:
    gear = joint.transmission
    if gear is None:
        return joint
    stiffness, damping, backlash = map(float, factors * [gear.stiffness, gear.damping, gear.backlash])
    return replace(joint, transmission=replace(gear, stiffness=stiffness, damping=damping, backlash=backlash))


def _drawn_joint(joint: Joint, constant: float, viscous: float, coulomb: float, load: float) -> Joint:
    actuator, friction = joint.actuator, joint.friction
    made: Actuator = actuator
    if actuator.stiffness is not None:
        made = replace(actuator, stiffness=constant * actuator.stiffness, damping=constant * actuator.damping)
    if actuator.constant is not None and actuator.commanded != "torque":
        made = replace(actuator, constant=constant * actuator.constant)
    lost = Friction(viscous * friction.viscous, coulomb * friction.coulomb, load * friction.load)
    return replace(joint, actuator=made, friction=lost)
