"""The twin with its effects at work in a cell, in machine code: tick by tick until the gripper is told otherwise.

What comes and goes at the gripper is the caller's: between two calls it changes the payload and what the box sensor
says. Beside `dtwin.twin.machine` there are amplifiers of finite resolution, encoders with noise and resolution, and
samples that are lost.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import PERIOD
from dtwin.twin import closed_loop, dry_friction, dynamics, lanes, machine
from dtwin.twin.closed_loop import FINISHED, exchange
from dtwin.twin.compiled import kernel
from dtwin.twin.machine import MACHINE_NAMES, SUBSTEP, WIDTH, Array, integrate_machine

DIVERGED: Final = -1
_SIN: Final = MACHINE_NAMES.index("eccentric_sin1")
_COS: Final = MACHINE_NAMES.index("eccentric_cos1")
_GRIPPED: Final = 32
"""Place of the flag in an answer, behind four voltages."""


@kernel(nogil=True, uses=(closed_loop, dry_friction, dynamics, lanes, machine))
def work(
    function: int,
    unit: int,
    request: NDArray[np.uint8],
    answer: NDArray[np.uint8],
    memory: Array,
    watched: NDArray[np.int64],
    p: Array,
    payload: float,
    resolution: Array,
    jaw: Array,
    noise: Array,
    lost: NDArray[np.bool_],
    moves: bool,
    state: Array,
    commands: Array,
    acting: Array,
    fingers: Array,
    measured: Array,
    path: Array,
    volts: Array,
    gripped: NDArray[np.bool_],
) -> tuple[int, int]:
    """Lets a controller move the arm until it grips or lets go: a period, then a sample and its answer, N at most.

    Args:
        function: address of the controller's function, called with the three addresses that follow.
        unit: address of the controller's state.
        request: the message to the controller: angles of the joints and of the gripper in rad as four float64, and
            what does not change meanwhile.
        answer: receives four voltages as float64, V, and whether a box is held.
        memory: the controller's state as float64.
        watched: (3,), places in `memory` of the desired angles, rad.
        p: (78,), see MACHINE_NAMES.
        payload: point mass at the tip, kg.
        resolution: (2,), of the amplifiers, V, and of the encoders, rad; 0 for an infinite one.
        jaw: (5,), of the gripper: inertia (kg m^2), damping (N m s/rad), torque per volt (N m/V), and the angles
            between which it moves (rad).
        noise: (N, 3), what the encoders add, rad.
        lost: (N,), at which ticks the last sample is sent again.
        moves: whether a period passes before the first sample.
        state: (6,), angles in rad, then velocities in rad/s; replaced.
        commands: (n, 3), commands so far, those that still wait and the last one, V; replaced.
        acting: (3,), voltages that act, as for `integrate_machine`; replaced.
        fingers: (2,), angle (rad) and velocity (rad/s) of the gripper; replaced.
        measured: (N + 1, 4), receives the readings of the joints and of the gripper, rad; row 0 is the sample before.
        path: (N, 3), receives the desired angles, rad.
        volts: (N, 4), receives the commands, that to the gripper last, V.
        gripped: (N,), receives whether a box is held.

    Returns:
        The number of ticks done, and FINISHED, DIVERGED or what else the controller's function returned.
    """
    ticks, first = volts.shape[0], commands.shape[0] - 1
    states, masses = np.empty((2, 6)), np.full(first + 1, payload)
    numbers, voltages = request[:_GRIPPED].view(np.float64), answer[:_GRIPPED].view(np.float64)
    requested, answered = request.ctypes.data, answer.ctypes.data
    held = answer[_GRIPPED]
    inertia, damping, torque, closed, opened = jaw[0], jaw[1], jaw[2], jaw[3], jaw[4]
    slowed = math.exp(-PERIOD * damping / inertia)
    for k in range(ticks):
        if moves or k:
            states[0] = state
            if not integrate_machine(p, commands, masses, PERIOD, SUBSTEP, WIDTH, first, acting, states):
                return k, DIVERGED
            state[:] = states[1]
            fastest = torque * voltages[3] / damping
            swing = fingers[1] - fastest
            angle = fingers[0] + fastest * PERIOD + swing * inertia / damping * (1.0 - slowed)
            fingers[0], fingers[1] = min(max(angle, closed), opened), fastest + swing * slowed
            if fingers[0] != angle:
                fingers[1] = 0.0
        for i in range(3):
            reading = state[i] + p[_SIN + i] * math.sin(state[i]) + p[_COS + i] * math.cos(state[i]) + noise[k, i]
            if resolution[1] > 0.0:
                reading = resolution[1] * math.floor(reading / resolution[1] + 0.5)
            measured[k + 1, i] = numbers[i] = measured[k, i] if lost[k] else reading
        measured[k + 1, 3] = numbers[3] = fingers[0]
        problem = exchange(function, unit, requested, answered)
        if problem != FINISHED:
            return k, problem
        commands[:-1] = commands[1:]
        for i in range(3):
            path[k, i] = memory[watched[i]]
            sent = voltages[i]
            if resolution[0] > 0.0:
                sent = resolution[0] * math.floor(sent / resolution[0] + 0.5)
            commands[first, i] = sent
        volts[k] = voltages
        gripped[k] = answer[_GRIPPED] != 0
        if answer[_GRIPPED] != held:
            return k + 1, FINISHED
    return ticks, FINISHED
