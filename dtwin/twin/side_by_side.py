"""Motions side by side: each has its arm and its controller, and one instruction moves all arms.

The controllers are machine code for one motion, called one after another. The twin's steps, which take most of the
time of one motion, are those of `dynamics` in `lanes`, with the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import DivergenceError
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, PayloadModel
from dtwin.twin import closed_loop, dynamics, lanes, rollout
from dtwin.twin.closed_loop import DIVERGED, FINISHED, LoadedArm, Motion, exchange
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, Coefficients, clipped, coefficients, runge_kutta
from dtwin.twin.lanes import WIDTH, load, store
from dtwin.twin.rollout import Steps, is_weight_only
from iec61499.native.resource import NativeResource

_K: Final = Coefficients._fields.index("K1")
_MU: Final = Coefficients._fields.index("mu1")


class Controllers(NamedTuple):
    """J motion controllers in machine code.

    Attributes:
        function: address of their function.
        units: (J, M), their states.
        requests: (J, 32), messages as for `closed_loop`.
        answer: (3,), room for an answer.
        places: (3,), places in a row of `units` of the desired angles, rad.
    """

    function: int
    units: Array
    requests: NDArray[np.uint8]
    answer: Array
    places: NDArray[np.int64]


@kernel(inlined=True)
def _loaded(arms: LoadedArm, count: int) -> Array:
    """The coefficients of arms, one a lane, (18, WIDTH); lanes that are left over have those of the first."""
    c = np.empty((18, WIDTH))
    for lane in range(WIDTH):
        job = lane if lane < count else 0
        found = coefficients(arms.parameters[job], arms.payload[job], arms.weight_only[job])
        for i, value in enumerate(found):
            c[i, lane] = value
    return c


@kernel(nogil=True, uses=(closed_loop, dynamics, lanes, rollout))
def closed_loops(
    controllers: Controllers, noise: Array, arms: LoadedArm, steps: Steps, motions: Motion, ends: NDArray[np.int64]
) -> None:
    """Lets J controllers move as many arms, at most `WIDTH`, each as `closed_loop` does with one.

    Args:
        controllers: the controllers.
        noise: (J, N, 3), what the encoders add to the angles, rad.
        arms: the arms, one a row.
        steps: how their motions are integrated.
        motions: receives the motions, one a row; the first states of each are where it starts.
        ends: (J, 2), receives what `closed_loop` returns.
    """
    (states, samples, path, volts), (function, units, requests, answer, places) = motions, controllers
    count, ticks = samples.shape[0], samples.shape[1]
    c, x, torque = _loaded(arms, count), np.empty((6, WIDTH)), np.zeros((3, WIDTH))
    for lane in range(WIDTH):
        for i in range(6):
            x[i, lane] = states[lane if lane < count else 0, 0, i]
    arm = Coefficients(
        *(load(c, 0), load(c, 1), load(c, 2), load(c, 3), load(c, 4), load(c, 5)),
        *(load(c, 6), load(c, 7), load(c, 8), load(c, 9), load(c, 10), load(c, 11)),
        *(load(c, 12), load(c, 13), load(c, 14), load(c, 15), load(c, 16), load(c, 17)),
    )
    rubs = bool(np.any(c[_MU:] != 0.0))
    ends[:, 0], ends[:, 1] = FINISHED, ticks
    angles, step = requests.view(np.float64), steps.period / steps.substeps
    unit, request, answered = units.ctypes.data, requests.ctypes.data, answer.ctypes.data
    for k in range(ticks):
        for job in range(count):
            if ends[job, 0] != FINISHED:
                continue
            for i in range(3):
                angles[job, i] = samples[job, k, i] = states[job, k, i] + noise[job, k, i]
            requests[job, 24] = k == 0
            place = unit + 8 * job * units.shape[1]
            ends[job, 0] = exchange(function, place, request + job * requests.shape[1], answered)
            if ends[job, 0] != FINISHED:
                ends[job, 1] = k
                continue
            for i in range(3):
                volts[job, k, i] = answer[i]
                path[job, k, i] = units[job, places[i]]
                torque[i, job] = c[_K + i, job] * clipped(answer[i])
        state = (load(x, 0), load(x, 1), load(x, 2), load(x, 3), load(x, 4), load(x, 5))
        held = (load(torque, 0), load(torque, 1), load(torque, 2))
        if rubs:
            for _ in range(steps.substeps):
                state = runge_kutta(state, held, arm, steps.width, step, True)
        else:
            for _ in range(steps.substeps):
                state = runge_kutta(state, held, arm, steps.width, step, False)
        for i, value in enumerate(state):
            store(x, i, value)
        for job in range(count):
            total = 0.0
            for i in range(6):
                states[job, k + 1, i] = x[i, job]
                total += x[i, job]
            if ends[job, 0] == FINISHED and not np.isfinite(total):
                ends[job, 0], ends[job, 1] = DIVERGED, k


@dataclass(frozen=True, slots=True, eq=False)
class Begun:
    """A motion whose controller waits for the first sample.

    Attributes:
        start: (6,), angles in rad, then velocities in rad/s.
        arm: the arm that is simulated.
        payload: mass at the tip, kg.
        payload_model: how the mass counts.
        carries: whether the controller counts on a box in the gripper.
        noise: (N, 3), what the encoders add to the angles, rad; (0, 3) for none.
        unit: the state of the controller.
    """

    start: Array
    arm: ArmParameters
    payload: float
    payload_model: PayloadModel
    carries: bool
    noise: Array
    unit: Array


class SideBySide:
    """The blocks of a motion controller, as often as there are motions, each with a twin.

    Args:
        blocks, server, path, substeps: as for `CompiledLoop`.
    """

    def __init__(self, blocks: NativeResource, server: str, path: Sequence[str], substeps: int) -> None:
        self._blocks = blocks
        self._server = server
        self._steps = Steps(PERIOD, substeps, COULOMB_WIDTH)
        self._function = blocks.function(f"exchange__{server}")
        self._places = np.array([blocks.offset(name) // 8 for name in path])

    def run(self, motions: Sequence[Begun], ticks: int) -> Iterator[Motion]:
        """Simulates motions of N ticks, `WIDTH` at a time, and gives them in their order.

        Raises:
            DivergenceError: the state of the next motion's arm is no longer finite.
            FunctionBlockError: a block failed. CommunicationError: the blocks did not answer.
        """
        for first in range(0, len(motions), WIDTH):
            yield from self._bundle(motions[first : first + WIDTH], ticks)

    def _bundle(self, motions: Sequence[Begun], ticks: int) -> Iterator[Motion]:
        count = len(motions)
        units = np.array([motion.unit for motion in motions])
        requests = np.zeros((count, 32), np.uint8)
        requests[:, 25] = [motion.carries for motion in motions]
        found = Motion(np.empty((count, ticks + 1, 6)), *(np.empty((count, ticks, 3)) for _ in range(3)))
        found.states[:, 0] = [motion.start for motion in motions]
        noise = np.full((count, ticks, 3), -0.0)  # which changes nothing that it is added to, not even a sign
        for job, motion in enumerate(motions):
            if len(motion.noise):
                noise[job] = motion.noise
        arms = LoadedArm(
            np.array([motion.arm.vector() for motion in motions]),
            np.array([float(motion.payload) for motion in motions]),
            np.array([is_weight_only(motion.payload_model) for motion in motions]),
        )
        ends: NDArray[np.int64] = np.empty((count, 2), np.int64)
        controllers = Controllers(self._function, units, requests, np.empty(3), self._places)
        closed_loops(controllers, noise, arms, self._steps, found, ends)
        for job, (problem, tick) in enumerate(ends.tolist()):
            if problem == DIVERGED:
                raise DivergenceError("what-if simulation", tick * PERIOD, found.states[job, tick])
            if problem != FINISHED:
                self._blocks.restore(units[job].tobytes())
                self._blocks.check(problem, self._server)
            yield Motion(*(each[job] for each in found))
