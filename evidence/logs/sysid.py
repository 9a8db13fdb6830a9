"""mujoco.sysid's identification of the same files, for comparison, where `pip install 'mujoco[sysid]'` has put it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array
from dtwin.emulation.chain.peer import ChainPeerFit, Posed, fit_chain
from dtwin.errors import IdentificationError
from dtwin.identification.chain.design import Filtering, Smooth, kept_of, low_passed, smooth
from dtwin.identification.chain.friction import Scale
from dtwin.measurements.measurement import Measurement

ABSENT: Final = "mujoco.sysid is not installed: pip install 'mujoco[sysid]'"


class Sysid:
    """mujoco.sysid's bodies, rotors, offsets, viscous and dry friction, fitted to the torque that all see.

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
        self._gain, self._scales, self._filtering = gain, scales, filtering
        stretches = [stretch for m in measurements for stretch in smooth(m, filtering)]
        if not stretches:
            raise IdentificationError("expected a stretch of motion without a gap of at least two seconds")
        self._fit = fit_chain(arm, stretches[0].dt, [self._posed(stretch) for stretch in stretches])
        self.seconds = self._fit.seconds

    @property
    def fit(self) -> ChainPeerFit:
        """What it found."""
        return self._fit

    def predicted(self, measurement: Measurement) -> tuple[Array, Array]:
        """Torque of a measurement as measured and as predicted, (N, n), through the filter of the identification."""
        posed = [self._posed(stretch) for stretch in smooth(measurement, self._filtering)]
        found = [each.through(self._fit.torque(each.q, each.v, each.a)) for each in posed]
        return np.concatenate([each.torque for each in posed]), np.concatenate(found)

    def _posed(self, stretch: Smooth) -> Posed:
        """A stretch, whose torque passes the filter that the identification has."""
        kept = kept_of(stretch, self._scales, self._filtering)

        def through(torque: Array) -> Array:
            return low_passed(torque, stretch.dt, self._filtering.cutoff)[kept]

        return Posed(stretch.q, stretch.v, stretch.a, through(stretch.effort * self._gain), through)
