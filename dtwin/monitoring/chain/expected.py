"""What the drives of an arm are expected to need for its motion, and how each cause would change it.

The command is linear in the parameters of links, rotors and friction (Atkeson, An and Hollerbach 1986). They are
learned on a healthy stretch by least squares with the tolerances of the arm as what was known before, so that
parameters that its motion does not show stay at the data sheet's.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import factorial
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dtwin.arm.chain import Arm, Array, steiner
from dtwin.arm.poses import drawn_poses
from dtwin.equations.rigid import inverse_dynamics, regressor
from dtwin.errors import RecordingError
from dtwin.monitoring.chain.unknown import Indices, starts_of, without

WINDOW: Final = 11
"""Samples of the filter (Savitzky and Golay 1964) by which positions become velocities and accelerations."""
_DEGREE: Final = 3
"""Degree of the polynomial that it lays through them."""
EVERY: Final = 5
"""One filtered sample of so many is used: neighbours share most of their noise."""
BLOCK: Final = 2.0
"""Stretch that counts as one independent observation for the covariance, s."""
_STEP: Final = 1e-6
_FAINT: Final = 1e-4
"""Least noise of a drive, in parts of its largest command: one that has hardly moved has shown next to none."""
_USUAL: Final = 0.5
"""Speed at which friction is compared, in parts of the joint's largest one."""
_SHARES: Final = (1.0 / 3.0, 3.0)
"""Least and largest friction of an arm that a data sheet may be the one of, in parts of the data sheet's."""
_POSES: Final = 32
_SLOW: Final = 0.02
"""Speed below which nobody knows which way dry friction acts, in parts of the joint's largest speed."""


@dataclass(frozen=True, slots=True, eq=False)
class Filtered:
    """A log at every EVERY-th sample.

    Attributes:
        t: times, (N,), s.
        q: positions, (N, n).
        qd: velocities, (N, n).
        qdd: accelerations, (N, n).
        effort: commands that act, (N, n), in the units of the drives; 0 where they are not known.
        known: where the commands count, (N,).
        held: number of what the gripper holds, whose mass nobody knows, (N,); 0 for nothing.
    """

    t: Array
    q: Array
    qd: Array
    qdd: Array
    effort: Array
    known: NDArray[np.bool_]
    held: NDArray[np.intp]


def filtered(arm: Arm, t: Array, q: Array, effort: Array, held: NDArray[np.intp] | None = None) -> Filtered:
    """Filters a log.

    Args:
        arm: the arm.
        t: times, (N,), s.
        q: positions, (N, n).
        effort: what acts at the samples, (N, n); NaN where it does not count.
        held: number of what the gripper holds, (N,), 0 for nothing; nothing if None.

    Raises:
        RecordingError: it is shorter than the filter.
    """
    if len(t) < WINDOW:
        raise RecordingError(f"expected at least {WINDOW} samples, got {len(t)}")
    half = WINDOW // 2
    weights = _filter(arm.period)
    positions, efforts = (sliding_window_view(values, WINDOW, axis=0)[::EVERY] for values in (q, effort))
    q, qd, qdd = np.einsum("njw,ow->onj", positions, weights)
    acting = np.einsum("njw,w->nj", efforts, weights[0])
    numbers = np.zeros(len(t), dtype=np.intp) if held is None else held
    carried = sliding_window_view(numbers, WINDOW)[::EVERY]
    known = np.isfinite(acting).all(axis=1) & (carried.min(axis=1) == carried.max(axis=1))
    effort = np.where(known[:, None], acting, 0.0)
    return Filtered(t[half : len(t) - half : EVERY], q, qd, qdd, effort, known, carried[:, half])


@lru_cache(maxsize=8)
def _filter(period: float) -> Array:
    """Weights of the samples in a window for the value in its middle, its change and the change of that, (3, WINDOW).

    Only windows that are full count, so that samples are filtered alike however many come at once.
    """
    offsets = np.arange(WINDOW, dtype=float) - WINDOW // 2
    derivatives = np.diag([factorial(order) / period**order for order in range(_DEGREE + 1)])[:, :3]
    found: Array = np.linalg.lstsq(np.vander(offsets, _DEGREE + 1, increasing=True).T, derivatives, rcond=None)[0].T
    return found


class Expected:
    """An arm as its data sheet says, and as its motion has shown.

    Args:
        arm: the arm; the constants of its drives must be known.

    Attributes:
        noise: usual difference of command and expectation, (n,), in the units of the drives; set by `learn`.
        values: parameters of links (10 n), rotors, viscous, dry and load-dependent friction, and offsets (n each), as
            torques by the data sheet's constants; set by `learn`.
        covariance: of these, (15 n, 15 n); set by `learn`.
    """

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._constant = np.array([joint.actuator.constant or 1.0 for joint in arm.joints])
        self._rotor = np.array([joint.actuator.rotor or 0.0 for joint in arm.joints])
        self._viscous = np.array([joint.friction.viscous for joint in arm.joints])
        self._coulomb = np.array([joint.friction.coulomb for joint in arm.joints])
        self._slow = _SLOW * np.array([joint.speed for joint in arm.joints])
        tool = arm.tool
        self._mass = np.array([1.0, *tool, *steiner(tool)[np.tril_indices(3)]])
        self._mean, self._deviation = self._known()
        self._carried = _carried(arm)
        load = np.array([joint.friction.load for joint in arm.joints])
        self._held = (self._coulomb + load * self._carried) / np.abs(self._constant)
        self.values = self._mean.copy()
        self.covariance = np.diag(self._deviation**2)
        self._now = self.values.copy()
        self.noise = np.ones(len(arm))

    def recall(self, values: Array, covariance: Array, noise: Array) -> None:
        """Takes what an earlier stretch has shown."""
        self.values, self.covariance, self.noise = values, covariance, noise
        self._now = values.copy()

    def learn(self, log: Filtered) -> None:
        """Takes the parameters and the noise from a healthy stretch, beside what is held.

        Residuals follow one another, so that the covariance counts them in blocks (White 1980).
        """
        columns = self._columns(log)
        for _ in range(2):  # the second time with the noise that the first has found
            weights = self._weights(log)
            precision = np.diag(1.0 / self._deviation**2)
            rest = log.effort - columns @ self._mean
            scaled, rest = self._known_of(log.held, columns, rest, weights / self.noise)
            flat = scaled.reshape(-1, columns.shape[2])
            curvature = flat.T @ flat + precision
            found = np.linalg.solve(curvature, flat.T @ rest.ravel())
            self.values = self._mean + found
            counted = np.maximum(1.0, np.sum(weights**2, axis=0))
            left = rest - scaled @ found
            scores = np.einsum("njp,nj->np", scaled, left)
            spread = self.noise * np.sqrt(np.sum(left**2, axis=0) / counted)
            self.noise = np.maximum(spread, _faint(self._arm))
        rows = max(1, round(BLOCK / (EVERY * self._arm.period)))
        sums = np.add.reduceat(scores, np.arange(0, len(scores), rows), axis=0)
        inverse = np.linalg.inv(curvature)
        self.covariance = inverse @ (sums.T @ sums + precision) @ inverse
        self._now = self.values.copy()

    def _known_of(self, held: Indices, columns: Array, rest: Array, scale: Array) -> tuple[Array, Array]:
        """Columns, (N, n, p), and what is left of commands, (N, n), scaled, without what the loads held explain."""
        columns, rest = columns * scale[:, :, None], rest * scale
        if not held.any():
            return columns, rest
        last = slice(10 * (len(self._arm) - 1), 10 * len(self._arm))
        part, starts = np.where(held[:, None] > 0, columns[:, :, last] @ self._mass, 0.0), starts_of(held)
        return without(part, starts, columns), without(part, starts, rest[:, :, None])[:, :, 0]

    @property
    def share(self) -> Array:
        """The friction that was learned of every joint in parts of the data sheet's, (n,), within `_SHARES`.

        It is taken at half of the joint's largest speed, under the usual weight of the arm; 1 where the data sheet
        has no friction.
        """
        learned, sheet = self._lost(self.values), self._lost(self._mean)
        found: Array = np.clip(np.divide(learned, sheet, out=np.ones_like(sheet), where=sheet > 0.0), *_SHARES)
        return found

    @property
    def dry(self) -> Array:
        """What dry friction holds of every joint under the usual weight of the arm, (n,), in the units of the drives.

        That of the data sheet, or what was learned if that is more.
        """
        viscous = len(self._arm) * 12
        sides = (values[viscous:][: 2 * len(self._arm)].reshape(2, -1) for values in (self.values, self._mean))
        found: Array = np.max([dry + load * self._carried for dry, load in sides], axis=0) / np.abs(self._constant)
        return found

    def _lost(self, values: Array) -> Array:
        """Torque of friction, (n,), N m or N."""
        viscous, dry, load = values[11 * len(self._arm) : 14 * len(self._arm)].reshape(3, -1)
        found: Array = viscous * (_USUAL / _SLOW * self._slow) + dry + load * self._carried
        return found

    def adjust(self, friction: Array, load: float) -> None:
        """Counts on other friction and on a further load.

        Args:
            friction: what the blocks count on, (n,), in parts of the data sheet's: what they count on beyond 1 has
                come to what was learned.
            load: kg.
        """
        n = len(self._arm)
        self._now = self.values.copy()
        self._now[11 * n : 14 * n] *= np.tile(1.0 + (friction - 1.0) / self.share, 3)
        self._now[10 * (n - 1) : 10 * n] += load * self._mass

    def needed(self, log: Filtered) -> Array:
        """What the drives need for the motion of a log, (N, n), in their units."""
        found: Array = self._columns(log) @ self._now
        return found

    def innovation(self, log: Filtered) -> Array:
        """What the commands are beyond that, (N, n), in parts of the noise; 0 where nobody knows."""
        found: Array = self._weights(log) / self.noise * (log.effort - self.needed(log))
        return found

    def evidence(self, log: Filtered) -> tuple[Array, dict[str, Array]]:
        """What the commands are beyond their expectation, (N, n), in parts of the noise; 0 where nobody knows.

        And what each cause adds to this innovation for a unit of its size, (N, n), by its name.

        K1: part of the constant of the drive of joint 1 that was lost; friction1: further friction in parts of what
        there is; load: kg; bias1: rad or m that the encoder reads too much; push1: N m or N.
        """
        n = len(self._arm)
        scale = self._weights(log) / self.noise
        columns = self._columns(log)
        friction = np.einsum("njp,p->nj", columns[:, :, 11 * n : 14 * n], self._now[11 * n : 14 * n])
        load = columns[:, :, 10 * (n - 1) : 10 * n] @ self._mass
        slopes = self._slopes(log)
        innovation: Array = scale * (log.effort - columns @ self._now)
        found: dict[str, Array] = {"load": scale * load}
        for j in range(n):
            own = np.zeros(n)
            own[j] = 1.0
            found |= {
                f"K{j + 1}": scale * own * log.effort,
                f"friction{j + 1}": scale * own * friction,
                f"bias{j + 1}": -scale * slopes[j] / self._constant,
                f"push{j + 1}": -scale * own / self._constant,
            }
        return innovation, found

    def _slopes(self, log: Filtered) -> Array:
        """How the torques change with each position, (n, N, n), all in one pass: few samples cost as much as many."""
        n, count = len(self._arm), len(log.t)
        moved = log.q + _STEP * np.vstack([np.zeros(n), np.eye(n)])[:, None]
        flat = [np.tile(each, (n + 1, 1)) for each in (log.qd, log.qdd)]
        torques = inverse_dynamics(self._arm, moved.reshape(-1, n), *flat).reshape(n + 1, count, n)
        slopes: Array = (torques[1:] - torques[0]) / _STEP
        return slopes

    def _weights(self, log: Filtered) -> Array:
        """1 where a joint moves, less where it is so slow that dry friction may act either way, (N, n).

        What nobody knows of friction then counts as a further noise beside the usual one, and for less as it stays
        the same while a joint creeps to its pose. 0 at rest, and where nobody knows what the arm carries.
        """
        moves = np.clip(np.abs(log.qd) / self._slow, 0.0, 1.0)
        sure: Array = log.known[:, None] * moves * self.noise / np.hypot(self.noise, (1.0 - moves) * self._held)
        return sure

    def _columns(self, log: Filtered) -> Array:
        """Of links (10 n), rotors, viscous, dry and load-dependent friction, and offsets (n each): (N, n, 15 n)."""
        n = len(self._arm)
        own = np.eye(n)
        sense = np.tanh(log.qd / self._slow)
        lost = self._viscous * log.qd + self._coulomb * sense
        carried = np.abs(log.effort * self._constant - self._rotor * log.qdd - lost)
        columns = [regressor(self._arm, log.q, log.qd, log.qdd)]
        for values in (log.qdd, log.qd, sense, sense * carried, np.ones_like(log.qd)):
            columns.append(values[:, :, None] * own)
        found: Array = np.concatenate(columns, axis=2) / self._constant[:, None]
        return found

    def _known(self) -> tuple[Array, Array]:
        """Mean and standard deviation of the parameters before anything was seen, (15 n,)."""
        arm, spread = self._arm, self._arm.tolerances
        links = arm.parameters.reshape(len(arm), 10)
        mass = links[:, :1]
        reach = np.linalg.norm(np.array([link.centre for link in arm.links]), axis=1)[:, None] + 0.05
        relative = spread.mass + spread.inertia + spread.constant
        moments = relative * mass * reach + spread.centre * mass
        sizes = np.hstack([relative * mass, np.repeat(moments, 3, 1), np.repeat(moments * reach, 6, 1)])
        friction = [[getattr(j.friction, name) for j in arm.joints] for name in ("viscous", "coulomb", "load")]
        effort = np.array([joint.largest if np.isfinite(joint.largest) else 1.0 for joint in arm.joints])
        part = spread.friction + spread.constant
        speed = np.array([joint.speed for joint in arm.joints])
        losses = [
            part * np.array(row) + least
            for row, least in zip(friction, (0.01 * effort / speed, 0.01 * effort, 0.01), strict=True)
        ]
        mean = np.concatenate([arm.parameters, self._rotor, *friction, np.zeros(len(arm))])
        deviation = np.concatenate(
            [sizes.ravel(), (spread.constant + 0.05) * self._rotor + 1e-6, *losses, 0.01 * effort]
        )
        return mean, deviation


def _faint(arm: Arm) -> Array:
    """Least noise of every drive, (n,), in the units of the drives."""
    constant = np.array([abs(joint.actuator.constant or 1.0) for joint in arm.joints])
    largest = np.array([joint.largest for joint in arm.joints])
    found: Array = np.where(np.isfinite(largest), _FAINT * largest, 1e-9) / constant
    return found


def _carried(arm: Arm) -> Array:
    """What every joint carries of the arm's weight at drawn poses, rms, (n,), N m or N."""
    poses = drawn_poses(arm, _POSES, np.random.default_rng(0), 1.0).positions
    rest = np.zeros_like(poses)
    found: Array = np.sqrt(np.mean(inverse_dynamics(arm, poses, rest, rest) ** 2, axis=0))
    return found
