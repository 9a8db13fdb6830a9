"""A whole sample of an estimator, compiled, whatever is wrong with its arm: one call, because what surrounds the
arithmetic takes longer than the arithmetic where many estimators follow the same samples."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays, derivatives, kernels, motion, rigid, traces
from dtwin.monitoring.estimation.arrays import Clones, Filters, MotionArrays
from dtwin.monitoring.estimation.layout import ARM, LATE, MOVING, SIZE, W
from dtwin.twin import dry_friction, dynamics, lanes, machine, machine_sensitivity, sensitivity
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]


@kernel(
    uses=(
        arrays,
        derivatives,
        dry_friction,
        dynamics,
        kernels,
        lanes,
        machine,
        machine_sensitivity,
        motion,
        rigid,
        sensitivity,
        traces,
    )
)
def predict(filters: Filters, m: MotionArrays, volts: Array, doubt: float) -> None:
    """Carries an estimate over one sample in place, see `Estimator.predict`; the gripper is unchanged.

    Args:
        filters, m: of the estimator.
        volts: (3,), command that is held, V.
        doubt: standard deviation of the torques that the command leaves in doubt, N m.
    """
    f = filters[0]
    possible, end = np.empty(SIZE), np.empty(6)
    torque, displaced, slowed = np.empty(3), np.empty(3), np.empty(3)
    kernels.bound(f.x, f.least, f.most, m.gripped, possible)
    # A view, since an array in a record has a type of its own, for which the motion would be compiled once more.
    motion.carry(possible, volts, m, f.locked, end, f.F[:])
    for i in range(3):
        if f.scaled[i]:
            f.growth[i] = end[i] - possible[i]
    kernels.carry(f.x, end, f.memory, f.growth)
    kernels.disturb(f, volts, m.later, doubt, torque, displaced, slowed)
    kernels.relate(f.P, f.x, f.scaled, -1.0)
    kernels.predict(f, torque, displaced, slowed)
    kernels.relate(f.P, f.x, f.scaled, 1.0)
    if f.unsteady != 0.0:
        for i in range(ARM):
            for j in range(ARM):
                f.P[i, j] += (f.unsteady * f.F[i, LATE]) * (f.unsteady * f.F[j, LATE])


@kernel(uses=(arrays, kernels, motion))
def correct(filters: Filters, clones: Clones, measured: Array, used: Any) -> float:
    """Takes a sample into an estimate in place, see `Estimator.correct`; returns the logarithm of its likelihood."""
    f, eccentric, angles = filters[0], np.empty(3), np.empty(3)
    motion.eccentricity(f.x[:W], f.sine, f.cosine, eccentric)
    for i in range(3):
        angles[i] = measured[i] - eccentric[i]
    likelihood: float = kernels.correct(f, angles, used)
    if len(clones.mean):
        kernels.follow_clones(clones, f, used)
    return likelihood


@kernel(uses=(arrays, kernels))
def weigh(filters: Filters, joint: int) -> float:
    """See `kernels.weigh`."""
    f = filters[0]
    found = f.innovation, f.variance, f.noise, f.clip, f.score, f.information
    likelihood: float = kernels.weigh(joint, *found)
    return likelihood


@kernel(
    uses=(arrays, derivatives, dry_friction, dynamics, kernels, lanes, machine, machine_sensitivity, motion, rigid)
)
def freed(filters: Filters, m: MotionArrays, joint: int, volts: Array) -> float:
    """The speed that a joint (0 to 2) would have after one sample if no joint were locked, rad/s."""
    f, possible, end, F = filters[0], np.empty(SIZE), np.empty(6), np.empty((ARM, MOVING))
    kernels.bound(f.x, f.least, f.most, m.gripped, possible)
    later, commands, acting, mean = m.later.copy(), m.commands.copy(), m.acting.copy(), m.mean.copy()
    apart = MotionArrays(m.rigid, m.twin, m.vector, m.gripped, later, commands, acting, mean)
    none = min(f.locked, 0)  # of the type that the motion is compiled for; the number itself has one of its own
    motion.carry(possible, volts, apart, none, end, F)
    return end[W + joint]
