"""The chain twin at work under the real function blocks, prepared once for many changes of its settings.

The twin is the chain of dtwin/equations with the friction of the model and the steps of the encoders. Blocks and
chain go on together in machine code; where the blocks run in Python, a loop there does the same, to the bit.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array, holding, without_servos
from dtwin.arm.model import ArmModel
from dtwin.arm.modelled import with_model
from dtwin.controller.chain.application import inputs, tuning_inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.equations.native import DryFriction, MovingChain, NativeChain
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import DivergenceError, ParameterError
from dtwin.loop.closed_loop import FINE, LOST, Course, Drives, PlantInMemory, Ticks
from dtwin.run.chain import ChainSettings
from dtwin.run.machine_code.chain import closed_loop
from dtwin.run.margins.chain import JointMargins, PosedPlant, margins_of, posed_plants
from dtwin.simulation.chain.checks import check_model
from dtwin.simulation.chain.whatif import ArmChange, ArmOutcome, changed

STEPS: Final = 4
"""Integration steps in a tick, as in the emulation."""
_SHARP: Final = 0.002
"""Velocity over which dry friction changes its sign, in parts of the least speed of a joint: sharp."""
_LOADS: Final = 16
"""Loads of which the twin is kept."""
POSES: Final = 4
"""Poses at which the loops are looked at."""


class ArmSimulator:
    """An arm that does its work on the twin, from where it rests.

    Args:
        settings: the run of the cell.
        model: what the arm is as the twin knows it, and by which its blocks reckon.
        real: what the twin is, if it is something else than the model by which its blocks reckon.

    Raises:
        ParameterError: the model is out of bounds.
        ModelError: a drive has a loop of its own.
    """

    def __init__(self, settings: ChainSettings, model: ArmModel, real: Arm | None = None) -> None:
        self._settings = settings
        self._known = known = check_model(without_servos(settings.arm, "what-if"), model)
        self._real = with_model(settings.arm, model) if real is None else real
        self._inertia = usual_inertia(known)
        self._blocks = ChainController(len(known), inputs(known, self._inertia, settings.control, settings.poses))
        self._drives = Drives(
            np.array([joint.actuator.constant or 1.0 for joint in self._real.joints]),
            np.array([joint.largest / abs(joint.actuator.constant or 1.0) for joint in known.joints]),
            np.array([joint.step for joint in known.joints]),
            settings.late,
        )
        self._twin = lru_cache(_LOADS)(self._carrying)
        self._plants = lru_cache(_LOADS)(self._posed)
        self._loop = closed_loop(self._blocks, len(known), self._drives)

    def run(self, start: Array, change: ArmChange, duration: float, after: float = np.inf) -> ArmOutcome:
        """Lets the twin work.

        Args:
            start: positions at the beginning, (n,), rad or m.
            change: what is otherwise.
            duration: plant time, s.
            after: the work ends so long after the last pose was reached, s.

        Raises:
            ParameterError: the load is more than the arm can hold.
            DivergenceError: the motion is not finite.
        """
        period, blocks = self._known.period, self._blocks
        ticks = max(1, round(duration / period))
        rest = ticks if after >= duration else round(after / period)
        chain, dry = self._twin(change.payload)
        plant = chain.moving(start, np.zeros(len(start)), period / STEPS, STEPS, dry)
        blocks.start_anew(tuning_inputs(self._known, self._inertia, changed(self._settings.control, change)))
        waiting = np.zeros((self._drives.late, len(start)))
        if self._loop is None:
            done = self._in_python(plant, waiting, ticks, rest)
        else:
            done = self._loop.run(PlantInMemory(plant.move, plant.plant, plant.q), waiting, Course(ticks, rest))
        if done.problem == LOST:
            raise DivergenceError(f"the twin of {self._known.name}", len(done.q) * period, done.q[-1])
        if done.problem != FINE:
            blocks.check(done.problem)
        t: Array = np.arange(len(done.q), dtype=np.float64) * period
        reached = int(np.count_nonzero(np.diff(done.pose))) + blocks.done
        return ArmOutcome(t, done.q, done.target, done.command / self._drives.limit, blocks.stop, reached)

    def loops(self, change: ArmChange) -> tuple[JointMargins, ...]:
        """The margins of the loop of each joint with what is otherwise, at a few drawn poses."""
        return margins_of(self._plants(change.payload), changed(self._settings.control, change))

    def _posed(self, payload: float) -> list[PosedPlant]:
        return posed_plants(holding(self._real, payload), POSES, late=self._settings.late)

    def _carrying(self, payload: float) -> tuple[NativeChain, DryFriction | None]:
        """The twin with a load, kg, and its dry friction if it has any."""
        if not 0.0 <= payload <= self._settings.arm.most_load:
            raise ParameterError(f"payload: expected 0 to {self._settings.arm.most_load:g} kg, got {payload:g}")
        twin = holding(self._real, payload)
        coulomb = np.array([joint.friction.coulomb for joint in twin.joints])
        share = np.array([joint.friction.load for joint in twin.joints])
        if not coulomb.any() and not share.any():
            return NativeChain(twin), None
        return NativeChain(twin), DryFriction(coulomb, share, _SHARP * min(joint.speed for joint in twin.joints))

    def _in_python(self, plant: MovingChain, waiting: Array, ticks: int, rest: int) -> Ticks:
        """As `ClosedLoop.run`."""
        drives, blocks = self._drives, self._blocks
        marks = np.where(drives.grid > 0.0, drives.grid, 1.0)
        commands = [*waiting]
        rows, poses = np.zeros((4, ticks, len(plant.q))), np.zeros(ticks, dtype=np.int32)
        resting, problem, k = 0, FINE, 0
        while k < ticks and resting <= rest and problem == FINE:
            read = np.where(drives.grid > 0.0, marks * np.floor(plant.q / marks + 0.5), plant.q)
            command: Array = np.array(blocks.step(read.tolist()))
            rows[:, k], poses[k] = (plant.q, read, blocks.desired()[0], command), blocks.pose
            commands.append(np.minimum(np.maximum(command, -drives.limit), drives.limit))
            problem = FINE if plant.advance(drives.constant * commands.pop(0)) else LOST
            resting, k = resting + 1 if blocks.done else 0, k + 1
        q, readings, target, sent = rows[:, :k]
        return Ticks(q, readings, target, sent, poses[:k], problem)
