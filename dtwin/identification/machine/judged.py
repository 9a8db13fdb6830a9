"""A real arm identified from a log of its work: fitted, judged by motion that was held out, and graded."""

from __future__ import annotations

import platform
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin import __version__
from dtwin.errors import IdentificationError
from dtwin.identification.data import Array, Experiment, fingerprint, from_log
from dtwin.identification.estimation.quality import noise
from dtwin.identification.estimation.residuals import autocorrelations
from dtwin.identification.estimation.residuals import fit as fit_of
from dtwin.identification.estimation.solver import Minimum, minimise
from dtwin.identification.machine.fit import MachineFit, without_strays
from dtwin.identification.machine.left import NOTICEABLE, Left, what_is_left
from dtwin.identification.machine.problem import MachineProblem
from dtwin.identification.machine.record import SCHEMA, Grade, MachineRecord, Number, SensorCheck
from dtwin.identification.machine.ripple import fit_with_ripple
from dtwin.identification.machine.sheet import IDENTIFIED, sheet
from dtwin.logs.log import Log
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, joint_vector
from dtwin.twin.effects import EFFECT_NAMES, Effects
from dtwin.twin.machine import vector_of

SEGMENT: Final = 0.4
"""Length of the segments that are fitted, s."""
JUDGED: Final = 1.0
"""Length of the segments that judge, s."""
HELD_OUT: Final = 0.25
"""Share of the log that judges, its end."""
MOST: Final = 60
FEWEST: Final = 20
"""Numbers of segments that are fitted."""
_MOST_JUDGED: Final = 12
MOVED: Final = (0.05, 0.2)
"""Range of some joint's angle in a segment that is fitted, or judges, rad."""
GOOD: Final = 0.98
POOR: Final = 0.9
"""Fits of held-out motion from which on a model is identified, and below which it is unusable."""
_START: Final = Effects(stribeck_velocity=(0.175, 0.175, 0.175))
"""Effects whose numbers are not identified: the middle of the data sheet's range."""
_SCALES: Final = ("K1", "K2", "K3")
"""Numbers that take up a scale of the voltages."""
_UNEXPLAINED: Final = 1.5
"""Ratio of what is not explained to the noise of the encoders from which on an effect is missing."""


@dataclass(frozen=True, eq=False)
class HeldOutMotion:
    """Segments of motion that a machine was not fitted to, beside what it predicts of them.

    Attributes:
        measured: readings of every segment, each (N, 3), rad.
        predicted: predicted readings of the same, rad.
    """

    measured: tuple[Array, ...]
    predicted: tuple[Array, ...]

    @property
    def fit(self) -> Array:
        """Fit of every joint, (3,); 1 is perfect."""
        return fit_of(np.concatenate(self.measured), np.concatenate(self.predicted))


@dataclass(frozen=True, eq=False)
class Judged:
    """A machine and how far to trust it.

    Attributes:
        found: the fit.
        held_out: held-out motion, by which the machine is judged.
        encoders: (3,), noise of the encoders, rad.
        left: what would explain a noticeable share of what is left.
    """

    found: MachineFit
    held_out: HeldOutMotion
    encoders: Array
    left: tuple[Left, ...]

    @property
    def fit(self) -> Array:
        """Fit of every joint on held-out motion, (3,); 1 is perfect."""
        return self.held_out.fit

    @property
    def grade(self) -> Grade:
        """What the machine is good for, by its worst joint.

        Voltages or angles to another scale fit as well as the right ones; the voltage constants tell them.
        """
        worst = float(self.fit.min())
        scaled = any(name in _SCALES for name in self.found.at_edge)
        if worst >= GOOD and not scaled:
            return "identified"
        return "approximate" if worst >= POOR else "unusable"

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the numbers that the data tell; of the others the data sheet tells nearly all that is known."""
        return self.found.told

    def remarks(self) -> list[str]:
        """What a person should know of it, in words."""
        said = [each.text() for each in self.left]
        (alike,) = autocorrelations(self.found.residuals, (1,))
        for joint, (left, encoder, share) in enumerate(zip(self.found.noise, self.encoders, alike, strict=True), 1):
            if left > _UNEXPLAINED * encoder:
                said.append(
                    f"joint {joint}: {1e3 * left:.2g} mrad are not explained, the encoder's noise is"
                    f" {1e3 * encoder:.2g} mrad: the arm has an effect that the model lacks"
                )
            elif share > NOTICEABLE:
                said.append(
                    f"joint {joint}: {share:.0%} of what is left is alike in neighbouring samples: the arm has an"
                    " effect that the model lacks, or its encoder errs alike for longer than a sample"
                )
        if kept := sorted(self.found.problem.kept):
            said.append(
                f"{', '.join(kept)}: the motion hardly tells, and would be explained better beyond the range of the"
                " data sheet, within which it is kept: the arm has an effect that the model lacks"
            )
        if edge := self.found.at_edge:
            said.append(
                f"{', '.join(edge)}: as far from the data sheet as twice its range; farther off the motion would be"
                " explained better, so the data sheet is wrong there, or the arm has an effect that the model lacks"
            )
        return said


def identify_machine(log: Log, arm: ArmParameters, progress: Callable[[str], None] = lambda text: None) -> Judged:
    """Identifies a real arm from the motions of its empty gripper in a log.

    Args:
        log: log of ordinary work.
        arm: arm as it was designed.
        progress: is told in words how far it is.

    Raises:
        IdentificationError: the log has too little motion of the empty gripper.
    """
    cut = round((1.0 - HELD_OUT) * len(log))
    segments = _empty(log.part(0, cut), SEGMENT, MOVED[0])
    judging = _empty(log.part(cut, len(log)), JUDGED, MOVED[1])[:_MOST_JUDGED]
    if len(segments) < FEWEST or not judging:
        raise IdentificationError(
            f"too little motion with an empty gripper: {len(segments)} segments of {SEGMENT:g} s and {len(judging)}"
            f" of {JUDGED:g} s to judge by, expected at least {FEWEST} and 1; record two minutes of work"
        )
    chosen = segments[:: -(-len(segments) // MOST)]
    fitted = fit_with_ripple(chosen, IDENTIFIED, vector_of(arm, _START), sheet(arm), progress)
    found = without_strays(fitted, progress)
    encoders = np.median([noise(segment.measured) for segment in chosen], axis=0)
    return Judged(found, judge(found, judging), np.maximum(encoders, 1e-6), what_is_left(found))


def record_of(judged: Judged, sensors: SensorCheck, arm: ArmParameters, source: str) -> MachineRecord:
    """The record of an identification.

    Args:
        judged: the machine and how far to trust it.
        sensors: what the readings tell of the encoders themselves.
        arm: arm as it was designed.
        source: description of the data.
    """
    found = judged.found
    priors, deviations, told = found.problem.priors, found.deviations, judged.identified
    values = dict(zip((*PARAMETER_NAMES, *EFFECT_NAMES), found.vector.tolist(), strict=False))
    numbers = {
        name: Number(value, deviations.get(name, 0.0), priors[name].mean, priors[name].deviation, name in told)
        for name, value in values.items()
    }
    return MachineRecord(
        SCHEMA,
        judged.grade,
        numbers,
        joint_vector(judged.fit),
        joint_vector(found.noise),
        joint_vector(judged.encoders),
        sensors,
        found.converged,
        judged.remarks(),
        source,
        fingerprint(found.problem.segments),
        len(found.problem.segments),
        {"dtwin": __version__, "numpy": np.__version__, "python": platform.python_version()},
    )


def judge(found: MachineFit, segments: Sequence[Experiment]) -> HeldOutMotion:
    """What a machine predicts of segments of which only the initial states are estimated."""
    problem, states = with_states(found.vector, found.noise, segments)
    return HeldOutMotion(tuple(e.measured for e in segments), tuple(problem.simulate(states.x)))


def with_states(vector: Array, noise: Array, segments: Sequence[Experiment]) -> tuple[MachineProblem, Minimum]:
    """The problem of a machine that is known, and the initial states with which it explains segments best.

    Args:
        vector: (78,), all numbers of the machine.
        noise: (3,), standard deviation of what is not explained, rad.
        segments: segments of motion.
    """
    problem = MachineProblem(tuple(segments), (), vector, {})
    weights = [np.broadcast_to(1.0 / noise, e.measured.shape) for e in segments]
    return problem, minimise(
        lambda x: problem.normal(x, weights), lambda x: problem.cost(x, weights), problem.start(), *problem.bounds
    )


def moving(segments: Iterable[Experiment], length: float, moved: float) -> list[Experiment]:
    """Segments of nearly a whole length (s) in which some joint moved so far (rad)."""
    long_enough = (e for e in segments if len(e) * e.period >= 0.9 * length)
    return [e for e in long_enough if float(np.ptp(e.measured, axis=0).max()) > moved]


def _empty(log: Log, length: float, moved: float) -> list[Experiment]:
    """Moving segments of the empty gripper."""
    return [] if log.columns["box_gripped"].all() else moving(from_log(log, None, length), length, moved)
