"""mujoco.sysid's identification of the same files, for comparison, where `pip install 'mujoco[sysid]'` has put it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.peer import fit_chain
from dtwin.errors import IdentificationError
from dtwin.identification.chain.design import Filtering, Smooth, rigid_of, rows_of, smooth
from dtwin.identification.chain.friction import Scale
from dtwin.measurements.measurement import Measurement

ABSENT: Final = "mujoco.sysid is not installed: pip install 'mujoco[sysid]'"


class Sysid:
    """mujoco.sysid's bodies, rotors, viscous and dry friction, found by simulating windows of the motion.

    Attributes:
        seconds: time that its search took, s.
    """

    def __init__(
        self,
        arm: Arm,
        measurements: Sequence[Measurement],
        gain: Array,
        scales: Sequence[Scale],
        filtering: Filtering,
    ) -> None:
        """Fits it.

        Args:
            arm: the arm as it is known, where its search begins.
            measurements: motion with an empty hand.
            gain: N m (N) per unit of the log, (n,).
            scales: what is usual for each joint, by which the identification chose its rows.
            filtering: how positions are cleared of noise before it sees them.

        Raises:
            IdentificationError: no stretch is long enough.
            DtwinError: it is not installed, or ends with an error.
        """
        self._arm, self._gain, self._scales, self._filtering = arm, gain, scales, filtering
        stretches = [stretch for m in measurements for stretch in smooth(m, filtering)]
        if not stretches:
            raise IdentificationError("expected a stretch of motion without a gap of at least two seconds")
        step = stretches[0].dt
        self._fit = fit_chain(arm, step, [self._motion(stretch, step) for stretch in stretches])
        self.seconds = self._fit.seconds

    def predicted(self, measurement: Measurement) -> tuple[Array, Array]:
        """Torque of a measurement as measured and as predicted, (N, n), through the filter of the identification."""
        measured, predicted = [], []
        for stretch in smooth(measurement, self._filtering):
            rigid = rigid_of(self._arm, stretch, self._scales, self._filtering)
            made, terms = rows_of(rigid, stretch, self._scales, self._filtering, measurement.source)
            torque = made.rigid @ self._fit.parameters
            for joint, mine in enumerate(made.terms):
                names = terms[joint].names
                found = (("rotor", self._fit.rotor), ("viscous", self._fit.viscous), ("coulomb", self._fit.coulomb))
                for name, value in found:
                    torque[:, joint] += value[joint] * mine[:, names.index(name)]
            measured.append(made.effort * self._gain)
            predicted.append(torque)
        return np.concatenate(measured), np.concatenate(predicted)

    def _motion(self, stretch: Smooth, step: float) -> tuple[Array, Array, Array]:
        """Positions, velocities and torques of a stretch at the rate that the simulation has."""
        columns = stretch.q, stretch.v, stretch.effort * self._gain
        if abs(stretch.dt / step - 1.0) < 1e-3:
            return columns
        old = stretch.dt * np.arange(len(stretch.q))
        new = np.arange(0.0, old[-1], step)
        q, v, torque = (np.stack([np.interp(new, old, c) for c in each.T], axis=1) for each in columns)
        return q, v, torque
