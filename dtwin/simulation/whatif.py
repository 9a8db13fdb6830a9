"""What-if simulation of one motion: the analytic twin and the real function blocks in closed loop.

The tick is that of the cell: a sample, a step of the blocks, and four RK4 steps with the voltages held for 10 ms.
Equal cases give equal motions.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from dtwin.controller.motion import ARM, STILL, Goal, MotionController
from dtwin.controller.ports import BLOCKS, PATH
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.encoders import Encoders, NoiseKind
from dtwin.errors import DivergenceError, ParameterError
from dtwin.parameters import COULOMB_WIDTH, PERIOD, PICKUP, ArmParameters, JointVector, PayloadModel, joint_vector
from dtwin.simulation.figures import Array, Figures, figures
from dtwin.task import DEFAULT_TASK, Task
from dtwin.twin.closed_loop import CompiledLoop, Motion
from dtwin.twin.dynamics import integrate
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import SUBSTEP, integrate_machine, vector_of
from dtwin.twin.rollout import is_weight_only
from dtwin.twin.side_by_side import Begun, SideBySide
from iec61499.native.resource import NativeResource

SUBSTEPS: Final = 4
"""Number of RK4 steps per tick, each of 2.5 ms as in the emulation."""
HOLD: Final = 2.0
"""Time for which a motion is simulated after its path has ended, s."""
REST: Final = 100
"""Ticks for which an arm with effects has rested before its motion: the blocks have learned by then what they do not
know of it, as they have before most motions of a cell."""
LONGEST: Final = 600.0
"""Longest duration of a simulated motion, s."""


@dataclass(frozen=True, slots=True)
class MotionCase:
    """One motion to simulate.

    Attributes:
        goal: place of the simulator's task, or joint angles in rad, at which the motion ends.
        settings: settings of the function blocks.
        theta: joint angles at the start, rad.
        omega: joint velocities at the start, rad/s.
        arm: simulated arm; the controller keeps its own model.
        payload: mass at the tip, kg.
        carries: whether the controller counts on a box of mass settings.payload; None for when payload is not 0.
        effects: what the simulated arm has beside its parameters.
        payload_model: "point" for a point mass at the tip, "weight" for its weight without inertia.
        noise: amplitude (uniform) or standard deviation (gaussian) of the encoder noise, rad.
        noise_kind: "uniform", "gaussian" or "none".
        seed: number of the random generator of the noise.
        duration: duration of the simulation, s; None for the target time and 2 s more.

    Raises:
        ParameterError: a number is out of range.
    """

    goal: Goal
    settings: ControlSettings = field(default_factory=ControlSettings)
    theta: JointVector = PICKUP.theta
    omega: JointVector = STILL
    arm: ArmParameters = field(default_factory=ArmParameters)
    payload: float = 0.0
    carries: bool | None = None
    effects: Effects = NO_EFFECTS
    payload_model: PayloadModel = "point"
    noise: float = 0.0
    noise_kind: NoiseKind = "uniform"
    seed: int = 0
    duration: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.payload) and self.payload >= 0):
            raise ParameterError(f"payload: expected a finite mass of at least 0 kg, got {self.payload}")
        if not all(map(math.isfinite, (*self.theta, *self.omega))):
            raise ParameterError(f"start: expected finite angles and velocities, got {self.theta} and {self.omega}")
        if not PERIOD <= self.seconds <= LONGEST:
            raise ParameterError(f"duration: expected {PERIOD} to {LONGEST:g} s, got {self.seconds:g}")
        if is_weight_only(self.payload_model) and self.effects != NO_EFFECTS:
            raise ParameterError("payload model: expected point for an arm with effects, got weight")

    @property
    def seconds(self) -> float:
        """Duration of the simulation, s."""
        return self.settings.target_time + HOLD if self.duration is None else self.duration


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """A simulated motion; sample k is at k times 10 ms.

    Attributes:
        case: case that was simulated.
        target: angles at which the path ends, rad.
        states: (N + 1, 6), true angles (rad), then velocities (rad/s).
        measured: (N, 3), angles that the encoders measure, rad.
        path: (N, 3), desired angles, rad.
        volts: (N, 3), voltages, V.
        figures: performance figures of the motion.
    """

    case: MotionCase
    target: JointVector
    states: Array
    measured: Array
    path: Array
    volts: Array
    figures: Figures

    @property
    def time(self) -> Array:
        """Times of the samples since the start, (N,), s."""
        return np.arange(len(self.path), dtype=np.float64) * PERIOD

    @property
    def theta(self) -> Array:
        """True angles at the samples, (N, 3), rad."""
        return self.states[:-1, :3]


class Arm(Protocol):
    """The arm that moves in a simulated motion.

    Attributes:
        states: (N + 1, 6), true angles (rad), then velocities (rad/s), filled row by row.
    """

    states: Array

    def advance(self, tick: int, volts: JointVector) -> JointVector:
        """Holds voltages (V) from a tick to the next, writes the next row and returns its angles (rad)."""


class TwinArm:
    """The analytic twin as an arm.

    Args:
        case: case that is simulated.
        ticks: number of ticks of the motion.
    """

    def __init__(self, case: MotionCase, ticks: int) -> None:
        self.states = np.empty((ticks + 1, 6))
        self.states[0] = (*case.theta, *case.omega)
        self._vector = np.array(case.arm.vector())
        self._weight_only = is_weight_only(case.payload_model)
        self._load = np.array([case.payload])
        self._command = np.empty((1, 3))

    def advance(self, tick: int, volts: JointVector) -> JointVector:
        """Holds voltages (V) from a tick to the next, writes the next row and returns its angles (rad).

        Raises:
            DivergenceError: the state is no longer finite.
        """
        self._command[0] = volts
        rows = self.states[tick : tick + 2]
        if not integrate(
            self._vector, self._command, self._load, PERIOD, SUBSTEPS, self._weight_only, COULOMB_WIDTH, rows
        ):
            raise DivergenceError("what-if simulation", tick * PERIOD, rows[0])
        return joint_vector(rows[1, :3])


class MachineArm:
    """The analytic twin with effects as an arm; commands before the first tick were like the first.

    Its encoders are not eccentric: the loop controls what they read, and a pose that is some milliradians off is as
    heavy.

    Args:
        case: case that is simulated; its payload is a point mass.
        ticks: number of ticks of the motion.
    """

    def __init__(self, case: MotionCase, ticks: int) -> None:
        self.states = np.empty((ticks + 1, 6))
        self.states[0] = (*case.theta, *case.omega)
        self._vector = vector_of(case.arm, case.effects)
        self._commands, self._loads = np.empty((ticks, 3)), np.full(ticks, case.payload)
        self._acting = np.full(3, np.nan)

    def advance(self, tick: int, volts: JointVector) -> JointVector:
        """Commands voltages (V) from a tick to the next, writes the next row and returns its angles (rad).

        Raises:
            DivergenceError: the state is no longer finite.
        """
        self._commands[tick] = volts
        commands, loads, rows = self._commands[: tick + 1], self._loads[: tick + 1], self.states[tick : tick + 2]
        if not integrate_machine(self._vector, commands, loads, PERIOD, SUBSTEP, tick, self._acting, rows):
            raise DivergenceError("what-if simulation", tick * PERIOD, rows[0])
        return joint_vector(rows[1, :3])


def _twin(case: MotionCase, ticks: int) -> Arm:
    """The analytic twin for a case and a number of ticks."""
    return TwinArm(case, ticks) if case.effects == NO_EFFECTS else MachineArm(case, ticks)


class Simulator:
    """Simulates motions, one after another, on one set of function blocks.

    Args:
        blocks: folder of the function-block library.
        task: says where the places are to which motions lead by their names.
        via: whether motions are parts of ways, see `MotionController`.

    Raises:
        FunctionBlockError: the library cannot be used.
    """

    def __init__(self, blocks: Path = BLOCKS, task: Task = DEFAULT_TASK, via: bool = False) -> None:
        self.controller = MotionController(blocks, task, via)
        resource = self.controller.resource
        native = resource if isinstance(resource, NativeResource) else None
        self._loop = None if native is None else CompiledLoop(native, ARM, PATH, SUBSTEPS)
        self._side_by_side = None if native is None else SideBySide(native, ARM, PATH, SUBSTEPS)

    def run(self, case: MotionCase, arm_of: Callable[[MotionCase, int], Arm] | None = None) -> Outcome:
        """Simulates a motion.

        Args:
            case: case to simulate.
            arm_of: makes the arm for a case and a number of ticks; the analytic twin if not given.

        Raises:
            ParameterError: there is no place of the goal's name.
            DivergenceError: the state of the arm is no longer finite.
        """
        ticks = _ticks(case)
        if self._loop is not None and arm_of is None and case.effects == NO_EFFECTS:
            motion = self._compiled(self._loop, case, ticks)
        else:
            resting = REST if case.effects != NO_EFFECTS and case.omega == STILL else 0
            motion = self._stepped(case, (arm_of or _twin)(case, resting + ticks), ticks, resting)
        return _outcome(case, self.controller.target(), motion)

    def run_all(self, cases: Sequence[MotionCase]) -> Iterator[Outcome]:
        """Simulates motions of the twin and gives each as `run` does, as soon as it is there.

        Those of equal durations that follow one another are computed side by side, which takes a third of the time.

        Raises:
            ParameterError: there is no place of a goal's name.
            DivergenceError: the state of the next motion's arm is no longer finite.
        """
        if self._side_by_side is None or any(case.effects != NO_EFFECTS for case in cases):
            yield from map(self.run, cases)
            return
        for ticks, group in itertools.groupby(cases, _ticks):
            alike = list(group)
            prepared = [self._prepared(case, ticks) for case in alike]
            motions = self._side_by_side.run([begun for begun, _ in prepared], ticks)
            for case, (_, target), motion in zip(alike, prepared, motions, strict=True):
                yield _outcome(case, target, motion)

    def _prepared(self, case: MotionCase, ticks: int) -> tuple[Begun, JointVector]:
        """A motion before its first sample, and the angles at which its path ends."""
        assert isinstance(self.controller.resource, NativeResource)
        noise = self._prepare(case, ticks)
        start = np.array((*case.theta, *case.omega))
        unit = self.controller.resource.numbers().copy()
        begun = Begun(start, case.arm, case.payload, case.payload_model, _carries(case), noise, unit)
        return begun, self.controller.target()

    def _prepare(self, case: MotionCase, ticks: int) -> Array:
        """Prepares the controller for the first sample, and gives the noise, (N, 3), rad; (0, 3) for none."""
        encoders, noise = _encoders(case), np.empty((0, 3))
        if encoders is not None:
            noise = np.array([_measure(encoders, STILL) for _ in range(ticks)])
        first = case.theta if encoders is None else joint_vector(noise[0] + case.theta)
        self.controller.prepare(first, case.goal, case.settings, carries=_carries(case), omega=case.omega)
        return noise

    def _compiled(self, loop: CompiledLoop, case: MotionCase, ticks: int) -> Motion:
        noise = self._prepare(case, ticks)
        start = np.array((*case.theta, *case.omega))
        return loop.run(start, ticks, case.arm, case.payload, case.payload_model, _carries(case), noise)

    def _stepped(self, case: MotionCase, arm: Arm, ticks: int, resting: int) -> Motion:
        """A motion tick by tick, after some ticks in which the arm is held where it starts."""
        controller, step, path_of = self.controller, self.controller.step, self.controller.path
        encoders = _encoders(case)
        samples: list[JointVector] = []
        path: list[JointVector] = []
        commands: list[JointVector] = []
        theta = case.theta
        for k in range(resting + ticks):
            sample = theta if encoders is None else _measure(encoders, theta)
            if not k:
                goal = case.theta if resting else case.goal
                volts = controller.start(sample, goal, case.settings, carries=_carries(case), omega=case.omega)
            elif k == resting:
                volts = controller.go(sample, case.goal)
            else:
                volts = step(sample)
            samples.append(sample)
            path.append(path_of())
            commands.append(volts)
            theta = arm.advance(k, volts)
        found = (np.array(each)[resting:] for each in (arm.states, samples, path, commands))
        return Motion(*found)


def _ticks(case: MotionCase) -> int:
    return round(case.seconds / PERIOD)


def _outcome(case: MotionCase, target: JointVector, motion: Motion) -> Outcome:
    theta, omega = motion.states[:, :3], motion.states[:, 3:]
    came_to = figures(theta, omega, motion.path, motion.volts, target, case.arm.voltage_constant)
    return Outcome(case, target, motion.states, motion.measured, motion.path, motion.volts, came_to)


def _carries(case: MotionCase) -> bool:
    return case.payload > 0 if case.carries is None else case.carries


def _encoders(case: MotionCase) -> Encoders | None:
    return Encoders(case.noise_kind, case.noise, np.random.default_rng(case.seed)) if case.noise else None


def _measure(encoders: Encoders, theta: JointVector) -> JointVector:
    return tuple(encoders.measure([*theta, 0.0], 0.0)[:-1])
