"""Finds the motions in a log of the cell and predicts them from where they started."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import msgspec
import numpy as np

from dtwin.controller.settings import ControlSettings
from dtwin.errors import ParameterError, RecordingError
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, ArmParameters, JointVector, joint_vector
from dtwin.simulation.figures import Array, Figures, figures, fit
from dtwin.simulation.trial import SAME_ANGLE
from dtwin.simulation.whatif import MotionCase, Outcome, Simulator
from dtwin.twin.effects import NO_EFFECTS, Effects


@dataclass(frozen=True, slots=True)
class Measured:
    """A motion in a log, found from sensors and commands.

    Attributes:
        start: tick at which the path starts.
        stop: tick after the last one of the motion.
        target_time: duration of the path, s.
        goal: angles at which the path ends, rad.
        carries: whether a box is held.
    """

    start: int
    stop: int
    target_time: float
    goal: JointVector
    carries: bool

    @property
    def time(self) -> float:
        """Time at which the motion starts, s."""
        return self.start * PERIOD


@dataclass(frozen=True, slots=True, eq=False)
class MotionComparison:
    """A measured motion and its prediction by the twin.

    Attributes:
        motion: place of the motion in the log.
        measured: (N, 3), angles that the encoders measured, rad.
        path: (N, 3), desired angles, rad.
        volts: (N, 3), voltages applied, V.
        figures: figures of the measured motion.
        predicted: motion that the twin predicts from the first sample.
        fit: fit of each joint; 1 is perfect.
    """

    motion: Measured
    measured: Array
    path: Array
    volts: Array
    figures: Figures
    predicted: Outcome
    fit: JointVector


def motions(log: Log, offset: Array | None = None) -> Iterator[Measured]:
    """Finds the motions of a log, in order; a motion whose path does not end in the log is left out.

    A path starts at a tick at which the desired angles of all joints equal the measured ones and then change.

    Args:
        log: log of a run.
        offset: (ticks, 3), offsets of the encoders that the controller took off what they measured, rad; none if
            not given.

    Raises:
        RecordingError: the log does not tell the path.
    """
    path, measured = log.stack("target"), log.stack("measured")
    if len(log) and np.isnan(path).all():
        raise RecordingError("column target_1: expected the path of the arm; the log does not tell it")
    if offset is not None:
        measured = measured - offset
    moves = np.append((path[1:] != path[:-1]).any(axis=1), False)
    at_arm = (np.abs(path - measured) <= SAME_ANGLE).all(axis=1)
    starts = np.flatnonzero(at_arm & moves).tolist()
    for start, stop in itertools.pairwise([*starts, len(path)]):
        still = np.flatnonzero(~moves[start:stop])
        if stop - start < 2 or not still.size or start + still[0] == len(path) - 1:
            continue
        end = start + int(still[0])
        carries = bool(log.columns["box_gripped"][start])
        yield Measured(start, stop, (end - start) * PERIOD, joint_vector(path[end]), carries)


def settings_of(log: Log) -> ControlSettings:
    """The settings of the controller that a run was started with.

    Raises:
        RecordingError: the metadata of the log has no usable settings.
    """
    noted: Any = log.metadata.get("control")
    try:
        return msgspec.convert(noted, ControlSettings)
    except (msgspec.ValidationError, ParameterError) as error:
        raise RecordingError(f"the log's notes have no usable control settings: {error}") from None


def compare(
    log: Log,
    motion: Measured,
    settings: ControlSettings,
    arm: ArmParameters,
    payload: float,
    simulator: Simulator,
    effects: Effects = NO_EFFECTS,
) -> MotionComparison:
    """Compares a measured motion with the prediction from its first sample alone.

    Args:
        log: log with the motion.
        motion: one of the motions that `motions(log)` finds.
        settings: settings that were in force; the target time is taken from the motion.
        arm: model of the arm.
        payload: mass of a held box, kg.
        simulator: simulator that predicts the motion.
        effects: what the arm has beside its parameters.
    """
    rows = slice(motion.start, motion.stop)
    measured, path = log.stack("measured")[rows], log.stack("target")[rows]
    volts = log.stack("volts")[rows, :3]
    case = MotionCase(
        motion.goal,
        replace(settings, target_time=motion.target_time),
        joint_vector(measured[0]),
        arm=arm,
        payload=payload if motion.carries else 0.0,
        carries=motion.carries,
        duration=len(measured) * PERIOD,
        effects=effects,
    )
    predicted = simulator.run(case)
    angles = np.vstack((measured, measured[-1:]))
    speeds = np.gradient(angles, PERIOD, axis=0)
    came_to = figures(angles, speeds, path, volts, motion.goal, arm.voltage_constant)
    return MotionComparison(motion, measured, path, volts, came_to, predicted, fit(measured, predicted.theta))


def find(log: Log, time: float) -> Measured:
    """The first motion of a log that starts at or after a time (s).

    Raises:
        RecordingError: there is no such motion.
    """
    starts = []
    for motion in motions(log):
        if motion.time >= time - PERIOD / 2:
            return motion
        starts.append(motion.time)
    latest = f"the last one starts at {starts[-1]:.2f} s" if starts else "it has none"
    raise RecordingError(f"no motion of the log starts at or after {time:g} s: {latest}")
