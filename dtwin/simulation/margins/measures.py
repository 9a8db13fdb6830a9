"""Margins of a loop: how much its motors, their phase and their delay may change before it is unstable.

Loop at a time: one motor is changed, the others stay in closed loop. With the input sensitivity S = (I + L)^-1 the
loop that motor i closes has the return ratio 1 / S_ii - 1 (Skogestad and Postlethwaite, Multivariable Feedback
Control, ch. 9.2). All motors at once: the disk margin alpha = 1 / max mu(S - I/2) allows every motor at the same time
its own factor (1 + d/2) / (1 - d/2) with any complex |d| < alpha (Seiler, Packard and Gahinet, An Introduction to
Disk Margins, IEEE Control Systems 40, 2020, balanced disks). mu is bounded from above by scaling with diagonal
matrices, which is exact for three factors when the scaling is the best; the one found here by balancing rows and
columns (Osborne, J. ACM 7, 1960) is near it, and errs on the safe side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from dtwin.parameters import PERIOD, JointVector, every_joint, joint_vector
from dtwin.simulation.figures import Array
from dtwin.simulation.margins.loop import ComplexArray, Loop

LONGEST_DELAY: Final = 5.0
"""Delay in ticks up to which a delay margin is sought."""
_SLOWEST: Final = 0.2
"""Lowest frequency that is looked at, rad/s."""
_FREQUENCIES: Final = np.geomspace(_SLOWEST, math.pi / PERIOD * (1.0 - 1e-9), 200)
"""Frequencies at which the loop is looked at, rad/s."""
_ROUNDS: Final = 5
"""Number of rounds of balancing; more change the third digit at most."""
_DELAY_STEP: Final = 0.5
_DELAY_HALVINGS: Final = 8


@dataclass(frozen=True, slots=True)
class Margins:
    """Margins of a loop; all are 0 when it is not stable.

    Attributes:
        spectral_radius: largest absolute eigenvalue of one tick; stable below 1.
        disk: disk margin alpha of all motors at once.
        delay: delay of all motors at once at which the loop becomes unstable, ticks, at most what was looked for.
        weaker: share of its torque that each motor may lose, 1 for all of it.
        stronger: share of its torque that each motor may gain.
        phase: phase that each motor may lose or gain, degrees.
        sensitivity: largest absolute sensitivity at each motor.
    """

    spectral_radius: float
    disk: float
    delay: float
    weaker: JointVector
    stronger: JointVector
    phase: JointVector
    sensitivity: JointVector

    @property
    def gain(self) -> float:
        """Gain margin of the worst motor, up or down, dB."""
        up = 20.0 * math.log10(1.0 + min(self.stronger))
        down = -20.0 * math.log10(1.0 - max(min(self.weaker), 0.0)) if min(self.weaker) < 1.0 else math.inf
        return min(up, down)

    @property
    def torque(self) -> float:
        """Share of its torque by which any one motor may be weaker or stronger."""
        return min(*self.weaker, *self.stronger)


def margins(loop: Loop, longest_delay: float = LONGEST_DELAY) -> Margins:
    """Computes the margins of a loop; a delay margin is sought up to a number of ticks."""
    radius = loop.radius()
    if not radius < 1.0:
        return no_margins(radius)
    ratio = loop.returned(np.exp(1j * _FREQUENCIES * PERIOD))
    sensitivity: ComplexArray = np.linalg.inv(np.eye(3) + ratio)
    own = np.einsum("kii->ki", sensitivity)
    single = [1.0 / own[:, motor] - 1.0 for motor in range(3)]
    factors = [tolerated_factors(each) for each in single]
    return Margins(
        radius,
        disk_margin(sensitivity),
        delay_margin(loop, longest_delay),
        joint_vector(1.0 - low for low, _ in factors),
        joint_vector(high - 1.0 for _, high in factors),
        joint_vector(phase_margin(each) for each in single),
        joint_vector(np.abs(own).max(axis=0)),
    )


def no_margins(radius: float) -> Margins:
    """The margins of a loop of which no more than the spectral radius is known or good."""
    none = every_joint(0.0)
    return Margins(radius, 0.0, 0.0, none, none, none, (math.inf,) * 3)


def tolerated_factors(ratio: ComplexArray) -> tuple[float, float]:
    """The range of factors of a stable loop's return ratio, (N,) by frequency, in which it stays stable."""
    imaginary, real = ratio.imag, ratio.real
    before = np.flatnonzero(imaginary[:-1] * imaginary[1:] < 0)
    share = imaginary[before] / (imaginary[before] - imaginary[before + 1])
    crossings = np.append(real[before] + share * (real[before + 1] - real[before]), real[-1])
    factors = -1.0 / crossings[crossings < 0]
    return max(factors[factors < 1.0], default=0.0), min(factors[factors > 1.0], default=math.inf)


def phase_margin(ratio: ComplexArray) -> float:
    """Least angle, in degrees, between -1 and a stable loop's return ratio where that has the absolute value 1."""
    size = np.log(np.maximum(np.abs(ratio), 1e-300))
    before = np.flatnonzero(size[:-1] * size[1:] < 0)
    share = size[before] / (size[before] - size[before + 1])
    angles = np.unwrap(np.angle(-ratio))
    crossing = angles[before] + share * (angles[before + 1] - angles[before])
    away = np.abs((crossing + math.pi) % (2.0 * math.pi) - math.pi)
    return math.degrees(min(away, default=math.pi))


def disk_margin(sensitivity: ComplexArray) -> float:
    """Disk margin of a stable loop from its sensitivity, (N, m, m) by frequency."""
    count = sensitivity.shape[1]
    balanced = sensitivity - 0.5 * np.eye(count)
    weight: Array = np.abs(balanced) ** 2
    weight[:, range(count), range(count)] = 0.0
    scale = np.ones(weight.shape[:2])
    for _ in range(_ROUNDS if count > 1 else 0):
        for k in range(count):
            scaled = weight * scale[:, :, None] / scale[:, None, :]
            row, column = scaled[:, k, :].sum(axis=1), scaled[:, :, k].sum(axis=1)
            scale[:, k] *= np.sqrt(np.maximum(column, 1e-300) / np.maximum(row, 1e-300))
    root = np.sqrt(scale)
    bound = np.linalg.norm(balanced * root[:, :, None] / root[:, None, :], 2, axis=(1, 2))
    return 1.0 / float(bound.max())


def voltage_noise(loop: Loop) -> float:
    """Largest standard deviation of a motor's voltage in a stable loop whose encoders all have white noise, V/rad.

    The noise has the standard deviation 1 rad; the covariance of the states solves X = A X A' + B B' (Kwakernaak and
    Sivan, Linear Optimal Control Systems, 1972, theorem 6.9).
    """
    control, plant = loop.controller, loop.plant.sampled(loop.late)
    by_noise = np.vstack((plant.B @ control.D, control.B))
    states = solve_discrete_lyapunov(loop.closed(), by_noise @ by_noise.T)
    volts = np.hstack((control.D @ plant.C, control.C))
    return float(np.sqrt(np.diag(volts @ states @ volts.T + control.D @ control.D.T).max()))


def delay_margin(loop: Loop, longest: float = LONGEST_DELAY) -> float:
    """Delay of all motors, in ticks, at which a stable loop becomes unstable; the longest one when none does."""
    low = 0.0
    while low < longest and loop.radius(low + _DELAY_STEP) < 1.0:
        low += _DELAY_STEP
    if low >= longest:
        return longest
    high = low + _DELAY_STEP
    for _ in range(_DELAY_HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if loop.radius(middle) < 1.0 else (low, middle)
    return low
