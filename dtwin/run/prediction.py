"""What the twin says of a run: where voltages took the arm in the last moments, without a look at the encoders.

An upright arm drifts away from every model of it, because of noise and of boxes that are some percent lighter or
heavier than believed: over a motion of 2 s even the ideal arm's own model does not tell its angles any more. So each
prediction is a rollout over the last HORIZON seconds alone: it starts anew before each tick. It starts with the
angles and velocities of the parabola that fits the readings around that moment best (A. Savitzky, M. J. E. Golay,
Anal. Chem. 36, 1964, 1627-1639), and counts on the commands since.

docs/recordings.md says how far from the predictions healthy and faulty arms are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.controller.settings import NO_OFFSET, ControlSettings
from dtwin.errors import DivergenceError, ModelError, ParameterError
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, ArmParameters, JointVector
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import machine_rollout, vector_of
from dtwin.twin.rollout import rollout_ends

Array = NDArray[np.float64]

TICKS: Final = 20
"""Number of ticks of a rollout."""
HORIZON: Final = TICKS * PERIOD
"""Time that a rollout takes, s."""
_SUBSTEPS: Final = 2
"""Number of steps of a rollout in a tick."""
_AROUND: Final = 5
"""Number of readings before its start, and of those after it, from which a rollout starts."""
_FIT: Final = np.linalg.pinv(np.vander(PERIOD * np.arange(-_AROUND, _AROUND + 1), 3))
"""(3, readings): half the acceleration, velocity and angle in the middle of readings."""


@dataclass(frozen=True, slots=True)
class BelievedArm:
    """What is believed of the arm of a run; nothing in it is the emulation's truth.

    Attributes:
        arm: parameters of the arm.
        payload: mass of a box, kg.
        offset: offsets of the encoders, rad, which are taken off what they read.
        effects: what the arm has beside its equations of motion.
    """

    arm: ArmParameters = field(default_factory=ArmParameters)
    payload: float = ControlSettings().payload
    offset: JointVector = NO_OFFSET
    effects: Effects = NO_EFFECTS


DATA_SHEET: Final = BelievedArm()


def believed_by_controller(notes: Mapping[str, Any]) -> BelievedArm:
    """What the controller of a run was started with; the data sheet's arm where the log does not say.

    Args:
        notes: metadata of the log.

    Raises:
        ModelError: the metadata is not that of a run.
    """
    try:
        control = msgspec.convert(notes.get("control", {}), ControlSettings)
    except (msgspec.ValidationError, ParameterError) as error:
        raise ModelError(f"metadata of the log: control: {error}") from None
    return BelievedArm(control.model, control.payload, control.encoder_offset)


class OpenLoop:
    """Predicts the angles of a growing run, part by part, in the same way as in one piece.

    Args:
        believed: the arm that is predicted.
        every: number of ticks of which one is predicted, from the first one on.
        ticks: number of ticks of a rollout.
    """

    def __init__(self, believed: BelievedArm, every: int = 1, ticks: int = TICKS) -> None:
        self._believed, self._every, self._ticks = believed, every, ticks
        self._rows = np.empty((0, 8))
        self._next = 0

    def add(self, log: Log) -> tuple[Array, Array]:
        """Predicts ticks that follow those added before.

        A tick without enough ticks before it, after a start or a gap, has the angles that were read. One that the
        model cannot predict, because it diverges, is left out.

        Returns:
            Times of the ticks, (n,), s, and the angles, (n, 3), rad.
        """
        masses = self._believed.payload * log.columns["box_gripped"]
        readings = log.stack("measured") - self._believed.offset
        new = np.column_stack((log.columns["t"], readings, log.stack("volts")[:, :3], masses))
        first = len(self._rows) + self._next
        rows = np.vstack((self._rows, new))
        ticks = np.arange(first, len(rows), self._every)
        self._next = (first - len(rows)) % self._every
        needed = self._ticks + _AROUND
        self._rows = rows[-needed:]

        angles = rows[ticks, 1:4]
        told = ticks >= needed
        took = rows[ticks, 0] - rows[ticks - needed * told, 0]
        told &= np.abs(took - needed * PERIOD) < PERIOD / 2
        angles[told] = self._predicted(rows, ticks[told])
        finite = np.isfinite(angles).all(axis=1)
        return rows[ticks[finite], 0], angles[finite]

    def _predicted(self, rows: Array, ticks: NDArray[np.intp]) -> Array:
        """The angles at some rows, (n, 3), rad, which have enough rows before them."""
        starts = ticks - self._ticks
        readings = rows[starts[:, None] + np.arange(-_AROUND, _AROUND + 1), 1:4]
        _, velocity, angle = np.moveaxis(_FIT @ readings, 1, 0)
        states = np.hstack((angle, velocity))
        commands = rows[starts[:, None] + np.arange(self._ticks), 4:]
        volts, masses = np.ascontiguousarray(commands[..., :3]), np.ascontiguousarray(commands[..., 3])
        believed = self._believed
        if believed.effects == NO_EFFECTS:
            return rollout_ends(believed.arm, states, volts, masses, substeps=_SUBSTEPS)[:, :3]
        vector = vector_of(believed.arm, believed.effects)
        return np.array([_end(vector, *each) for each in zip(states, volts, masses, strict=True)]).reshape(-1, 3)


def load_kernels(believed: BelievedArm) -> None:
    """Compiles the twin of an arm or loads it compiled, so that no later prediction has to."""
    OpenLoop(believed)._predicted(np.zeros((TICKS + _AROUND + 1, 8)), np.array([TICKS + _AROUND]))


def _end(vector: Array, state: Array, volts: Array, masses: Array) -> Array:
    """The angles at the end of a rollout of a machine, (3,), rad; not numbers where it diverges."""
    try:
        return machine_rollout(vector, state, volts, masses)[0][-1, :3]
    except DivergenceError:
        return np.full(3, np.nan)
