"""The motion of an arm that obeys the equations of motion, over one sample."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays, derivatives
from dtwin.monitoring.estimation.arrays import MotionArrays, TwinArrays
from dtwin.monitoring.estimation.derivatives import by_voltages, hold
from dtwin.monitoring.estimation.layout import ARM, ARM_NAMES, INDEX, LATE, MOVING, PAYLOAD, SIZE, SUPPLY, TORQUE, W
from dtwin.parameters import COULOMB_WIDTH, PARAMETER_NAMES, PERIOD, VOLTAGE_LIMIT, ArmParameters
from dtwin.twin import sensitivity
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import coefficients
from dtwin.twin.machine import MACHINE_NAMES
from dtwin.twin.rollout import Steps
from dtwin.twin.sensitivity import integrate_linearised

Array = NDArray[np.float64]

SUBSTEPS: Final = 4
"""RK4 steps a sample, as in the emulation"""
STABLE: Final = 0.23
"""N m s/rad: more viscous friction than this makes such steps unstable"""
TURNS: Final = 3
"""steps of Newton's method that find the torque that holds a locked joint"""
_D: Final = INDEX["D1"]
_COMPLEX_STEP: Final = 1e-30
_LEAST_VOLTS: Final = 1e-6
"""V: the derivative by a torque is that by the voltage constant divided by the voltage; this little moves nothing"""
_NO_ECCENTRICITY: Final = np.zeros(3)
_UNUSED: Final = np.zeros(3)
_UNCHANGED: Final = np.zeros(3)
"""V: when a voltage changes is known exactly of an arm without effects"""
_NO_MACHINE: Final = np.zeros(len(MACHINE_NAMES))


class RigidMotion:
    """The motion of an arm that obeys the equations of motion; it remembers the last command."""

    sine = cosine = _NO_ECCENTRICITY

    def __init__(self, arm: ArmParameters) -> None:
        empty, moved = _coefficients(arm)
        nominal = np.zeros(SIZE)
        nominal[ARM:PAYLOAD] = [arm.get(name) for name in ARM_NAMES]
        self._twin = TwinArrays(empty, moved, nominal)
        self._last = np.full((1, 3), np.nan)

    def reset(self) -> None:
        """See `Motion.reset`."""
        self._last[:] = np.nan

    def eccentricity(self, angles: Array) -> Array:
        """None."""
        return _NO_ECCENTRICITY

    def arrays(self, gripped: bool) -> MotionArrays:
        """See `Motion.arrays`."""
        return MotionArrays(True, self._twin, _NO_MACHINE, gripped, _UNCHANGED, self._last, _UNUSED, _UNUSED)

    def copy(self) -> RigidMotion:
        """See `Motion.copy`."""
        other = object.__new__(RigidMotion)
        other._twin, other._last = self._twin, self._last.copy()
        return other


@kernel
def _substeps(x: Array) -> int:
    """Number of RK4 steps in which a sample of an arm with states x (33,) is stable."""
    return SUBSTEPS * max(1, math.ceil(max(x[_D], x[_D + 1], x[_D + 2]) / STABLE))


@kernel
def _oppose(u: Array, x: Array, end: Array, F: Array, joint: int) -> None:
    """Changes the voltage of a locked joint to one that holds it, by Newton's method."""
    slope = F[W + joint, ARM + joint] / u[joint] * x[ARM + joint]
    if slope != 0.0:
        u[joint] -= end[W + joint] / slope
        if abs(u[joint]) < _LEAST_VOLTS:
            u[joint] = _LEAST_VOLTS


@kernel(uses=(arrays, derivatives, sensitivity))
def carry_rigid(x: Array, volts: Array, locked: int, m: MotionArrays, end: Array, F: Array) -> None:
    """What `motion.carry` does for such an arm; the command is written to those of m."""
    twin, last = m.twin, m.commands
    u, held, mean, later = np.empty((1, 3)), np.empty((1, 18)), np.empty(3), np.empty(3)
    states, slopes, level = np.empty((2, 6)), np.empty((2, 6, MOVING)), np.zeros(1, dtype=np.int64)
    slopes[0] = 0.0
    for i in range(3):
        meant = min(max(volts[i], -VOLTAGE_LIMIT), VOLTAGE_LIMIT)
        before = volts[i] if math.isnan(last[0, i]) else last[0, i]
        last[0, i] = volts[i]
        later[i] = min(max(before, -VOLTAGE_LIMIT), VOLTAGE_LIMIT) - meant
        mean[i] = meant + x[LATE] * later[i]
        u[0, i] = (1.0 + x[SUPPLY]) * mean[i]
        if abs(u[0, i]) < _LEAST_VOLTS:
            u[0, i] = _LEAST_VOLTS
    for k in range(18):
        held[0, k] = twin.empty[k]
        for j in range(ARM, MOVING):
            held[0, k] += twin.moved[0, k, j] * (x[j] - twin.nominal[j])
    for i in range(6):
        states[0, i] = x[i]
        slopes[0, i, i] = 1.0
    steps = Steps(PERIOD, _substeps(x), COULOMB_WIDTH)
    for _ in range(TURNS if locked else 1):
        integrate_linearised(held, twin.moved, level, u, steps, states, slopes)
        if locked:
            _oppose(u[0], x, states[1], slopes[1], locked - 1)
    end[:], F[:] = states[1], slopes[1]
    for i in range(6):
        for joint in range(3):
            F[i, TORQUE + joint] = F[i, ARM + joint] / u[0, joint]
            end[i] += F[i, TORQUE + joint] * x[TORQUE + joint]
        if not m.gripped:
            F[i, PAYLOAD] = 0.0
    by_voltages(F, x, mean, later)
    if locked:
        hold(x, end, F, locked - 1)


def _coefficients(arm: ArmParameters) -> tuple[Array, Array]:
    """The twin's coefficients (18,) of the empty arm and their derivatives (1, 18, 27) by the moving states.

    They are linear in K, D, mu and the payload; c and I are known to a few percent at worst.
    """
    vector = np.array(arm.vector())
    empty = np.array(coefficients(vector, 0.0, False))
    moved = np.zeros((1, len(empty), MOVING))
    for name in ARM_NAMES:
        stepped = vector + 1j * _COMPLEX_STEP * (np.array(PARAMETER_NAMES) == name)
        slope = np.imag(np.array(coefficients.py_func(stepped, 0.0, False))) / _COMPLEX_STEP
        moved[0, :, INDEX[name]] = slope
    moved[0, :, PAYLOAD] = np.array(coefficients(vector, 1.0, False)) - empty
    return empty, moved
