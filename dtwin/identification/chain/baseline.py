"""What everybody does: ordinary least squares on the regressor, with viscous and Coulomb friction and an offset.

Positions and velocities pass a zero-phase filter, accelerations are their differences, rows of all joints weigh the
same. It is what `dtwin experiment real` holds the identification against.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.arm.differences import rates
from dtwin.equations.rigid import regressor
from dtwin.errors import IdentificationError
from dtwin.identification.chain.design import Filtering, low_passed, scales_of, smooth
from dtwin.measurements.measurement import Measurement

Regressor = Callable[[Array, Array, Array], Array]
"""Y(q, q', q'') of all samples, (N, n, 10 n)."""
_COULOMB: Final = 0.05
"""Speed over which Coulomb friction turns over, rad/s."""


class Baseline:
    """Ordinary least squares, fitted.

    Attributes:
        solution: parameters, then offset, viscous and Coulomb friction joint by joint.
    """

    def __init__(
        self,
        arm: Arm,
        measurements: Sequence[Measurement],
        gain: Array,
        filtering: Filtering,
        of: Regressor | None = None,
    ) -> None:
        """Fits it.

        Args:
            arm: the chain.
            measurements: motion with an empty hand.
            gain: N m (N) per unit of the log, (n,).
            filtering: its cutoff is the filter's corner.
            of: regressor by another program; None for ours.

        Raises:
            IdentificationError: no stretch is long enough.
        """
        self._gain, self._filtering = gain, filtering
        self._regressor = of or (lambda q, v, a: regressor(arm, q, v, a))
        matrix, torque = self._equations(measurements)
        size = matrix.shape[2]
        solution = np.linalg.lstsq(matrix.reshape(-1, size), torque.ravel(), rcond=1e-8)[0]
        self.solution: Array = np.asarray(solution, dtype=np.float64)

    def predicted(self, measurement: Measurement) -> tuple[Array, Array]:
        """Torque of a measurement as measured and as predicted, (N, n)."""
        matrix, torque = self._equations([measurement])
        return torque, matrix @ self.solution

    def _equations(self, measurements: Sequence[Measurement]) -> tuple[Array, Array]:
        matrices, torques = [], []
        for q, v, a, effort in filtered(measurements, self._filtering):
            n = v.shape[1]
            friction = np.zeros((len(v), n, 3 * n))
            for joint in range(n):
                mine = v[:, joint]
                terms = [np.ones_like(mine), mine, np.tanh(mine / _COULOMB)]
                friction[:, joint, 3 * joint : 3 * joint + 3] = np.stack(terms, axis=1)
            matrices.append(np.concatenate([self._regressor(q, v, a), friction], axis=2))
            torques.append(effort * self._gain)
        return np.concatenate(matrices), np.concatenate(torques)


def filtered(measurements: Sequence[Measurement], filtering: Filtering) -> list[tuple[Array, Array, Array, Array]]:
    """Positions, velocities, accelerations and efforts of every stretch, (N, n) each, through one filter.

    What the filter does at the ends of a stretch and what lies before the first and after the last motion is cut off.

    Raises:
        IdentificationError: no stretch is long enough.
    """
    cutoff, found = filtering.cutoff, []
    for stretch in [part for m in measurements for part in smooth(m, Filtering(cutoff, 1.0))]:
        dt = stretch.dt
        v = low_passed(stretch.v, dt, cutoff)
        a = low_passed(rates(v, dt), dt, cutoff)
        moves = np.flatnonzero((np.abs(v) > 0.03 * np.array([s.speed for s in scales_of([stretch])])).any(axis=1))
        edge = round(2.5 / cutoff / dt)
        kept = np.arange(max(moves[0], edge), min(moves[-1], len(v) - edge)) if len(moves) else np.arange(0)
        kept = kept[stretch.usable[kept]]
        columns = low_passed(stretch.q, dt, cutoff), v, a, low_passed(stretch.effort, dt, cutoff)
        q, v, a, effort = (column[kept] for column in columns)
        found.append((q, v, a, effort))
    if not found:
        raise IdentificationError("expected a stretch of motion without a gap of at least two seconds")
    return found
