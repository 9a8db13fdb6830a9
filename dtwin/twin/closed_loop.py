"""The arm under a controller in machine code: a whole motion in one compiled call, on one core, without the GIL."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dtwin.errors import DivergenceError
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, PayloadModel
from dtwin.twin import dynamics, rollout
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, advance, coefficients, held_torque
from dtwin.twin.rollout import Steps, is_weight_only
from iec61499.native.resource import NativeResource

FINISHED: Final = 0
DIVERGED: Final = -1


@intrinsic
def exchange(typing: Any, function: Any, unit: Any, request: Any, answer: Any) -> Any:
    """Calls `int32_t function(void *unit, const void *request, void *answer)` at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.IntType(32), [pointer] * 3)
        called = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(called, [builder.inttoptr(address, pointer) for address in arguments[1:]])

    return types.int32(types.int64, types.int64, types.int64, types.int64), generate


class Blocks(NamedTuple):
    """Function blocks in machine code.

    Attributes:
        function: address of the function that answers a message, called with the addresses of the next three.
        unit: address of the blocks' state.
        request: the message to them: angles in rad as float64, and what else changes less often.
        answer: receives the answer, voltages in V as float64 first.
        memory: the blocks' state as float64.
        places: places in `memory` of what is looked at after an answer.
    """

    function: int
    unit: int
    request: NDArray[np.uint8]
    answer: NDArray[Any]
    memory: Array
    places: NDArray[np.int64]


class LoadedArm(NamedTuple):
    """An arm, or as many as the arrays have rows.

    Attributes:
        parameters: (21,), in the order of ArmParameters.vector(), SI units.
        payload: mass at the tip, kg.
        weight_only: the payload model.
    """

    parameters: Array
    payload: Any
    weight_only: Any


class Motion(NamedTuple):
    """What a motion comes to; sample k is at k times 10 ms. Of J motions all arrays have J rows of this.

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


@kernel(nogil=True, uses=(dynamics, rollout))
def closed_loop(b: Blocks, noise: Array, loaded: LoadedArm, steps: Steps, motion: Motion) -> tuple[int, int]:
    """Lets a controller move the arm from its first state: a sample, its answer, and a period with that held.

    Args:
        b: the controller, whose request, (32,), says behind three angles whether it is the first of a motion; it
            answers with three voltages, and `places` are those of the desired angles, rad.
        noise: (N, 3), what the encoders add to the angles, rad; (0, 3) for none.
        loaded: the arm.
        steps: how its motion is integrated.
        motion: receives the motion; row 0 of its states is the start.

    Returns:
        FINISHED, DIVERGED when a state is not finite, or what else the function returned; and the tick.
    """
    # Numba counts a reference at every access to an array of a structure: what the loop needs is taken out before.
    (states, measured, path, volts), (function, unit, message, answer, memory, places) = motion, b
    angles, request, answered = message[:24].view(np.float64), message.ctypes.data, answer.ctypes.data
    arm = coefficients(loaded.parameters, loaded.payload, loaded.weight_only)
    step = steps.period / steps.substeps
    x = (states[0, 0], states[0, 1], states[0, 2], states[0, 3], states[0, 4], states[0, 5])
    for k in range(measured.shape[0]):
        for i in range(3):
            measured[k, i] = states[k, i] + noise[k, i] if noise.shape[0] else states[k, i]
            angles[i] = measured[k, i]
        message[24] = k == 0
        problem = exchange(function, unit, request, answered)
        if problem != FINISHED:
            return problem, k
        for i in range(3):
            volts[k, i] = answer[i]
            path[k, i] = memory[places[i]]
        x, finite = advance(x, held_torque(answer, arm), arm, steps.width, step, steps.substeps)
        for i in range(6):
            states[k + 1, i] = x[i]
        if not finite:
            return DIVERGED, k
    return FINISHED, measured.shape[0]


@kernel(nogil=True)
def exchanges(function: int, unit: int, requests: NDArray[np.uint8], answers: Array) -> int:
    """Lets a controller answer messages, one after another.

    Args:
        function, unit: as for `closed_loop`.
        requests: (N, S), the messages.
        answers: (N, M), receives an answer in each row, as the controller lays it out.

    Returns:
        How many were answered.
    """
    request, answer = requests.ctypes.data, answers.ctypes.data
    for k in range(requests.shape[0]):
        problem = exchange(function, unit, request + k * requests.shape[1], answer + 8 * k * answers.shape[1])
        if problem != FINISHED:
            return k
    return requests.shape[0]


@kernel(nogil=True)
def _responses(b: Blocks, rest: Array, points: Array, found: Array) -> tuple[int, int]:
    """Lets a controller answer samples that all come in the same state, as `TickResponses.after` says."""
    function, unit, message, answer, memory, places = b
    angles, request, answered = message[:24].view(np.float64), message.ctypes.data, answer.ctypes.data
    count = places.shape[0]
    for k in range(points.shape[0]):
        memory[:] = rest
        for i in range(count):
            memory[places[i]] = points[k, i]
        for i in range(3):
            angles[i] = points[k, count + i]
        problem = exchange(function, unit, request, answered)
        if problem != FINISHED:
            return problem, k
        for i in range(count):
            found[k, i] = memory[places[i]]
        for i in range(3):
            found[k, count + i] = answer[i]
    memory[:] = rest
    return FINISHED, points.shape[0]


def blocks_of(resource: NativeResource, server: str, names: Sequence[str]) -> Blocks:
    """Blocks that answer the messages of a motion controller.

    Args:
        resource: the blocks, in machine code.
        server: the SERVER block that receives a sample as `closed_loop` says, and answers with volts.
        names: the variables, of type LREAL, whose places are given.
    """
    places = np.array([resource.offset(name) // 8 for name in names])
    function, memory = resource.function(f"exchange__{server}"), resource.numbers()
    return Blocks(function, resource.address, np.zeros(32, np.uint8), np.empty(3), memory, places)


class TickResponses:
    """What one tick of a motion controller makes of its memory and of a sample.

    Args:
        blocks: the blocks, in machine code.
        server: the SERVER block, as for `CompiledLoop`.
        names: n variables, of type LREAL: the memory.
    """

    def __init__(self, blocks: NativeResource, server: str, names: Sequence[str]) -> None:
        self._resource, self._server = blocks, server
        self._blocks = blocks_of(blocks, server, names)

    def values(self) -> Array:
        """The values of the variables, (n,)."""
        return self._blocks.memory[self._blocks.places]

    def after(self, carries: bool, points: Array) -> Array:
        """The variables after a tick, all from the state in which the blocks are and stay.

        Args:
            carries: whether the controller counts on a box in the gripper.
            points: (P, n + 3), values that the variables have before the tick, and the angles of its sample, rad.

        Returns:
            The values of the variables, and the voltages, V: (P, n + 3).

        Raises:
            FunctionBlockError: a block failed. CommunicationError: the blocks did not answer.
        """
        found = np.empty(points.shape)
        self._blocks.request[25] = carries
        problem, _ = _responses(self._blocks, self._blocks.memory.copy(), points, found)
        self._resource.check(problem, self._server)
        return found


class CompiledLoop:
    """The blocks of a motion controller and the twin in one loop.

    Args:
        blocks: the blocks, in machine code.
        server: the SERVER block that receives a sample as `closed_loop` says, and answers with volts.
        path: the variables, of type LREAL, with the desired angles.
        substeps: number of RK4 steps per tick.
    """

    def __init__(self, blocks: NativeResource, server: str, path: Sequence[str], substeps: int) -> None:
        self._resource, self._server = blocks, server
        self._blocks = blocks_of(blocks, server, path)
        self._steps = Steps(PERIOD, substeps, COULOMB_WIDTH)

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
        motion = Motion(np.empty((ticks + 1, 6)), np.empty((ticks, 3)), np.empty((ticks, 3)), np.empty((ticks, 3)))
        motion.states[0] = start
        self._blocks.request[25] = carries
        loaded = LoadedArm(np.array(arm.vector()), float(payload), is_weight_only(payload_model))
        problem, tick = closed_loop(self._blocks, noise, loaded, self._steps, motion)
        if problem == DIVERGED:
            raise DivergenceError("what-if simulation", tick * PERIOD, motion.states[tick])
        if problem != FINISHED:
            self._resource.check(problem, self._server)
        return motion
