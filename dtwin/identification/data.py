"""Data of identification experiments: frozen, validated, with a fingerprint."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dtwin.errors import IdentificationError, ParameterError
from dtwin.parameters import HOME, PERIOD, CellJoints, PayloadModel, every_joint, joint_vector
from dtwin.twin.rollout import checked_payload

if TYPE_CHECKING:
    from dtwin.logs.log import Log

Array = NDArray[np.float64]

_LAST_SAMPLES = 12
"""Number of samples at the end of a log that make no segment: too few to tell a velocity from noise."""


@dataclass(frozen=True, slots=True)
class Start:
    """The state at the first sample of an experiment.

    Attributes:
        theta: joint angles, rad.
        omega: joint velocities, rad/s.
        known: whether the state is known; otherwise the fit estimates all six values.
    """

    theta: CellJoints = HOME
    omega: CellJoints = every_joint(0.0)
    known: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Experiment:
    """One stretch of samples under known voltages.

    Attributes:
        measured: (N, 3), joint angles as the encoders say, rad.
        volts: (N, 3), voltages, V; row k is held from sample k to sample k + 1, so the last row has no effect.
        payload: (N,), mass at the tip, kg, held like the voltages; a number stands for all samples.
        start: state at sample 0.
        period: time between samples, s.
        payload_model: "point" for a gripped box, "weight" for a load whose inertia does not act on the arm.
        fingerprint: SHA-256 of all of the above.

    Raises:
        ParameterError: the shapes do not agree.
        IdentificationError: a number is not finite.
    """

    measured: Array
    volts: Array
    payload: Array
    start: Start = field(default_factory=Start)
    period: float = PERIOD
    payload_model: PayloadModel = "point"
    fingerprint: str = field(init=False)

    def __init__(
        self,
        measured: ArrayLike,
        volts: ArrayLike,
        payload: ArrayLike = 0.0,
        start: Start | None = None,
        period: float = PERIOD,
        payload_model: PayloadModel = "point",
    ) -> None:
        angles = _checked("measured", measured)
        commands = _checked("volts", volts)
        if angles.shape != commands.shape:
            raise ParameterError(
                f"expected as many measured angles as volts, got {angles.shape} and {commands.shape}"
            )
        masses = checked_payload(payload, len(angles))
        if start is None:
            start = Start(joint_vector(angles[0]), known=False)
        for name, value in (
            ("measured", angles),
            ("volts", commands),
            ("payload", masses),
            ("start", start),
            ("period", period),
            ("payload_model", payload_model),
            ("fingerprint", _fingerprint(angles, commands, masses, (start, period, payload_model))),
        ):
            object.__setattr__(self, name, value)

    def __len__(self) -> int:
        return len(self.measured)

    def head(self, samples: int) -> Experiment:
        """The experiment made of the first samples, at most all."""
        measured, volts, payload = self.measured[:samples], self.volts[:samples], self.payload[:samples]
        return Experiment(measured, volts, payload, self.start, self.period, self.payload_model)


def from_log(log: Log, box_mass: float | None = None, segment: float = 1.0) -> tuple[Experiment, ...]:
    """Divides the log of a run into experiments, one after the other, each with an unknown initial state.

    No experiment reaches over ticks that the log lacks.

    Without control the arm is unstable where it stands upright. A simulation over minutes would depend too strongly
    on its initial state; one over a second does not.

    Args:
        log: log of a run, whose true values are not looked at.
        box_mass: mass assumed for every gripped box, kg; None leaves out what was moved with a box, whose mass nobody
            knows.
        segment: length of an experiment, s; the last one of a stretch may be shorter.

    Raises:
        IdentificationError: the log is shorter than a segment, a box was held all the time, or so many ticks are
            missing that nothing in one piece is left.
    """
    measured, volts = log.stack("measured"), log.stack("volts")[:, :3]
    gripped = log.columns["box_gripped"]
    payload = np.where(gripped, box_mass or 0.0, 0.0)
    length = round(segment / PERIOD)
    if len(measured) < length:
        raise IdentificationError(f"too few samples: the log has {len(measured)}, expected at least {length}")
    stretches = [(0, len(measured))] if box_mass is not None else _stretches(~gripped)
    gaps = (np.flatnonzero(np.diff(log.ticks()) > 1) + 1).tolist()
    stretches = [part for start, stop in stretches for part in _divided(start, stop, gaps)]
    cuts = [
        slice(first, min(first + length, stop))
        for start, stop in stretches
        for first in range(start, stop - _LAST_SAMPLES, length)
    ]
    if not stretches:
        raise IdentificationError("a box was held all the time: expected its mass, or motions of the empty gripper")
    if not cuts:
        longest = max(stop - start for start, stop in stretches)
        empty = "" if box_mass is not None else " with an empty gripper"
        raise IdentificationError(
            f"too few samples in one piece: the longest piece{empty} and without missing ticks has {longest},"
            f" expected more than {_LAST_SAMPLES}"
        )
    return tuple(Experiment(measured[cut], volts[cut], payload[cut]) for cut in cuts)


def _stretches(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First index, and the index after the last one, of every run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def _divided(start: int, stop: int, gaps: Sequence[int]) -> list[tuple[int, int]]:
    """A stretch in parts, each of which begins at its start or behind a gap."""
    edges = [start, *(gap for gap in gaps if start < gap < stop), stop]
    return list(pairwise(edges))


def fingerprint(experiments: Sequence[Experiment]) -> str:
    """SHA-256 of several experiments, in order."""
    return hashlib.sha256("".join(e.fingerprint for e in experiments).encode()).hexdigest()


def _checked(name: str, values: ArrayLike) -> Array:
    array = np.array(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ParameterError(f"{name}: expected shape (N, 3), got {array.shape}")
    if not np.isfinite(array).all():
        sample, joint = np.argwhere(~np.isfinite(array))[0]
        raise IdentificationError(f"{name} of joint {joint + 1} at sample {sample}: expected a finite number")
    array.setflags(write=False)
    return array


def _fingerprint(angles: Array, commands: Array, masses: Array, rest: tuple[object, ...]) -> str:
    digest = hashlib.sha256(repr(rest).encode())
    for array in (angles, commands, masses):
        digest.update(np.ascontiguousarray(array, dtype="<f8").tobytes())
    return digest.hexdigest()
