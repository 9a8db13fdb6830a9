"""Machines drawn by number from the tolerances of ordinary servo arms; docs/machine.md has their sources.

Every effect has a random generator of its own, made of the machine's number and the effect's name: a number is the
same machine everywhere, and an effect that is added later changes no other.
"""

from __future__ import annotations

import zlib

import numpy as np

from dtwin.emulation.machine.sections import Drive, Machine, Sensing, Structure, Transmission
from dtwin.errors import ParameterError
from dtwin.parameters import JOINTS, VOLTAGE_LIMIT, ArmParameters, JointVector
from dtwin.signals import LARGEST_COUNT


def draw(number: int) -> Machine:
    """The machine of a number.

    Raises:
        ParameterError: the number is negative or too large.
    """
    if not 0 <= number <= LARGEST_COUNT:
        raise ParameterError(f"machine {number}: expected a number from 0 to {LARGEST_COUNT} (2^63 - 1)")
    return Machine(str(number), _drive(number), _transmission(number), _structure(number), _sensing(number))


def _drive(number: int) -> Drive:
    drawn = _Drawing(number, "drive")
    torque = drawn.joints("torque", 0.85, 1.05)
    return Drive(
        torque=torque,
        lag=drawn.joints("lag", 0.0025, 0.006),
        back_emf=drawn.joints("back_emf", 0.03, 0.12),
        bits=drawn.whole("bits", 10, 12),
        dead_zone=drawn.joints("dead_zone", 0.05, 0.25),
        sag=drawn.number("sag", 0.0, 0.05),
        delay=drawn.number("delay", 0.001, 0.010),
    )


def _transmission(number: int) -> Transmission:
    drawn = _Drawing(number, "transmission")
    coulomb = drawn.joints("coulomb", 0.005, 0.03)
    excess = drawn.joints("static", 1.1, 1.5)
    return Transmission(
        damping=drawn.joints("damping", 0.7, 1.4),
        coulomb=coulomb,
        static=_each(coulomb, excess),
        stribeck_velocity=drawn.joints("stribeck_velocity", 0.05, 0.3),
        rotor_inertia=drawn.joints("rotor_inertia", 0.0006, 0.0015),
        stiffness=drawn.joints("stiffness", 50.0, 100.0),
        gear_damping=drawn.joints("gear_damping", 0.02, 0.06),
        backlash=drawn.joints("backlash", 0.001, 0.006),
        ripple=_each(ArmParameters().voltage_constant, drawn.joints("ripple", 0.0, 0.005 * VOLTAGE_LIMIT)),
        ripple_periods=drawn.joints("ripple_periods", 6.0, 40.0),
        ripple_phase=drawn.joints("ripple_phase", -np.pi, np.pi),
        cable=drawn.joints("cable", 0.0, 0.01),
        cable_rest=drawn.joints("cable_rest", -0.5, 0.5),
    )


def _structure(number: int) -> Structure:
    drawn = _Drawing(number, "structure")
    return Structure(
        mass=drawn.joints("mass", 0.95, 1.05),
        inertia=drawn.joints("inertia", 0.9, 1.1),
        length=drawn.joints("length", 0.9985, 1.0015),
        com=drawn.joints("com", 0.97, 1.03),
        com_offset=drawn.joints("com_offset", -0.002, 0.002),
        tilt=drawn.number("tilt", -0.01, 0.01),
    )


def _sensing(number: int) -> Sensing:
    drawn = _Drawing(number, "sensing")
    return Sensing(
        bits=drawn.whole("bits", 12, 15),
        eccentricity=drawn.joints("eccentricity", 0.0, 0.002),
        eccentricity_phase=drawn.joints("eccentricity_phase", -np.pi, np.pi),
        noise=drawn.number("noise", 0.0, 0.0005),
        noise_kind="gaussian",
        loss_rate=drawn.number("loss_rate", 0.0, 0.05),
        delay=drawn.number("delay", 0.0, 0.0025),
    )


class _Drawing:
    """Draws the effects of one section of a machine."""

    def __init__(self, number: int, section: str) -> None:
        self._number = number
        self._section = section

    def number(self, name: str, low: float, high: float) -> float:
        return self._numbers(name, 1, low, high)[0]

    def joints(self, name: str, low: float, high: float) -> JointVector:
        return tuple(self._numbers(name, JOINTS, low, high))

    def whole(self, name: str, low: int, high: int) -> int:
        return low + int((high - low + 1) * self._shares(name, 1)[0])

    def _numbers(self, name: str, count: int, low: float, high: float) -> list[float]:
        return [_rounded(low + (high - low) * share) for share in self._shares(name, count)]

    def _shares(self, name: str, count: int) -> list[float]:
        """Numbers of [0, 1), equal ones in any version of numpy: PCG64's bits as doubles, without a distribution."""
        key = zlib.crc32(f"{self._section}.{name}".encode())
        bits = np.random.PCG64(np.random.SeedSequence(self._number, spawn_key=(key,)))
        shares: list[float] = np.random.Generator(bits).random(count).tolist()
        return shares


def _rounded(number: float) -> float:
    """A number with the six digits that are worth printing."""
    return float(f"{number:.6g}")


def _each(first: JointVector, second: JointVector) -> JointVector:
    return tuple(_rounded(x * y) for x, y in zip(first, second, strict=True))
