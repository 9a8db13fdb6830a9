"""Ticks of the cell in machine code: blocks, plant and log without Python, as long as nothing happens.

What happens - the gripper closes or opens, a box arrives, a fault begins, the blocks call for help - happens in
Python, by the same code as ever: a tick in which the blocks' answer asks for it is handed over with that answer. The
log has the bits of a loop in Python.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import EMULATOR, PATH, sensor_values
from dtwin.controller.sequence import HELP
from dtwin.emulation import states
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.states import Free
from dtwin.errors import DivergenceError
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import NUMBERS
from dtwin.parameters import PERIOD
from dtwin.signals import StepRecord
from dtwin.twin import closed_loop
from dtwin.twin.closed_loop import FINISHED, Blocks, exchange
from dtwin.twin.compiled import kernel
from iec61499.native.resource import NativeResource

Array = NDArray[np.float64]

HANDED_OVER: Final = -2
"""The last answer asks for something that is not done in machine code."""
LOST: Final = -3
"""The state of the plant is no longer one."""
_MOST: Final = 100
"""Most ticks of one call."""
_GRIPPED: Final = 32


@intrinsic
def _step(typing: Any, function: Any, model: Any, data: Any) -> Any:
    """Calls `void function(const void *model, void *data)` at an address."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 2)
        called = builder.inttoptr(arguments[0], kind.as_pointer())
        builder.call(called, [builder.inttoptr(address, pointer) for address in arguments[1:]])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), generate


@kernel(uses=(closed_loop, states), nogil=True)
def advance(plant: Free, b: Blocks, watched: NDArray[np.int64], sensed: Array, rows: Array) -> tuple[int, int]:
    """Lets the blocks and the plant go on for at most N ticks.

    Args:
        plant: the plant; what it reads is replaced unless the state is lost.
        b: the blocks, as for `cell_loop.work`.
        watched: places among the blocks' state as int32 of variables, such as the one that says for what they call.
        sensed: (4,), what the encoders read now, rad; replaced.
        rows: (N, 19), receives the NUMBERS of the log.

    Returns:
        The number of ticks done, and FINISHED, HANDED_OVER, LOST (in the last tick done) or what the function of the
        blocks returned (in the tick after these).
    """
    step, model, data, q, w, control, read, substeps, steps, due, rate, payload, limits, errors = plant
    function, unit, request, answer, memory, places = b
    numbers, volts = request[:_GRIPPED].view(np.float64), answer[:_GRIPPED].view(np.float64)
    requested, answered = request.ctypes.data, answer.ctypes.data
    words = memory.view(np.int32)
    gripped, before = answer[_GRIPPED], words[watched]
    for k in range(rows.shape[0]):
        numbers[:] = sensed
        problem = exchange(function, unit, requested, answered)
        if problem != FINISHED:
            return k, problem
        asks = answer[_GRIPPED] != gripped
        for i in range(len(before)):
            asks |= words[watched[i]] != before[i]
        total = abs(volts[0]) + abs(volts[1]) + abs(volts[2]) + abs(volts[3])
        if asks or not total < limits[0]:
            return k, HANDED_OVER
        row = rows[k]
        row[0] = steps / rate
        for i in range(3):
            row[1 + i], row[4 + i], row[7 + i], row[10 + i] = read[i], read[4 + i], sensed[i], memory[places[i]]
        for i in range(4):
            row[13 + i] = control[i] = volts[i]
        row[17], row[18] = sensed[3], payload
        for _ in range(substeps):
            _step(step, model, data)
        steps += substeps
        total = q[0] + q[1] + q[2] + q[3] + w[0] + w[1] + w[2] + w[3]
        if not -limits[1] < total < limits[1]:
            return k + 1, LOST
        if not limits[2] <= q[3] <= limits[3]:
            q[3] = limits[2] if q[3] < limits[2] else limits[3]
            w[3] = 0.0
        for i in range(4):
            read[i], read[4 + i] = q[i], w[i]
            sensed[i] = q[i] + errors[k, i]
        if steps >= due:
            return k + 1, FINISHED
    return rows.shape[0], FINISHED


class CompiledTicks:
    """The ticks of a cell whose blocks and plant are machine code.

    Args:
        emulation: the emulated arm and its boxes.
        controller: its controller.
        blocks: the controller's blocks.
        log: receives the ticks.
        watched: a variable of the blocks; a tick in which it changes is not done in machine code.
    """

    def __init__(
        self,
        emulation: Emulation,
        controller: EmbeddedController,
        blocks: NativeResource,
        log: RunLog,
        watched: str = HELP,
    ) -> None:
        self._emulation, self._controller, self._blocks, self._log = emulation, controller, blocks, log
        self._server = blocks.server(EMULATOR.block)
        function, memory = blocks.function(f"exchange__{EMULATOR.block}"), blocks.numbers()
        places = np.array([blocks.offset(name) // 8 for name in PATH])
        request, answer = np.zeros(0, np.uint8), self._server.answer
        self._arrays = Blocks(function, blocks.address, request, answer, memory, places)
        self._watched = np.array([blocks.offset(name) // 4 for name in {HELP, watched}])
        self._rows = np.empty((_MOST, len(NUMBERS)))
        self._box = False, ""

    def run(self, ticks: int) -> int:
        """Does as many of some ticks as can be done in machine code, and one that cannot if it comes to that.

        Raises:
            DtwinError: plant or controller failed; all ticks before are recorded.
        """
        emulation, rows = self._emulation, self._rows[: min(ticks, _MOST)]
        plant = emulation.free(len(rows))
        if plant is None:
            return 0
        sensors = emulation.read()
        box = sensors.box_present, sensors.box_colour
        if not len(self._arrays.request) or box != self._box:
            request, self._box = self._server.requests([sensor_values(sensors)])[0], box
            self._arrays = self._arrays._replace(request=request)
        sensed = np.array([*sensors.theta, sensors.gripper])
        done, problem = advance(plant, self._arrays, self._watched, sensed, rows[: len(plant.errors)])
        if done:
            self._log.extend(rows[:done], *box, gripped=emulation.gripped)
            emulation.adopt_ticks(done, rows[done - 1])
        if problem == LOST:
            raise DivergenceError("emulation", emulation.truth().time, plant.read.tolist())
        if problem == HANDED_OVER:
            sensors = emulation.read()
            command = self._controller.command(sensors, self._server.last())
            record = StepRecord(emulation.truth(), sensors, self._controller.target(), command)
            self._log.append(record)
            emulation.apply(command)
            emulation.advance(PERIOD)
            return done + 1
        self._blocks.check(problem, EMULATOR.block)
        return done
