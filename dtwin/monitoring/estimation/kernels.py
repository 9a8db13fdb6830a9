"""The arithmetic of one sample, compiled: an extended Kalman filter and the signatures that faults leave in it.

A fault is a jump of one component of the state vector at some time: the voltage constant, the friction, the mass held
or an encoder's offset is suddenly another. Before the filter has noticed, the error e of its estimate obeys the
filter's own linear map,

    e <- F e (prediction),    e <- e - k (H e) (correction),

so a unit jump leaves a known trace g = H e in the innovations, and the size of the jump that explains them best and
its log-likelihood ratio follow from two running sums (Willsky and Jones, A generalized likelihood ratio approach to
the detection and estimation of jumps in linear systems, 1976):

    J = sum g^2 / s,   h = sum g nu / s,   size = h / J +- 1 / sqrt(J),   2 log ratio = h^2 / J.

Arguments of all kernels: x (33,) and P (33, 33), mean and covariance of the state (see `layout`); F (6, 27),
derivatives of q and w after a sample by the moving states before it.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import arrays
from dtwin.monitoring.estimation.arrays import Clones, Filter
from dtwin.monitoring.estimation.layout import ARM, BIAS, DRIFT, MOVING, PAYLOAD, SIZE, TORQUE, W
from dtwin.monitoring.estimation.traces import STANDSTILL
from dtwin.parameters import PERIOD
from dtwin.twin.compiled import kernel

Array = NDArray[np.float64]

SWING: Final = 0.1
"""s: time after which a share of 1/e of a gear's swing is left: twice the rotor's inertia over the gear's damping"""
SETTLED: Final = math.exp(-2.0 * PERIOD / SWING)
_TOUCH: Final = 0.1
"""Share of the torques of a box that is handled with which one that was let go may still hold a finger back, or what
one stands on that is gripped may still carry it."""
_LEFT: Final = 0.03
"""rad from where a box was gripped after which it has left what it stood on"""


@kernel
def huber(clip: float) -> tuple[float, float]:
    """What `correct` needs to know of Huber's density with a clip (standard deviations).

    With phi and Phi of the normal distribution the density is exp(-rho(z)) / (sqrt(2 pi) c), where rho grows as
    z^2 / 2 up to the clip k and linearly from there, and c = 2 Phi(k) - 1 + 2 phi(k) / k. Its information is
    (2 Phi(k) - 1) / c (Huber, Robust estimation of a location parameter, Annals of Mathematical Statistics 35, 1964).

    Returns:
        the information, which is 1 for a normal distribution, and the logarithm of c.
    """
    if clip == math.inf:
        return 1.0, 0.0
    core = math.erf(clip / math.sqrt(2.0))
    whole = core + 2.0 * math.exp(-0.5 * clip * clip) / (math.sqrt(2.0 * math.pi) * clip)
    return core / whole, math.log(whole)


@kernel
def bound(x: Array, least: Array, most: Array, gripped: bool, found: Array) -> None:
    """Writes the state (33,) within its bounds, without a box if none is gripped."""
    for i in range(SIZE):
        found[i] = min(max(x[i], least[i]), most[i])
    if not gripped:
        found[PAYLOAD] = 0.0


@kernel
def carry(x: Array, end: Array, memory: float, growth: Array) -> None:
    """Carries the mean over one sample, in place, at whose end q and w are `end` (6,); see `predict`."""
    for i in range(6):
        x[i] = end[i]
    for i in range(3):
        x[BIAS + i] += growth[i] * x[DRIFT + i]
        x[TORQUE + i] *= memory


@kernel
def expect(x: Array, P: Array, eccentricity: Array, noise: Array, angles: Array, deviations: Array) -> None:
    """Writes the readings that are expected, (3,) rad, and their standard deviations, (3,) rad.

    Args:
        x: mean.
        P: covariance.
        eccentricity: (3,), what eccentric encoders add to the angles, rad.
        noise: (3,), variances, rad^2.
        angles: (3,), receives the readings.
        deviations: (3,), receives their deviations.
    """
    for i in range(3):
        angles[i] = x[i] + eccentricity[i] + x[BIAS + i]
        deviations[i] = math.sqrt(P[i, i] + 2.0 * P[i, BIAS + i] + P[BIAS + i, BIAS + i] + noise[i])


@kernel
def disturb(
    f: Filter, volts: Array, later: Array, doubt: float, torque: Array, displaced: Array, slowed: Array
) -> None:
    """Writes the variances of what disturbs the arm: torques (3,), (N m)^2, and displacements (3,), rad^2.

    The derivative of a joint that dry friction holds says that its speed is known, however little was known of it
    before. That is right of a joint that stands. One that may move has only become slower, by about STANDSTILL in a
    sample, and one that a box pushes not even that. What damping takes besides is left out: too little is known then.

    Args:
        f: of the estimator at the end of the sample; its command, handling and swing are replaced.
        volts: (3,), command that is held, V.
        later: (3,), by how much the mean voltages were larger in the sample before, V.
        doubt: standard deviation of the torques that the command leaves in doubt, N m.
        torque, displaced: receive the variances.
        slowed: (3,), receives by what the standard deviation of a speed may shrink at most, rad/s.
    """
    x, last, handling, swing = f.x, f.command, f.handling, f.swing
    extra = doubt * doubt
    handled = handling[0] > 0
    if handled:
        extra += f.grip * f.grip
    elif handling[1] > 0:
        extra += _TOUCH * _TOUCH * f.grip * f.grip
    for k in range(2):
        handling[k] = max(handling[k] - 1.0, 0.0)
    for i in range(3):
        if abs(x[i] - handling[2 + i]) > _LEFT:
            handling[1] = 0.0
        friction = f.friction[i]
        slowed[i] = math.inf if friction == 0.0 else 0.0 if handled else STANDSTILL
        slow = x[W + i] / STANDSTILL
        moved = x[ARM + i] * later[i] * f.timing / PERIOD
        torque[i] = f.torque[i] + extra + friction * friction * math.exp(-slow * slow) + moved * moved
        if math.isfinite(last[i]):
            swing[i] = swung(swing[i], f.compliance[i] * x[ARM + i] * (volts[i] - last[i]))
        displaced[i] = f.displacement * f.displacement + swing[i]
        last[i] = volts[i]


@kernel
def swung(swing: float, jump: float) -> float:
    """Mean square of the swing of a gear after a sample at which it swings by so much more."""
    return SETTLED * swing + jump * jump


@kernel(uses=(arrays,))
def predict(f: Filter, torque: Array, displacement: Array, slowed: Array) -> None:
    """Carries the covariance over one sample, in place.

    Args:
        f: of the estimator, with the derivatives over the sample.
        torque: (3,), variance of the torque that no model knows, held over the sample, (N m)^2.
        displacement: (3,), variance that the angles gain in the sample without any torque, rad^2.
        slowed: (3,), by what the standard deviation of a speed may shrink at most, rad/s.
    """
    P, F, memory, growth = f.P, f.F, f.memory, f.growth
    speeds = np.empty(3)
    for i in range(3):
        speeds[i] = P[W + i, W + i]
    top = F @ np.ascontiguousarray(P[:MOVING])
    corner = np.ascontiguousarray(top[:, :MOVING]) @ F.T
    for joint in range(3):
        for i in range(6):
            spread = F[i, TORQUE + joint] * torque[joint]
            for j in range(6):
                corner[i, j] += spread * F[j, TORQUE + joint]
    P[:6, 6:] = top[:, 6:]
    P[6:, :6] = top[:, 6:].T
    for i in range(6):
        for j in range(i + 1):
            P[i, j] = P[j, i] = 0.5 * (corner[i, j] + corner[j, i])
    for i in range(3):
        P[i, i] += displacement[i]
        least = max(math.sqrt(speeds[i]) - slowed[i], 0.0)
        lost = least * least - P[W + i, W + i]
        if lost > 0.0:  # by an unknown torque that is held over the sample
            P[W + i, W + i] += lost
            P[i, i] += 0.25 * PERIOD * PERIOD * lost
            P[i, W + i] += 0.5 * PERIOD * lost
            P[W + i, i] += 0.5 * PERIOD * lost
    for i in range(3):
        for j in range(SIZE):
            P[BIAS + i, j] += growth[i] * P[DRIFT + i, j]
    for i in range(3):
        for j in range(SIZE):
            P[j, BIAS + i] += growth[i] * P[j, DRIFT + i]
    for i in range(TORQUE, MOVING):
        for j in range(SIZE):
            P[i, j] *= memory
        for j in range(SIZE):
            P[j, i] *= memory
    for i in range(SIZE):
        P[i, i] += f.walk[i]


@kernel
def relate(P: Array, x: Array, scaled: Any, sign: float) -> None:
    """Takes out of, or puts into, offsets what they share with the angles that they are proportional to.

    While the arm moves, the error of such an offset changes with that of its angle: what is left without it stays.

    Args:
        P: covariance, in place.
        x: state.
        scaled: (3,), not 0 for the joints whose encoders have another scale.
        sign: -1 takes out, 1 puts in.
    """
    for i in range(3):
        if scaled[i]:
            share = sign * x[DRIFT + i]
            for j in range(SIZE):
                P[BIAS + i, j] += share * P[i, j]
            for j in range(SIZE):
                P[j, BIAS + i] += share * P[j, i]


@kernel
def _covariance(P: Array, i: int, columns: Array, shares: Array) -> None:
    """Writes the covariance of all states with reading i, (33,), after the readings before it have shrunk P."""
    for j in range(SIZE):
        angle, bias = P[j, i], P[j, BIAS + i]
        for before in range(i):
            angle -= (columns[before, j] * columns[before, i]) * shares[before]
            bias -= (columns[before, j] * columns[before, BIAS + i]) * shares[before]
        columns[i, j] = angle + bias


@kernel
def _shrink(P: Array, columns: Array, shares: Array) -> None:
    """P -= column column^T share for each of three, symmetric to the last bit: an asymmetry would grow."""
    first, second, third = columns[0], columns[1], columns[2]
    for j in range(SIZE):
        for k in range(SIZE):
            left = P[j, k] - (first[j] * first[k]) * shares[0]
            P[j, k] = left - (second[j] * second[k]) * shares[1] - (third[j] * third[k]) * shares[2]


@kernel
def weigh(
    i: int, innovation: Array, variance: Array, noise: Array, clip: Array, score: Array, information: Array
) -> float:
    """Fills in score and information of one reading; returns the logarithm of its likelihood. See `correct`."""
    nu, s = innovation[i], variance[i]
    limit = clip[i] * math.sqrt(s / noise[i])
    share, constant = huber(limit)
    most = limit * math.sqrt(s)
    counted = min(max(nu, -most), most)
    score[i] = counted * (1.0 / s)
    information[i] = share / s
    return -0.5 * (counted * (2.0 * nu - counted) / s + math.log(2.0 * math.pi * s)) - constant


@kernel(uses=(arrays,))
def correct(f: Filter, measured: Array, used: Any) -> float:
    """Takes in three encoder readings one after another, which whitens them, in place.

    An innovation nu of variance s is believed to have Huber's density of the same core: beyond clip standard
    deviations its tails are exponential. The estimate moves by the score of that density, psi(nu) / s with psi
    limited to the clip, and the covariance shrinks by the slope of the score, which is 1 / s within the clip and
    nothing beyond (Masreliez, Approximate non-Gaussian filtering with linear state and observation relations, IEEE
    TAC 20, 1975). The more of s is the uncertainty of the state, which is normal, the larger is the clip; with an
    infinite one this is the Kalman filter.

    Args:
        f: of the estimator; mean and covariance, and what is told of the innovations, are replaced.
        measured: (3,), rad.
        used: (3,) bool, which readings to take in.

    Returns:
        the logarithm of the readings' likelihood.
    """
    x, P, gains, noise, clip, lower, upper = f.x, f.P, f.gains, f.noise, f.clip, f.lower, f.upper
    innovation, variance, score, information = f.innovation, f.variance, f.score, f.information
    likelihood = 0.0
    columns, shares = np.empty((3, SIZE)), np.zeros(3)
    for i in range(3):
        _covariance(P, i, columns, shares)
        column = columns[i]
        s = column[i] + column[BIAS + i] + noise[i]
        nu = measured[i] - x[i] - x[BIAS + i]
        innovation[i] = nu
        variance[i] = s
        if not used[i]:
            gains[i] = 0.0
            continue
        likelihood += weigh(i, innovation, variance, noise, clip, score, information)
        counted = score[i] * s
        for j in range(SIZE):
            gains[i, j] = column[j] / s
            x[j] += gains[i, j] * counted
        if abs(nu) <= clip[i] * s / math.sqrt(noise[i]):
            shares[i] = 1.0 / s
        else:
            gains[i] = 0.0
    _shrink(P, columns, shares)
    for j in range(SIZE):
        x[j] = min(max(x[j], lower[j]), upper[j])
    return likelihood


@kernel(uses=(arrays,))
def follow_clones(clones: Clones, f: Filter, used: Any) -> None:
    """Carries what states were at earlier moments over one sample, in place (stochastic cloning, Roumeliotis and
    Burdick 2002): a clone stands still, but what is measured later tells more of it.

    Args:
        clones: what is known of them.
        f: of the estimator after the sample.
        used: (3,) bool, which readings the filter took in.
    """
    C, gains = clones.C, f.gains
    C[:6] = f.F @ C[:MOVING]
    C[TORQUE:MOVING] *= f.memory
    for i in range(3):
        C[BIAS + i] += f.growth[i] * C[DRIFT + i]
    for i in range(3):
        if not used[i]:
            continue
        for c in range(len(clones.mean)):
            covariance = C[i, c] + C[BIAS + i, c]
            clones.mean[c] += covariance * f.score[i]
            if gains[i].any():
                clones.B[c] -= covariance * covariance / f.variance[i]
            for j in range(SIZE):
                C[j, c] -= gains[i, j] * covariance
