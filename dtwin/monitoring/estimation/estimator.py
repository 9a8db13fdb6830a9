"""The state estimator: an extended Kalman filter on the analytic twin, driven by voltages and encoders.

It estimates the motion together with what the model is not sure of - parameters of the arm, the mass of the box, the
encoders' offsets - so that an error of the model within its stated uncertainty is learned instead of being reported.
The mean is carried by the twin's own map and the covariance by that map's derivative; see `motion` and `kernels`.

What the model does not explain of a healthy arm lasts: ripple, friction that depends on the angle, gears that yield.
A torque on each joint stands for it, a first-order Gauss-Markov process (Gelb, Applied Optimal Estimation, 1974).
Play moves a link without any torque, by steps that are new in every sample. A gear that yields swings after the
torque of its motor has jumped, faster than samples could show, and settles. Near standstill dry friction may be
anything up to its level, because whether a joint sticks depends on less than a filter knows of its velocity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation import following, kernels, stepping
from dtwin.monitoring.estimation.arrays import FILTER, Change, Clones, Evidence, Filters, Past
from dtwin.monitoring.estimation.belief import NOISE_FLOOR, Belief
from dtwin.monitoring.estimation.bounds import bounds, widened
from dtwin.monitoring.estimation.following import Course, Opening, Rows, Sizes, opening_of
from dtwin.monitoring.estimation.layout import (
    ARM,
    ARM_NAMES,
    BIAS,
    DRIFT,
    INDEX,
    LATE,
    MOVING,
    PAYLOAD,
    SIZE,
    TORQUE,
    W,
    unit_jump,
)
from dtwin.monitoring.estimation.motion import MotionArrays, motion_of
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.parameters import PERIOD

Array = NDArray[np.float64]

HANDLING: Final = 10
"""samples in which the jaws push the arm and the weight of a box comes or goes, after the gripper has changed"""
TOUCHING: Final = 100
"""samples after which the arm has left a box let go that lies at a finger, or has taken along one that it gripped"""
_JOLT: Final = 0.5
"""standard deviation of the joints' speeds after one of them was locked, relative to the speed it had"""


class Estimator:
    """Mean and covariance of the state after the last sample, and of what single states were before they changed.

    Args:
        belief: what is known of the healthy arm.
        tuning: how much the healthy arm may differ from moment to moment.

    Attributes:
        x: (33,), mean; see `layout`.
        P: (33, 33), covariance.
        F: (6, 27), derivatives over the last sample.
        gains: (3, 33), gains of the last correction.
        innovation: (3,), reading minus prediction, rad.
        variance: (3,), variance of the innovations, of the core of their distribution if its tails are heavy, rad^2.
        score: (3,), the innovations as they count, see `kernels.correct`, 1/rad.
        information: (3,), variance of the scores, 1/rad^2.
        memory: share that is left after a sample of a torque that the model does not explain.
        gripped: whether a box is held since the last prediction.
        handling: (5,), see `kernels.disturb`.
        box_mass: mass that a box is expected to have when it is gripped, kg.
        payload_variance: variance of that mass, kg^2.
    """

    def __init__(self, belief: Belief, tuning: Tuning) -> None:
        self.belief, self.tuning = belief, tuning
        arm = belief.arm
        self._motion, error = motion_of(belief), belief.error
        self._numbers = numbers = np.zeros(1, dtype=FILTER)
        self._name()
        numbers["noise"] = np.maximum(np.square(belief.noise), NOISE_FLOOR**2)
        numbers["clip"], numbers["friction"], numbers["compliance"] = (
            belief.clip,
            belief.dry_friction,
            error.compliance,
        )
        self._walk[BIAS:DRIFT] = tuning.offset_walk**2 * PERIOD
        for name in ARM_NAMES:
            share = max(tuning.walk, belief.walk(name))
            self._walk[INDEX[name]] = (share * arm.get(name)) ** 2 * PERIOD
        self.memory = math.exp(-PERIOD / error.memory)
        self._walk[TORQUE:MOVING] = np.square(error.slow) * (1.0 - self.memory**2)
        numbers["memory"], numbers["grip"] = self.memory, error.grip
        numbers["displacement"], numbers["timing"] = error.displacement, error.timing
        numbers["torque"], numbers["growth"] = np.square(error.white), PERIOD
        numbers["sine"], numbers["cosine"] = self._motion.sine, self._motion.cosine
        self._least[:], self._most[:] = bounds(arm, self._motion.arrays(False).rigid)
        numbers["lower"], numbers["upper"] = widened(self._least, self._most)
        self.box_mass = self.payload_variance = 0.0
        self.expect_boxes()
        self.x[ARM:PAYLOAD] = [arm.get(name) for name in ARM_NAMES]
        self.P[ARM:PAYLOAD, ARM:PAYLOAD] = belief.covariance
        self.x[BIAS:DRIFT] = belief.offset
        self.P[BIAS:DRIFT, BIAS:DRIFT] = np.diag(np.square(belief.offset_deviation))
        self.P[TORQUE:MOVING, TORQUE:MOVING] = np.diag(np.square(error.slow))
        self.variance[:] = 1.0
        self.gripped = False
        self._command[:] = np.nan
        self.handling[:] = 0.0, 0.0, np.nan, np.nan, np.nan
        self._cloned: tuple[str, ...] = ()
        self._clones, self._C, self._B = np.zeros(0), np.zeros((SIZE, 0)), np.zeros(0)

    def _name(self) -> None:
        """Gives its numbers names."""
        numbers = self._numbers
        self.x, self.P, self.F, self.gains = (numbers[name][0] for name in ("x", "P", "F", "gains"))
        self.innovation, self.variance = numbers["innovation"][0], numbers["variance"][0]
        self.score, self.information = numbers["score"][0], numbers["information"][0]
        self.handling, self._command, self._swing = (numbers[name][0] for name in ("handling", "command", "swing"))
        self._walk, self._growth, self._noise = (numbers[name][0] for name in ("walk", "growth", "noise"))
        self._least, self._most = numbers["least"][0], numbers["most"][0]

    def initialise(self, measured: Array, gripped: bool) -> None:
        """Starts at an arm about whose motion nothing is known but one sample; what was learned of the arm stays."""
        x, P = self.x, self.P
        x[:W] = measured - x[BIAS:DRIFT] - self._motion.eccentricity(measured)
        x[W:ARM] = 0.0
        P[:ARM], P[:, :ARM], self._C[:ARM] = 0.0, 0.0, 0.0
        self._motion.reset()
        self._command[:] = np.nan
        np.fill_diagonal(P[:W, :W], 1.0)
        np.fill_diagonal(P[W:ARM, W:ARM], self.tuning.speed**2)
        self._hold(gripped)
        self.correct(measured, np.ones(3, dtype=bool))

    def predict(self, volts: Array, gripped: bool, doubt: float = 0.0) -> None:
        """Carries the estimate over one period with a command (3,) V held, its torques in doubt by so much (N m)."""
        if gripped != self.gripped:
            self._hold(gripped)
        stepping.predict(self._numbers, self.motion_arrays(), volts, doubt)

    def correct(self, measured: Array, used: NDArray[np.bool_]) -> float:
        """Takes in a sample, (3,) rad; returns the logarithm of the likelihood of the readings used."""
        likelihood: float = stepping.correct(self._numbers, self._remembered(), measured, used)
        return likelihood

    def follow(self, rows: Rows, opening: Opening, sizes: Sizes, course: Course, tally: Array) -> None:
        """Carries the estimate over samples, the gripper unchanged, and adds up what they tell: see `following`."""
        gripped = bool(rows.gripped[0])
        if gripped != self.gripped:
            if course.opening:  # what is known of a box that is gripped takes the place of what was known before
                following.spread(self.P, self.x, opening)
                course = course._replace(opened=1)
            self._hold(gripped)
        own = self._numbers, self.motion_arrays(), self._remembered()
        following.follow(*own, rows, opening, sizes, course, tally)

    def weigh(self, joint: int) -> float:
        """The logarithm of the likelihood of a reading of a joint (0 to 2) of the last sample that was not used.

        Its score and information are those of the estimator from now on.
        """
        likelihood: float = stepping.weigh(self._numbers, joint)
        return likelihood

    def expected(self) -> tuple[Array, Array]:
        """The readings as they are expected now, (3,), and their standard deviations about that, (3,), rad."""
        angles, deviations = np.empty(3), np.empty(3)
        kernels.expect(self.x, self.P, self._motion.eccentricity(self.x[:W]), self._noise, angles, deviations)
        return angles, deviations

    def copy(self) -> Estimator:
        """An independent estimator in the same state."""
        other = object.__new__(Estimator)
        other.__dict__.update(self.__dict__)
        other._numbers, other._motion = self._numbers.copy(), self._motion.copy()
        other._clones, other._C, other._B = self._clones.copy(), self._C.copy(), self._B.copy()
        other._name()
        return other

    @property
    def plain(self) -> bool:
        """Whether all that a sample changes is in `arrays` and `motion_arrays`: nothing is wrong that is known."""
        return not (self.locked or self._numbers["scaled"].any() or self._cloned or self.unsteady)

    def arrays(self) -> Filters:
        """What the kernels of a sample work with; its own."""
        return self._numbers

    def _remembered(self) -> Clones:
        return Clones(self._clones, self._C, self._B)

    def motion_arrays(self) -> MotionArrays:
        """What carries the motion; its own."""
        return self._motion.arrays(self.gripped)

    def room(self, count: int) -> Past:
        """Room for what a plain estimator is at some samples."""
        rows = (np.empty((count, *each.shape)) for each in self._changing())
        return Past(np.zeros(count, dtype=bool), *rows)

    def fits(self, past: Past) -> bool:
        """Whether there is room for this estimator."""
        return past.commands.shape[1:] == self.motion_arrays().commands.shape

    def at(self, past: Past, row: int) -> Estimator:
        """The estimator as it was."""
        other = self.copy()
        for each, was in zip(other._changing(), past[1:], strict=True):
            each[:] = was[row]
        return other

    def _changing(self) -> tuple[Array, ...]:
        return (self.x, self.P, self._swing, self._command, self.handling, *self.motion_arrays()[-3:])

    def spread(self, deviations: Mapping[str, float]) -> None:
        """Lets states be off by more from now on, each by itself.

        Args:
            deviations: further standard deviations by state, in its unit.
        """
        following.spread(self.P, self.x, opening_of(deviations))
        self.doubt_box(deviations)

    def doubt_box(self, deviations: Mapping[str, float]) -> None:
        """Takes the mass of the next box to be as uncertain as that of one whose `payload` is off by a deviation."""
        if "payload" in deviations:
            self.payload_variance = max(self.payload_variance, deviations["payload"] ** 2)

    def shift(self, name: str, change: float) -> None:
        """Takes a state to be larger by so much, in its unit."""
        self.x += change * unit_jump(name, self.x)
        if name == "payload":
            self.box_mass += change

    def scale(self, joint: int) -> None:
        """Takes the reading of a joint (1 to 3) to be larger than the angle by a share, none so far; it is told by
        the state `scale` of the joint, which takes the place of the drift."""
        if not self._numbers["scaled"][0, joint - 1]:
            self.forget(f"drift{joint}")
            self._make_certain(DRIFT + joint - 1, 0.0)
            self._numbers["scaled"][0, joint - 1] = 1

    def lock(self, joint: int) -> None:
        """Takes a joint (1 to 3) to be held where it is now, 0 to be free again."""
        self._numbers["locked"] = joint
        jolt = max(_JOLT * abs(self.x[W + joint - 1]), 1e-3) if joint else 1.0
        for i in range(3):
            self.P[W + i, W + i] += jolt**2
        if joint:
            still = W + joint - 1
            self.P[joint - 1, joint - 1] += (jolt * PERIOD) ** 2
            self._make_certain(still, 0.0)

    def disturb(self, deviation: float) -> None:
        """Allows a torque (N m) of unknown cause on every joint, a new one in each sample."""
        self._numbers["torque"] = deviation**2

    def burden(self, deviation: float, *joints: int) -> None:
        """Takes the torques that last, see `Unmodelled.slow`, to be larger on some joints (1 to 3) by a standard
        deviation (N m)."""
        for index in (TORQUE + joint - 1 for joint in joints):
            self._walk[index] += deviation**2 * (1.0 - self.memory**2)
            self.P[index, index] += deviation**2

    def relieve(self, joint: int) -> None:
        """Takes the torque that lasts on a joint (1 to 3) to be that of a healthy arm again."""
        index, size = TORQUE + joint - 1, self.belief.error.slow[joint - 1]
        self._make_certain(index, 0.0)
        self.P[index, index] = size**2
        self._walk[index] = size**2 * (1.0 - self.memory**2)

    def lose(self, name: str) -> None:
        """Takes a voltage constant or the mass held to be zero; a lost box leaves the jaws as one that is let go."""
        self._make_certain(INDEX[name], 0.0)
        if name == "payload":
            self.box_mass = self.payload_variance = 0.0
            self.handling[:] = HANDLING, TOUCHING, np.nan, np.nan, np.nan

    def expect_boxes(self) -> None:
        """Takes the next boxes to be as boxes should be, and to move as they do on this arm."""
        load, tuning = self.belief.load, self.tuning
        self.box_mass, self.payload_variance = load * tuning.box_mass, (load * tuning.box_deviation) ** 2

    def remember(self, name: str) -> None:
        """Keeps what a state is now, to tell its change later; of a box, without one, what boxes are."""
        if name in self._cloned:
            return
        index = INDEX[name]
        waits = name == "payload" and not self.gripped
        self._cloned = (*self._cloned, name)
        self._clones = np.append(self._clones, self.box_mass if waits else self.x[index])
        self._C = np.ascontiguousarray(np.column_stack((self._C, self.P[index])))
        self._B = np.append(self._B, self.P[index, index])

    def forget(self, name: str) -> None:
        """Takes a state to have always been what it is now."""
        if name in self._cloned:
            place = self._cloned.index(name)
            self._cloned = (*self._cloned[:place], *self._cloned[place + 1 :])
            self._clones, self._B = np.delete(self._clones, place), np.delete(self._B, place)
            self._C = np.ascontiguousarray(np.delete(self._C, place, axis=1))

    def change(self, name: str) -> Change | None:
        """How a state has changed, within its bounds, since it was remembered; None if it was not."""
        if name not in self._cloned:
            return None
        place, index = self._cloned.index(name), INDEX[name]
        value, before = np.clip((self.x[index], self._clones[place]), self._least[index], self._most[index])
        variance = self.P[index, index] - 2.0 * self._C[index, place] + self._B[place]
        if index == LATE:
            value = math.hypot(value, self.unsteady)
        return Change(float(before), float(value), float(max(variance, 0.0) ** 0.5))

    def evidence(self) -> Evidence:
        """What the last sample tells of changes; the arrays are the estimator's own."""
        return Evidence(
            self.x,
            self._least,
            self._numbers["friction"][0],
            self.F,
            self.gains,
            self.score,
            self.information,
            self.memory,
            self._growth,
        )

    @property
    def unsteady(self) -> float:
        """Standard deviation of the delay of the commands from sample to sample, since some are lost, samples; what
        the delay has changed by is told as a root mean square then."""
        return float(self._numbers["unsteady"][0])

    @unsteady.setter
    def unsteady(self, deviation: float) -> None:
        self._numbers["unsteady"] = deviation

    @property
    def locked(self) -> int:
        """The joint that is held, 0 for none."""
        return int(self._numbers["locked"][0])

    def deviation(self, name: str) -> float:
        """Standard deviation of one state."""
        index = INDEX[name]
        return float(max(self.P[index, index], 0.0) ** 0.5)

    def _make_certain(self, index: int, value: float) -> None:
        self.x[index] = value
        self.P[index], self.P[:, index], self._C[index] = 0.0, 0.0, 0.0

    def _hold(self, gripped: bool) -> None:
        """A box is gripped or let go: of what is held now, only the prior is known."""
        if gripped != self.gripped:
            self.handling[1:] = TOUCHING, *(self.x[:W] if gripped else (np.nan,) * 3)
        self.gripped = gripped
        self._make_certain(PAYLOAD, self.box_mass if gripped else 0.0)
        self.P[PAYLOAD, PAYLOAD] = self.payload_variance if gripped else 0.0
        self.handling[0] = HANDLING
