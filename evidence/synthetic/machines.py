"""Drawn arms of six and seven joints, and logs of their motion: every effect that the identification has words for.

The effects are told in the textbooks' forms, not in the terms by which the identification explains them: Stribeck's
exponential, one Dahl element of any length, Coulomb friction that grows with the torque that the gear carries and
changes with temperature. The logs have what logs have: encoders with steps, noise, and a slow disturbance that no
term has.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.random import Generator

from dtwin.arm.chain import Actuator, Arm, Array, Joint, Link
from dtwin.equations.rigid import regressor
from dtwin.identification.chain.friction import dahl
from dtwin.measurements.measurement import Measurement

RATE: Final = 125.0
"""Rows a second of every log."""
ROOM: Final = 25.0
"""Temperature of a drive before it has worked, degrees Celsius."""
_STEP: Final = 2.0 * np.pi / 2**19
"""Step of the encoders, rad."""
_AXES: Final = {6: "zyyyzy", 7: "zyzyzyz"}
"""Axes of the joints, as of common arms of six and seven joints."""
_FINE: Final = 4
"""Points of the motion from row to row, so that friction turns over between rows as it does."""


@dataclass(frozen=True, slots=True, eq=False)
class Losses:
    """What the joints lose, (n,) each, in N m and rad.

    Attributes:
        offset: torque that is always there.
        viscous: torque per velocity.
        coulomb: torque against the motion.
        stribeck: further torque against slow motion.
        slow: speed over which that falls, rad/s.
        length: travel after which the torque has turned over to 63 %, rad.
        load: torque against the motion in parts of the torque that the gear carries.
        asymmetry: further torque while moving forward, less while moving back.
        warm: change of Coulomb friction a kelvin, in parts of it.
        thin: change of viscous friction a kelvin, in parts of it.
        rotor: inertia of the rotor seen at the joint, kg m^2.
    """

    offset: Array
    viscous: Array
    coulomb: Array
    stribeck: Array
    slow: Array
    length: Array
    load: Array
    asymmetry: Array
    warm: Array
    thin: Array
    rotor: Array

    def steady(self, joint: int, speed: float, temperature: float) -> float:
        """Friction of a joint that slides steadily without load at a temperature, N m."""
        kelvin, sign = temperature - ROOM, float(np.sign(speed))
        fall = float(np.exp(-((speed / self.slow[joint]) ** 2)))
        against = self.coulomb[joint] * (1.0 + self.warm[joint] * kelvin) + self.stribeck[joint] * fall
        by_speed = self.viscous[joint] * (1.0 + self.thin[joint] * kelvin) * speed
        return float(self.offset[joint] + by_speed + sign * against + self.asymmetry[joint])


@dataclass(frozen=True, slots=True, eq=False)
class Drawn:
    """One machine.

    Attributes:
        number: number that it was drawn by.
        arm: what it is.
        losses: what its joints lose.
        gain: torque per ampere, (n,), N m/A.
        sheet: the arm as its data sheet has it.
        load: mass that is weighed, kg.
        unknown: mass that is to be found, kg.
        warm: temperatures to which the drives go, (n,), degrees Celsius.
    """

    number: int
    arm: Arm
    losses: Losses
    gain: Array
    sheet: Arm
    load: float
    unknown: float
    warm: Array


def drawn_machine(number: int, joints: int) -> Drawn:
    """The machine of a number; machines of even numbers have the drives' constants on their data sheets."""
    generator = np.random.default_rng([0x73796E, number, joints])
    arm = _drawn_arm(joints, generator)
    weight = np.abs(_torques(arm, generator)).max(axis=0)
    gain = generator.uniform(5.0, 15.0, joints)
    losses = _drawn_losses(weight, generator)
    constant = gain * np.exp(0.05 * generator.standard_normal(joints)) if number % 2 == 0 else [None] * joints
    sheet = _sheet(arm, constant, generator)
    reach = generator.uniform(2.0, 4.0), generator.uniform(0.8, 3.0)
    return Drawn(number, arm, losses, gain, sheet, *reach, generator.uniform(30.0, 50.0, joints))


def _drawn_arm(joints: int, generator: Generator) -> Arm:
    """An arm of about 25 kg whose links become lighter and shorter outward."""
    made, links = [], []
    for k, axis in enumerate(_AXES[joints]):
        outward = 1.0 - k / (joints + 1)
        translation = np.array([0.0, generator.uniform(-0.1, 0.1), generator.uniform(0.15, 0.4) * outward + 0.05])
        turn = np.array([0.0, 0.0, 1.0]) if axis == "z" else np.array([0.0, 1.0, 0.0])
        made.append(Joint(f"joint{k + 1}", "revolute", turn, np.eye(3), translation, effort=300.0, speed=3.0))
        mass = generator.uniform(4.0, 8.0) * outward**1.5
        size = np.array([0.12, 0.12, 0.4 * outward + 0.08]) * generator.uniform(0.7, 1.3, 3)
        inertia = np.diag(mass / 12.0 * (np.sum(size**2) - size**2))
        centre = np.array([0.0, 0.0, 0.5 * size[2]]) + 0.03 * generator.standard_normal(3)
        links.append(Link(f"link{k + 1}", mass, centre, inertia))
    return Arm(f"drawn-{joints}r", tuple(made), tuple(links))


def _torques(arm: Arm, generator: Generator) -> Array:
    q = generator.uniform(-2.0, 2.0, (200, len(arm)))
    still = np.zeros_like(q)
    found: Array = regressor(arm, q, still, still) @ arm.parameters
    return found


def _drawn_losses(weight: Array, generator: Generator) -> Losses:
    """Friction of a twentieth to a fifth of the largest torque of a joint, as of arms with strain-wave gears."""
    n = len(weight)
    size = np.maximum(weight, 0.15 * weight.max()) * generator.uniform(0.05, 0.12, n)

    def parts(low: float, high: float) -> Array:
        return size * generator.uniform(low, high, n)

    return Losses(
        offset=parts(-0.2, 0.2),
        viscous=parts(0.4, 1.2),
        coulomb=parts(0.7, 1.3),
        stribeck=parts(0.0, 0.5),
        slow=generator.uniform(0.03, 0.15, n),
        length=generator.uniform(0.002, 0.03, n),
        load=generator.uniform(0.0, 0.08, n),
        asymmetry=parts(-0.2, 0.2),
        warm=generator.uniform(-0.01, 0.0, n),
        thin=generator.uniform(-0.02, -0.005, n),
        rotor=generator.uniform(0.1, 0.6, n) * size / 5.0,
    )


def _sheet(arm: Arm, constant: Array | list[None], generator: Generator) -> Arm:
    """The data sheet: masses to 15 %, inertias to 30 %, centres to 2 cm, constants, if it has any, to 5 %."""
    links = []
    for link in arm.links:
        mass, inertia = np.exp(np.array([0.15, 0.3]) * generator.standard_normal(2))
        centre = link.centre + 0.02 * generator.standard_normal(3)
        links.append(Link(link.name, link.mass * mass, centre, link.inertia * mass * inertia))
    joints = [
        replace(joint, actuator=Actuator("current", None if value is None else float(value), tolerance=0.05))
        for joint, value in zip(arm.joints, constant, strict=True)
    ]
    return replace(arm, joints=tuple(joints), links=tuple(links))


def log_of(machine: Drawn, seconds: float, session: int, held: float = 0.0) -> Measurement:
    """What a motion of a machine would log.

    Args:
        machine: the machine.
        seconds: length of the motion.
        session: number of the motion; the drives are warmer in later ones.
        held: point mass at the origin of the last link, 0.1 m out, kg.
    """
    generator = np.random.default_rng([0x6C6F67, machine.number, len(machine.arm), session])
    t, q, v, a = _motion(len(machine.arm), seconds, generator)
    warmth = ROOM + (machine.warm - ROOM) * (1.0 - np.exp(-(t[:, None] + seconds * session) / 150.0))
    torque, friction = _torque(machine, q, v, a, warmth, held)
    rows = slice(None, None, _FINE)
    size = (torque + friction)[rows].std(axis=0)
    effort = (torque + friction)[rows] + size * (
        0.01 * generator.standard_normal((len(t[rows]), len(size))) + _disturbance(len(t[rows]), len(size), generator)
    )
    read = q[rows] + 1e-5 * generator.standard_normal(q[rows].shape)
    speed = None if machine.number % 4 < 2 else v[rows] + 2e-3 * generator.standard_normal(v[rows].shape)
    return Measurement(
        f"motion {session}",
        tuple(joint.name for joint in machine.arm.joints),
        t[rows],
        _STEP * np.round(read / _STEP),
        speed,
        effort / machine.gain,
        "current",
        temperature=np.round(warmth[rows] * 2.0) / 2.0,
        episodes=np.zeros(len(t[rows]), dtype=np.int64),
    )


def _torque(machine: Drawn, q: Array, v: Array, a: Array, warmth: Array, held: float) -> tuple[Array, Array]:
    """Torque that the gears carry, and what is lost, (N, n)."""
    losses, n = machine.losses, len(machine.arm)
    pi = machine.arm.parameters.copy()
    if held:
        pi[-10:] += _point(held)
    carried = regressor(machine.arm, q, v, a) @ pi
    turned = np.stack([dahl(q[:, j], float(losses.length[j])) for j in range(n)], axis=1)
    kelvin = warmth - ROOM
    level = losses.coulomb * (1.0 + losses.warm * kelvin) + losses.stribeck * np.exp(-((v / losses.slow) ** 2))
    against = turned * (level + losses.load * np.abs(carried)) + losses.asymmetry * np.abs(turned)
    by_speed = losses.viscous * (1.0 + losses.thin * kelvin) * v
    return carried, losses.offset + against + by_speed + losses.rotor * a


def _point(mass: float) -> Array:
    """A point mass 0.1 m out along the last link, as ten parameters."""
    centre = np.array([0.0, 0.0, 0.1])
    return Link("held", mass, centre, np.zeros((3, 3))).parameters


def _motion(joints: int, seconds: float, generator: Generator) -> tuple[Array, Array, Array, Array]:
    """Time, positions, velocities and accelerations of a sum of five sines in each joint, at the fine rate."""
    t = np.arange(0.0, seconds, 1.0 / (RATE * _FINE))
    q, v, a = (np.zeros((len(t), joints)) for _ in range(3))
    for joint in range(joints):
        q[:, joint] = generator.uniform(-1.0, 1.0)
        for frequency in generator.uniform(0.04, 0.4, 5):
            w, phase, size = 2.0 * np.pi * frequency, generator.uniform(0.0, 6.3), generator.uniform(0.1, 0.5)
            q[:, joint] += size * np.sin(w * t + phase)
            v[:, joint] += size * w * np.cos(w * t + phase)
            a[:, joint] -= size * w * w * np.sin(w * t + phase)
    return t, q, v, a


def _disturbance(rows: int, joints: int, generator: Generator) -> Array:
    """Half a per cent that goes on for 0.3 s: a first-order process."""
    keep = np.exp(-1.0 / (0.3 * RATE))
    white = generator.standard_normal((rows, joints))
    found = np.zeros((rows, joints))
    for row in range(1, rows):
        found[row] = keep * found[row - 1] + np.sqrt(1.0 - keep**2) * white[row]
    return 0.005 * found
