"""A whole motion of the twin under the function blocks in one compiled call, where the blocks are machine code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dtwin.controller.motion import ARM
from dtwin.controller.ports import PATH
from dtwin.errors import DivergenceError
from dtwin.iec61499.native.resource import NativeResource
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, PayloadModel
from dtwin.simulation.figures import Array
from dtwin.twin.closed_loop import DIVERGED, FINISHED, closed_loop
from dtwin.twin.rollout import is_weight_only


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """What a motion comes to; sample k is at k times 10 ms.

    Attributes:
        states: (N + 1, 6), true angles (rad), then velocities (rad/s).
        measured: (N, 3), angles that the encoders measure, rad.
        path: (N, 3), desired angles, rad.
        volts: (N, 3), voltages, V.
    """

    states: Array
    measured: Array
    path: Array
    volts: Array


class CompiledLoop:
    """The blocks of a motion controller and the twin in one loop.

    Args:
        blocks: the blocks, in machine code.
        substeps: number of RK4 steps per tick.
    """

    def __init__(self, blocks: NativeResource, substeps: int) -> None:
        self._blocks = blocks
        self._substeps = substeps
        self._function = blocks.function(f"exchange__{ARM}")
        self._memory = blocks.numbers()
        self._watched = np.array([blocks.offset(name) // 8 for name in PATH])
        self._request = np.zeros(32, np.uint8)
        self._answer = np.empty(3)

    def run(
        self,
        start: Array,
        ticks: int,
        arm: ArmParameters,
        payload: float,
        payload_model: PayloadModel,
        carries: bool,
        noise: Array,
    ) -> Motion:
        """Lets the blocks, which are ready for the first sample, move the arm.

        Args:
            start: (6,), angles in rad, then velocities in rad/s.
            ticks: N, the number of samples.
            arm: the arm that is simulated.
            payload: mass at the tip, kg.
            payload_model: how the mass counts.
            carries: whether the controller counts on a box in the gripper.
            noise: (N, 3), what the encoders add to the angles, rad; (0, 3) for none.

        Raises:
            DivergenceError: the state of the arm is no longer finite.
            FunctionBlockError: a block failed. CommunicationError: the blocks did not answer.
        """
        states = np.empty((ticks + 1, 6))
        states[0] = start
        measured, path, volts = np.empty((ticks, 3)), np.empty((ticks, 3)), np.empty((ticks, 3))
        self._request[25] = carries
        problem, tick = closed_loop(
            self._function,
            self._blocks.address,
            self._request,
            self._answer,
            self._memory,
            self._watched,
            noise,
            np.array(arm.vector()),
            np.array([payload]),
            PERIOD,
            self._substeps,
            is_weight_only(payload_model),
            COULOMB_WIDTH,
            states,
            measured,
            path,
            volts,
        )
        if problem == DIVERGED:
            raise DivergenceError("what-if simulation", tick * PERIOD, states[tick])
        if problem != FINISHED:
            self._blocks.check(problem, ARM)
        return Motion(states, measured, path, volts)
