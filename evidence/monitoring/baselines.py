"""What many use to notice faults of an arm, on the same data as the monitor: two residuals with fixed thresholds.

Both compare the torque that moves the arm with that of the rigid body whose parameters were identified. The momentum
observer filters the difference (De Luca and Mattone, Proc. IEEE Int. Conf. on Robotics and Automation, 2005); the
CUSUM adds up what it is more than usual (Page, Biometrika 41, 1954). They notice, and do not name. Their thresholds
are set for the rate of false alarms that the monitor is set for, from the same healthy log and by the same rule.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from dtwin.monitoring.calibration import SETTLING, tail_of
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.offline import Array, Stream
from dtwin.monitoring.settings import ALARMS_PER_HOUR
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.twin.dynamics import coriolis, friction, gravity, mass_matrix, motor_torque

Method = Literal["momentum observer", "CUSUM"]
METHODS: Final[tuple[Method, ...]] = ("momentum observer", "CUSUM")
"""What the monitor is compared with."""
_VELOCITY: Final = 100.0
"""Bandwidth of the filter of the velocity, rad/s: that of the controller's observer."""
_OBSERVER: Final = 20.0
"""Gain of the momentum observer, 1/s."""
_SLACK: Final = 0.5
"""Standard deviations by which the residual of the CUSUM may be off without being added up."""


@dataclass(frozen=True, slots=True, eq=False)
class Baseline:
    """A method whose threshold is set for an arm.

    Attributes:
        method: name of the method.
        arm: parameters that were identified.
        mean: mean of the residual of the healthy arm, (3,), N m.
        deviation: its standard deviation, (3,), N m.
        threshold: value of the statistic from which on something is wrong.
    """

    method: Method
    arm: ArmParameters
    mean: Array
    deviation: Array
    threshold: float

    def alarms(self, seen: Stream) -> Array:
        """The times at which the statistic passes the threshold, s."""
        above = self._statistic(seen) > self.threshold
        passes = above & ~np.concatenate(([False], above[:-1]))
        times: Array = seen.sample[passes].astype(np.float64) * PERIOD
        return times

    def _statistic(self, seen: Stream) -> Array:
        """The largest of the joints, (N,), in standard deviations; of the CUSUM, added up."""
        normal = (_residual(self.method, seen, self.arm) - self.mean) / self.deviation
        if self.method == "momentum observer":
            largest: Array = np.abs(normal).max(axis=1)
            return largest
        sums, found = np.zeros(6), np.zeros(len(seen))
        for row, both in enumerate(np.hstack((normal, -normal)) - _SLACK):
            sums = np.maximum(0.0, sums + both) if sums.max() <= self.threshold else np.zeros(6)
            found[row] = sums.max()
        return found


def baseline(method: Method, arm: ArmParameters, healthy: Stream) -> Baseline:
    """Sets a method for an arm.

    Args:
        method: name of the method.
        arm: parameters that were identified.
        healthy: log of the healthy arm at work, of more than 20 s.
    """
    residual = _residual(method, healthy, arm)[SETTLING:]
    found = Baseline(method, arm, residual.mean(axis=0), residual.std(axis=0), math.inf)
    tail = tail_of(found._statistic(healthy)[SETTLING:])
    threshold = tail.level + tail.excess * math.log(tail.rate / ALARMS_PER_HOUR)
    return Baseline(method, arm, found.mean, found.deviation, threshold)


def _residual(method: Method, seen: Stream, arm: ArmParameters) -> Array:
    """Torque on the joints that the identified arm does not explain, (N, 3), N m."""
    torque = _unexplained(seen, arm)
    if method == "CUSUM":
        return torque
    observed = np.zeros_like(torque)
    for row in range(1, len(torque)):
        observed[row] = observed[row - 1] + _OBSERVER * PERIOD * (torque[row] - observed[row - 1])
    return observed


def _unexplained(seen: Stream, arm: ArmParameters) -> Array:
    """M q'' + h + g + friction - K u of every sample and the one before, (N, 3), N m."""
    p, box, passed = np.array(arm.vector()), Tuning().box_mass, math.exp(-_VELOCITY * PERIOD)
    found, omega = np.zeros((len(seen), 3)), np.zeros(3)
    for row in range(1, len(seen)):
        before, theta = seen.measured[row - 1], seen.measured[row]
        payload = box if seen.gripped[row - 1] else 0.0
        faster = passed * omega + (1.0 - passed) * (theta - before) / PERIOD
        inertial = mass_matrix(before, p, payload) @ (faster - omega) / PERIOD
        moved = coriolis(before, omega, p, payload) + gravity(before, p, payload) + friction(omega, p)
        found[row] = inertial + moved - motor_torque(seen.volts[row - 1, :3], p)
        omega = faster
    return found
