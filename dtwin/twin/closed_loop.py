"""The arm under a controller in machine code: a whole motion in one compiled call, on one core, without the GIL."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dtwin.errors import DivergenceError
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, PayloadModel
from dtwin.twin import dynamics
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, advance, coefficients, held_torque
from dtwin.twin.rollout import is_weight_only
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


@kernel(nogil=True, uses=(dynamics,))
def closed_loop(
    function: int,
    unit: int,
    request: NDArray[np.uint8],
    answer: Array,
    memory: Array,
    watched: NDArray[np.int64],
    noise: Array,
    p: Array,
    payload: float,
    period: float,
    substeps: int,
    weight_only: bool,
    width: float,
    states: Array,
    samples: Array,
    path: Array,
    volts: Array,
) -> tuple[int, int]:
    """Lets a controller move the arm from states[0]: a sample, its answer, and the arm for a period with that held.

    Args:
        function: address of the controller's function, called with the three addresses that follow.
        unit: address of the controller's state.
        request: (32,), the message to the controller: three angles in rad as float64, whether it is the first of a
            motion, and what else does not change.
        answer: (3,), receives the voltages, V.
        memory: (M,), the controller's state as float64, of which `watched` is read after each answer.
        watched: (3,), places in `memory` of the desired angles, rad.
        noise: (N, 3), what the encoders add to the angles, rad; (0, 3) for none.
        p: (21,), parameters of the arm.
        payload: mass at the tip, kg.
        period, substeps, weight_only, width: as for `integrate`.
        states: (N + 1, 6), angles in rad, then velocities in rad/s; row 0 is the start, the others are written.
        samples: (N, 3), receives what the encoders measured, rad.
        path: (N, 3), receives the desired angles, rad.
        volts: (N, 3), receives the voltages, V.

    Returns:
        FINISHED, DIVERGED when a state is not finite, or what else the function returned; and the tick.
    """
    angles = request[:24].view(np.float64)
    request_address, answer_address = request.ctypes.data, answer.ctypes.data
    arm = coefficients(p, payload, weight_only)
    x = (states[0, 0], states[0, 1], states[0, 2], states[0, 3], states[0, 4], states[0, 5])
    for k in range(samples.shape[0]):
        for i in range(3):
            samples[k, i] = states[k, i] + noise[k, i] if noise.shape[0] else states[k, i]
            angles[i] = samples[k, i]
        request[24] = k == 0
        problem = exchange(function, unit, request_address, answer_address)
        if problem != FINISHED:
            return problem, k
        for i in range(3):
            volts[k, i] = answer[i]
            path[k, i] = memory[watched[i]]
        x, finite = advance(x, held_torque(answer, arm), arm, width, period / substeps, substeps)
        for i in range(6):
            states[k + 1, i] = x[i]
        if not finite:
            return DIVERGED, k
    return FINISHED, samples.shape[0]


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
def _responses(
    function: int,
    unit: int,
    request: NDArray[np.uint8],
    answer: Array,
    memory: Array,
    rest: Array,
    places: NDArray[np.int64],
    points: Array,
    found: Array,
) -> tuple[int, int]:
    """Lets a controller answer samples that all come in the same state, as `TickResponses.after` says."""
    angles = request[:24].view(np.float64)
    request_address, answer_address = request.ctypes.data, answer.ctypes.data
    count = places.shape[0]
    for k in range(points.shape[0]):
        memory[:] = rest
        for i in range(count):
            memory[places[i]] = points[k, i]
        for i in range(3):
            angles[i] = points[k, count + i]
        problem = exchange(function, unit, request_address, answer_address)
        if problem != FINISHED:
            return problem, k
        for i in range(count):
            found[k, i] = memory[places[i]]
        for i in range(3):
            found[k, count + i] = answer[i]
    memory[:] = rest
    return FINISHED, points.shape[0]


class TickResponses:
    """What one tick of a motion controller makes of its memory and of a sample.

    Args:
        blocks: the blocks, in machine code.
        server: the SERVER block, as for `CompiledLoop`.
        names: n variables, of type LREAL: the memory.
    """

    def __init__(self, blocks: NativeResource, server: str, names: Sequence[str]) -> None:
        self._blocks = blocks
        self._server = server
        self._function = blocks.function(f"exchange__{server}")
        self._memory = blocks.numbers()
        self._places = np.array([blocks.offset(name) // 8 for name in names])
        self._request = np.zeros(32, np.uint8)
        self._answer = np.empty(3)

    def values(self) -> Array:
        """The values of the variables, (n,)."""
        return self._memory[self._places]

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
        self._request[25] = carries
        problem, _ = _responses(
            self._function,
            self._blocks.address,
            self._request,
            self._answer,
            self._memory,
            self._memory.copy(),
            self._places,
            points,
            found,
        )
        self._blocks.check(problem, self._server)
        return found


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
        server: the SERVER block that receives a sample as `closed_loop` says, and answers with volts.
        path: the variables, of type LREAL, with the desired angles.
        substeps: number of RK4 steps per tick.
    """

    def __init__(self, blocks: NativeResource, server: str, path: Sequence[str], substeps: int) -> None:
        self._blocks = blocks
        self._substeps = substeps
        self._server = server
        self._function = blocks.function(f"exchange__{server}")
        self._memory = blocks.numbers()
        self._watched = np.array([blocks.offset(name) // 8 for name in path])
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
            float(payload),
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
            self._blocks.check(problem, self._server)
        return Motion(states, measured, path, volts)
