"""How the arm moves in one sample, and how that depends on the estimator's states.

A motion carries the state over a sample and tells the derivatives F (6, 27) of what it comes to by the moving states
(see `layout`). Of an arm that obeys the equations of motion it is the twin's RK4 map with its exact derivative; of
one with `Effects` it is the map of `dtwin.twin.machine`.
"""

from __future__ import annotations

import copy
import math
from typing import Final, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.layout import (
    ARM,
    ARM_NAMES,
    INDEX,
    LATE,
    MOVING,
    PAYLOAD,
    SIZE,
    SUPPLY,
    TORQUE,
    W,
)
from dtwin.parameters import COULOMB_WIDTH, PARAMETER_NAMES, PERIOD, VOLTAGE_LIMIT, ArmParameters
from dtwin.twin import dry_friction, dynamics, lanes, machine, machine_sensitivity, sensitivity
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import coefficients
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import MACHINE_NAMES, WIDTH, vector_of
from dtwin.twin.machine_sensitivity import linearise_machine
from dtwin.twin.sensitivity import integrate_linearised

Array = NDArray[np.float64]

SUBSTEPS: Final = 4
"""RK4 steps a sample, as in the emulation"""
_COMPLEX_STEP: Final = 1e-30
_LEAST_VOLTS: Final = 1e-6
"""V: the derivative by a torque is that by the voltage constant divided by the voltage; this little moves nothing"""
_TURNS: Final = 3
"""steps of Newton's method that find the torque that holds a locked joint"""
LATEST: Final = 2
"""Samples by which commands may come later than they do in the healthy arm."""
_NO_ECCENTRICITY: Final = np.zeros(3)


class Motion(Protocol):
    """The arm in one sample."""

    def begin(self) -> None:
        """Forgets the commands before: nothing is known of them."""

    def carry(self, x: Array, volts: Array, gripped: bool, locked: int) -> tuple[Array, Array]:
        """The state after a sample, (6,), and its derivatives, (6, 27).

        Args:
            x: (33,), states before, all of them possible.
            volts: (3,), command that is held over the sample, V.
            gripped: whether a box is held.
            locked: joint that is held where it is, 1 to 3, or 0.
        """

    def eccentricity(self, angles: Array) -> Array:
        """What eccentric encoders add to angles, (3,), rad."""

    def copy(self) -> Self:
        """An independent motion in the same state."""


class RigidMotion:
    """The motion of an arm that obeys the equations of motion; it remembers the last command."""

    def __init__(self, arm: ArmParameters) -> None:
        self._empty, self._moved = _coefficients(arm)
        self._nominal = np.zeros(SIZE)
        self._nominal[ARM:PAYLOAD] = [arm.get(name) for name in ARM_NAMES]
        self._level = np.zeros(1, dtype=np.int64)
        self._last: Array | None = None

    def begin(self) -> None:
        """See `Motion.begin`."""
        self._last = None

    def carry(self, x: Array, volts: Array, gripped: bool, locked: int) -> tuple[Array, Array]:
        """See `Motion.carry`."""
        last, self._last = volts if self._last is None else self._last, volts
        if not locked:
            states, derivatives = np.empty((2, 6)), np.empty((2, 6, MOVING))
            _carry(x, volts, last, gripped, self._empty, self._moved, self._nominal, self._level, states, derivatives)
            return states[1], derivatives[1]
        meant, last = np.clip((volts, last), -VOLTAGE_LIMIT, VOLTAGE_LIMIT)
        later = last - meant
        u = (1.0 + x[SUPPLY]) * (meant + x[LATE] * later)
        u[np.abs(u) < _LEAST_VOLTS] = _LEAST_VOLTS
        held = self._empty + self._moved[0, :, ARM:] @ (x - self._nominal)[ARM:MOVING]
        states, derivatives = np.empty((2, 6)), np.zeros((2, 6, MOVING))
        states[0], derivatives[0, :, :6] = x[:6], np.eye(6)
        end, F = states[1], derivatives[1]
        for _ in range(_TURNS):
            integrate_linearised(
                held[None], self._moved, self._level, u[None], PERIOD, SUBSTEPS, COULOMB_WIDTH, states, derivatives
            )
            _oppose(u, x, end, F, locked - 1)
        F[:, TORQUE:MOVING] = F[:, ARM : ARM + 3] / u
        end += F[:, TORQUE:MOVING] @ x[TORQUE:MOVING]
        _by_voltages(F, x, meant + x[LATE] * later, later)
        if not gripped:
            F[:, PAYLOAD] = 0.0
        _hold(x, end, F, locked - 1)
        return end, F

    def eccentricity(self, angles: Array) -> Array:
        """None."""
        return _NO_ECCENTRICITY

    def copy(self) -> RigidMotion:
        """See `Motion.copy`."""
        return copy.copy(self)


class MotionArrays(NamedTuple):
    """What `carry_machine` works with; the last three change in place.

    Attributes:
        vector: (78,), the machine, whose estimated numbers are those of the state.
        gripped: whether a box is held, on whose mass the motion depends.
        commands: (n, 3), commands up to the last sample, V.
        acting: (3,), voltages that act, V; not a number if nobody knows.
        mean: (3,), mean voltages of the sample before, V.
    """

    vector: Array
    gripped: bool
    commands: Array
    acting: Array
    mean: Array


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

    def begin(self) -> None:
        """Takes commands and voltages before to be like the next ones."""
        self._acting[:] = self._mean[:] = np.nan

    def carry(self, x: Array, volts: Array, gripped: bool, locked: int) -> tuple[Array, Array]:
        """See `Motion.carry`."""
        end, F = np.empty(6), np.empty((6, MOVING))
        carry_machine(x, volts, locked, *self.arrays(gripped), end, F)
        if locked:
            _hold(x, end, F, locked - 1)
        return end, F

    def eccentricity(self, angles: Array) -> Array:
        """See `Motion.eccentricity`."""
        found = np.empty(3)
        eccentricity(angles, self.sine, self.cosine, found)
        return found

    def arrays(self, gripped: bool) -> MotionArrays:
        """What `carry_machine` works with, while a box is held or not; the motion's own."""
        return MotionArrays(self._vector, gripped, self._commands, self._acting, self._mean)

    def copy(self) -> MachineMotion:
        """See `Motion.copy`."""
        other = object.__new__(MachineMotion)
        other._vector, other.sine, other.cosine = self._vector, self.sine, self.cosine
        other._commands, other._acting, other._mean = self._commands.copy(), self._acting.copy(), self._mean.copy()
        return other


@kernel
def _by_voltages(F: Array, x: Array, volts: Array, later: Array) -> None:
    """Fills in the derivatives by the share of the voltages and by how late they come.

    Args:
        F: (6, 27), with the derivatives by torques.
        x: (33,), states before the sample.
        volts: (3,), mean voltages of the sample at the full supply, V.
        later: (3,), by how much those of a sample before differ from them, V.
    """
    for i in range(6):
        F[i, SUPPLY] = F[i, LATE] = 0.0
        for joint in range(3):
            by_volt = F[i, TORQUE + joint] * x[ARM + joint]
            F[i, SUPPLY] += by_volt * volts[joint]
            F[i, LATE] += (1.0 + x[SUPPLY]) * by_volt * later[joint]


@kernel(uses=(sensitivity,))
def _carry(
    x: Array,
    volts: Array,
    last: Array,
    gripped: bool,
    empty: Array,
    moved: Array,
    nominal: Array,
    level: NDArray[np.int64],
    states: Array,
    derivatives: Array,
) -> None:
    """Writes to the last rows of states (2, 6) and derivatives (2, 6, 27) what `RigidMotion.carry` gives while no
    joint is locked."""
    u, held, mean, later = np.empty((1, 3)), np.empty((1, 18)), np.empty(3), np.empty(3)
    derivatives[0] = 0.0
    for i in range(3):
        meant = min(max(volts[i], -VOLTAGE_LIMIT), VOLTAGE_LIMIT)
        later[i] = min(max(last[i], -VOLTAGE_LIMIT), VOLTAGE_LIMIT) - meant
        mean[i] = meant + x[LATE] * later[i]
        u[0, i] = (1.0 + x[SUPPLY]) * mean[i]
        if abs(u[0, i]) < _LEAST_VOLTS:
            u[0, i] = _LEAST_VOLTS
    for k in range(18):
        held[0, k] = empty[k]
        for j in range(ARM, MOVING):
            held[0, k] += moved[0, k, j] * (x[j] - nominal[j])
    for i in range(6):
        states[0, i] = x[i]
        derivatives[0, i, i] = 1.0
    integrate_linearised(held, moved, level, u, PERIOD, SUBSTEPS, COULOMB_WIDTH, states, derivatives)
    end, F = states[1], derivatives[1]
    for i in range(6):
        for joint in range(3):
            F[i, TORQUE + joint] = F[i, ARM + joint] / u[0, joint]
            end[i] += F[i, TORQUE + joint] * x[TORQUE + joint]
        if not gripped:
            F[i, PAYLOAD] = 0.0
    _by_voltages(F, x, mean, later)


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


@kernel(uses=(dry_friction, dynamics, lanes, machine, machine_sensitivity))
def carry_machine(
    x: Array,
    volts: Array,
    locked: int,
    vector: Array,
    gripped: bool,
    commands: Array,
    acting: Array,
    mean: Array,
    end: Array,
    F: Array,
) -> None:
    """Writes what `MachineMotion.carry` gives, but for what a lock eliminates, to end (6,) and F (6, 27).

    Args:
        x: (33,), states before.
        volts: (3,), command that is held over the sample, V.
        locked: joint that is held where it is, 1 to 3, or 0.
        vector to mean: as in `MotionArrays`.
    """
    if not np.isfinite(acting).all():
        commands[:] = volts
    commands[:-1] = commands[1:]
    commands[-1] = volts
    p, before, slopes = vector.copy(), acting.copy(), np.empty((6, 10 if gripped else 9))
    for k in range(len(_OF_ARM)):
        p[_OF_ARM[k]] = x[ARM + k]
    share = 1.0 + x[SUPPLY]
    p[_OF_DELAY] += x[LATE] * PERIOD
    for i in range(3):
        p[_OF_K[i]] *= share
        p[_OF_TORQUE[i]] += x[TORQUE + i]
    for turn in range(_TURNS if locked else 1):
        end[:], acting[:] = x[:6], before
        linearise_machine(p, commands, x[PAYLOAD], acting, end, slopes)
        if locked and turn < _TURNS - 1:
            slope = slopes[W + locked - 1, 6 + locked - 1]
            if slope != 0.0:
                p[_OF_TORQUE[locked - 1]] -= end[W + locked - 1] / slope
    F[:] = 0.0
    F[:, :6], F[:, TORQUE:MOVING] = slopes[:, :6], slopes[:, 6:9]
    if gripped:
        F[:, PAYLOAD] = slopes[:, 9]
    later = np.zeros(3)
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
    _by_voltages(F, x, mean, later)


def _oppose(u: Array, x: Array, end: Array, F: Array, joint: int) -> None:
    """Changes the voltage of a locked joint to one that holds it, by Newton's method."""
    slope = F[W + joint, ARM + joint] / u[joint] * x[ARM + joint]
    if slope:
        u[joint] -= end[W + joint] / slope
        if abs(u[joint]) < _LEAST_VOLTS:
            u[joint] = _LEAST_VOLTS


def _hold(x: Array, end: Array, F: Array, joint: int) -> None:
    """Eliminates the torque that holds a locked joint from the derivatives, and what it has moved."""
    pushed = F[:, TORQUE + joint].copy()
    if pushed[W + joint]:
        F -= np.outer(pushed / pushed[W + joint], F[W + joint].copy())
    F[joint] = F[W + joint] = 0.0
    F[joint, joint] = 1.0
    end[joint], end[W + joint] = x[joint], 0.0


def _coefficients(arm: ArmParameters) -> tuple[Array, Array]:
    """The twin's coefficients (18,) of the empty arm and their derivatives (1, 18, 27) by the moving states.

    They are linear in K, D, mu and the payload; c and I are known to a few percent at worst.
    """
    vector = np.array(arm.vector())
    empty = np.array(coefficients(vector, 0.0, False))
    derivatives = np.zeros((1, len(empty), MOVING))
    for name in ARM_NAMES:
        stepped = vector + 1j * _COMPLEX_STEP * (np.array(PARAMETER_NAMES) == name)
        slope = np.imag(np.array(coefficients.py_func(stepped, 0.0, False))) / _COMPLEX_STEP
        derivatives[0, :, INDEX[name]] = slope
    derivatives[0, :, PAYLOAD] = np.array(coefficients(vector, 1.0, False)) - empty
    return empty, derivatives


_K: Final = INDEX["K1"]
_D: Final = INDEX["D1"]
_MU: Final = INDEX["mu1"]
_OF_K: Final = np.array([MACHINE_NAMES.index(f"K{joint}") for joint in (1, 2, 3)])
_OF_DELAY: Final = MACHINE_NAMES.index("delay")
_OF_ARM: Final = np.array([MACHINE_NAMES.index(name) for name in ARM_NAMES])
_OF_TORQUE: Final = np.array([MACHINE_NAMES.index(f"torque{joint}") for joint in (1, 2, 3)])
