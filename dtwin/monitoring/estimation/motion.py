"""How the arm moves in one sample, and how that depends on the estimator's states.

A motion carries the state over a sample and tells the derivatives F (6, 27) of what it comes to by the moving states
(see `layout`). Of an arm that obeys the equations of motion it is the twin's RK4 map with its exact derivative; of
one with `Effects` it is the map of `dtwin.twin.machine`.
"""

from __future__ import annotations

import math
from typing import Final, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays, derivatives, rigid
from dtwin.monitoring.estimation.arrays import MotionArrays, TwinArrays
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.derivatives import by_voltages, hold
from dtwin.monitoring.estimation.layout import ARM, ARM_NAMES, INDEX, LATE, MOVING, PAYLOAD, SIZE, SUPPLY, TORQUE, W
from dtwin.monitoring.estimation.rigid import TURNS, RigidMotion, carry_rigid
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.twin import dry_friction, dynamics, lanes, machine, machine_sensitivity, sensitivity
from dtwin.twin.compiled import kernel
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import MACHINE_NAMES, WIDTH, vector_of
from dtwin.twin.machine_sensitivity import linearise_machine

Array = NDArray[np.float64]

LATEST: Final = 2
"""Samples by which commands may come later than they do in the healthy arm."""


class Motion(Protocol):
    """The arm in one sample."""

    def reset(self) -> None:
        """Forgets the commands before: nothing is known of them."""

    @property
    def sine(self) -> Array:
        """What eccentric encoders add, per sine of the angle, (3,), rad."""

    @property
    def cosine(self) -> Array:
        """What eccentric encoders add, per cosine of the angle, (3,), rad."""

    def eccentricity(self, angles: Array) -> Array:
        """What eccentric encoders add to angles, (3,), rad."""

    def arrays(self, gripped: bool) -> MotionArrays:
        """What `carry` works with, while a box is held or not; the motion's own."""

    def copy(self) -> Self:
        """An independent motion in the same state."""


class MachineMotion:
    """The motion of an arm with effects, which remembers late commands and voltages that lag.

    The derivatives by the state and by torques are exact. Voltage constants and friction act as the
    torques that they make with the mean voltages and velocities of the sample. Centres of mass and inertias count as
    known: what they leave unexplained is a torque that lasts.
    """

    def __init__(self, arm: ArmParameters, effects: Effects) -> None:
        self._vector = vector_of(arm, effects)
        self._commands = np.zeros((math.floor(effects.delay / PERIOD) + 2 + LATEST, 3))
        self.sine, self.cosine = np.array(effects.eccentric_sin), np.array(effects.eccentric_cos)
        self._acting, self._mean = np.full((2, 3), np.nan)
        self._later = np.zeros(3)

    def reset(self) -> None:
        """Takes commands and voltages before to be like the next ones."""
        self._acting[:] = self._mean[:] = np.nan

    def eccentricity(self, angles: Array) -> Array:
        """See `Motion.eccentricity`."""
        found = np.empty(3)
        eccentricity(angles, self.sine, self.cosine, found)
        return found

    def arrays(self, gripped: bool) -> MotionArrays:
        """See `Motion.arrays`."""
        return MotionArrays(
            False, _NO_TWIN, self._vector, gripped, self._later, self._commands, self._acting, self._mean
        )

    def copy(self) -> MachineMotion:
        """See `Motion.copy`."""
        other = object.__new__(MachineMotion)
        other._vector, other.sine, other.cosine = self._vector, self.sine, self.cosine
        other._commands, other._acting, other._mean = self._commands.copy(), self._acting.copy(), self._mean.copy()
        other._later = self._later.copy()
        return other


def motion_of(belief: Belief) -> Motion:
    """The motion of the arm as it is believed."""
    if belief.effects == NO_EFFECTS:
        return RigidMotion(belief.arm)
    return MachineMotion(belief.arm, belief.effects)


@kernel
def eccentricity(angles: Array, sine: Array, cosine: Array, found: Array) -> None:
    """Writes what eccentric encoders add to angles, (3,) each, rad."""
    for i in range(3):
        found[i] = sine[i] * math.sin(angles[i]) + cosine[i] * math.cos(angles[i])


@kernel(uses=(arrays, derivatives, dry_friction, dynamics, lanes, machine, machine_sensitivity))
def _carry_machine(x: Array, volts: Array, locked: int, m: MotionArrays, end: Array, F: Array) -> None:
    """What `carry` does for an arm with effects.

    Args:
        x: (33,), states before.
        volts: (3,), command that is held over the sample, V.
        locked: joint that is held where it is, 1 to 3, or 0.
        m: the machine.
    """
    later, commands, acting, mean = m.later, m.commands, m.acting, m.mean
    if not np.isfinite(acting).all():
        commands[:] = volts
    commands[:-1] = commands[1:]
    commands[-1] = volts
    p, before, slopes = m.vector.copy(), acting.copy(), np.empty((6, 10 if m.gripped else 9))
    for k in range(len(_OF_ARM)):
        p[_OF_ARM[k]] = x[ARM + k]
    share = 1.0 + x[SUPPLY]
    p[_OF_DELAY] += x[LATE] * PERIOD
    for i in range(3):
        p[_OF_K[i]] *= share
        p[_OF_TORQUE[i]] += x[TORQUE + i]
    for turn in range(TURNS if locked else 1):
        end[:], acting[:] = x[:6], before
        linearise_machine(p, commands, x[PAYLOAD], acting, end, slopes)
        if locked and turn < TURNS - 1:
            slope = slopes[W + locked - 1, 6 + locked - 1]
            if slope != 0.0:
                p[_OF_TORQUE[locked - 1]] -= end[W + locked - 1] / slope
    F[:] = 0.0
    F[:, :6], F[:, TORQUE:MOVING] = slopes[:, :6], slopes[:, 6:9]
    if m.gripped:
        F[:, PAYLOAD] = slopes[:, 9]
    later[:] = 0.0
    for i in range(3):
        now = acting[i] if math.isnan(before[0]) else 0.5 * (before[i] + acting[i])
        if not math.isnan(mean[i]):
            later[i] = mean[i] - now
        mean[i] = now
        speed = 0.5 * (x[W + i] + end[W + i])
        rubs = -math.tanh(speed / WIDTH)
        for j in range(6):
            by_torque = F[j, TORQUE + i]
            F[j, _K + i] = by_torque * share * now
            F[j, _D + i], F[j, _MU + i] = -by_torque * speed, by_torque * rubs
    by_voltages(F, x, mean, later)
    if locked:
        hold(x, end, F, locked - 1)


@kernel(uses=(arrays, derivatives, dry_friction, dynamics, lanes, machine, machine_sensitivity, rigid, sensitivity))
def carry(x: Array, volts: Array, m: MotionArrays, locked: int, end: Array, F: Array) -> None:
    """Writes the state after a sample to end (6,), and its derivatives by the moving states to F (6, 27).

    Args:
        x: (33,), states before, all of them possible.
        volts: (3,), command that is held over the sample, V.
        m: of the motion, which remembers the command.
        locked: joint that is held where it is, 1 to 3, or 0.
        end, F: receive what it comes to.
    """
    if m.rigid:
        carry_rigid(x, volts, locked, m, end, F)
    else:
        _carry_machine(x, volts, locked, m, end, F)


_NO_TWIN: Final = TwinArrays(np.zeros(18), np.zeros((1, 18, MOVING)), np.zeros(SIZE))
_K: Final = INDEX["K1"]
_D: Final = INDEX["D1"]
_MU: Final = INDEX["mu1"]
_OF_K: Final = np.array([MACHINE_NAMES.index(f"K{joint}") for joint in (1, 2, 3)])
_OF_DELAY: Final = MACHINE_NAMES.index("delay")
_OF_ARM: Final = np.array([MACHINE_NAMES.index(name) for name in ARM_NAMES])
_OF_TORQUE: Final = np.array([MACHINE_NAMES.index(f"torque{joint}") for joint in (1, 2, 3)])
