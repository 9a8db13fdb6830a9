"""The arm under a controller in machine code: a whole motion in one compiled call, on one core, without the GIL.

Numba notices edits of this file but not of dynamics.py, whose `integrate` it calls and does not inline.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, integrate

FINISHED: Final = 0
DIVERGED: Final = -1


@intrinsic
def _exchange(typing: Any, function: Any, unit: Any, request: Any, answer: Any) -> Any:
    """Calls `int32_t function(void *unit, const void *request, void *answer)` at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.IntType(32), [pointer] * 3)
        called = builder.inttoptr(arguments[0], kind.as_pointer())
        return builder.call(called, [builder.inttoptr(address, pointer) for address in arguments[1:]])

    return types.int32(types.int64, types.int64, types.int64, types.int64), generate


@kernel(nogil=True)
def closed_loop(
    function: int,
    unit: int,
    request: NDArray[np.uint8],
    answer: Array,
    memory: Array,
    watched: NDArray[np.int64],
    noise: Array,
    p: Array,
    payload: Array,
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
        payload: (1,), mass at the tip, kg.
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
    for k in range(samples.shape[0]):
        for i in range(3):
            samples[k, i] = states[k, i] + noise[k, i] if noise.shape[0] else states[k, i]
            angles[i] = samples[k, i]
        request[24] = k == 0
        problem = _exchange(function, unit, request_address, answer_address)
        if problem != FINISHED:
            return problem, k
        for i in range(3):
            volts[k, i] = answer[i]
            path[k, i] = memory[watched[i]]
        if integrate(p, volts[k : k + 1], payload, period, substeps, weight_only, width, states[k : k + 2]) == 0:
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
        problem = _exchange(function, unit, request + k * requests.shape[1], answer + 8 * k * answers.shape[1])
        if problem != FINISHED:
            return k
    return requests.shape[0]
