"""The twin with its effects at work in a cell, in machine code: tick by tick until the gripper is told otherwise.

What comes and goes at the gripper is the caller's: between two calls it changes the payload and what the box sensor
says. Beside `dtwin.twin.machine` there are amplifiers of finite resolution, encoders with noise and resolution, and
samples that are lost.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.parameters import PERIOD
from dtwin.twin import closed_loop, dry_friction, dynamics, lanes, machine
from dtwin.twin.closed_loop import FINISHED, Blocks, exchange
from dtwin.twin.compiled import kernel
from dtwin.twin.machine import MACHINE_NAMES, SUBSTEP, Array, integrate_machine

DIVERGED: Final = -1
_SIN: Final = MACHINE_NAMES.index("eccentric_sin1")
_COS: Final = MACHINE_NAMES.index("eccentric_cos1")
_GRIPPED: Final = 32
"""Place of the flag in an answer, behind four voltages."""


class Device(NamedTuple):
    """The machine of a cell.

    Attributes:
        p: (78,), see MACHINE_NAMES.
        resolution: (2,), of the amplifiers, V, and of the encoders, rad; 0 for an infinite one.
        jaw: (5,), of the gripper: inertia (kg m^2), damping (N m s/rad), torque per volt (N m/V), and the angles
            between which it moves (rad).
    """

    p: Array
    resolution: Array
    jaw: Array


class State(NamedTuple):
    """What a cell is at a time; it changes in place.

    Attributes:
        arm: (6,), angles in rad, then velocities in rad/s.
        commands: (n, 3), commands so far, those that still wait and the last one, V.
        acting: (3,), voltages that act, as for `integrate_machine`.
        fingers: (2,), angle (rad) and velocity (rad/s) of the gripper.
    """

    arm: Array
    commands: Array
    acting: Array
    fingers: Array


class Disturbed(NamedTuple):
    """What disturbs N samples.

    Attributes:
        noise: (N, 3), what the encoders add, rad.
        lost: (N,), at which ticks the last sample is sent again.
    """

    noise: Array
    lost: NDArray[np.bool_]


class Course(NamedTuple):
    """What becomes of N ticks.

    Attributes:
        measured: (N + 1, 4), readings of the joints and of the gripper, rad; row 0 is the sample before.
        path: (N, 3), desired angles, rad.
        volts: (N, 4), commands, that to the gripper last, V.
        gripped: (N,), whether a box is held.
    """

    measured: Array
    path: Array
    volts: Array
    gripped: NDArray[np.bool_]


@kernel(inlined=True)
def _turn_fingers(fingers: Array, volts: float, jaw: Array, slowed: float) -> None:
    """Turns the gripper for a period; `slowed` is the share that is left of a velocity then."""
    inertia, damping, torque, closed, opened = jaw[0], jaw[1], jaw[2], jaw[3], jaw[4]
    fastest = torque * volts / damping
    swing = fingers[1] - fastest
    angle = fingers[0] + fastest * PERIOD + swing * inertia / damping * (1.0 - slowed)
    fingers[0], fingers[1] = min(max(angle, closed), opened), fastest + swing * slowed
    if fingers[0] != angle:
        fingers[1] = 0.0


@kernel(inlined=True)
def _rounded(value: float, resolution: float) -> float:
    """A value as it is told with a resolution, 0 for an infinite one."""
    return resolution * math.floor(value / resolution + 0.5) if resolution > 0.0 else value


@kernel(nogil=True, uses=(closed_loop, dry_friction, dynamics, lanes, machine))
def work(
    b: Blocks, device: Device, payload: float, disturbed: Disturbed, moves: bool, state: State, course: Course
) -> tuple[int, int]:
    """Lets a controller move the arm until it grips or lets go: a period, then a sample and its answer, N at most.

    Args:
        b: the controller; it is told angles of the joints and of the gripper, and answers with four voltages and
            whether a box is held. `places` are those of the desired angles, rad.
        device: the machine.
        payload: point mass at the tip, kg.
        disturbed: what disturbs the samples.
        moves: whether a period passes before the first sample.
        state: of the cell.
        course: receives what becomes of the ticks.

    Returns:
        The number of ticks done, and FINISHED, DIVERGED or what else the controller's function returned.
    """
    (p, resolution, jaw), (arm, commands, acting, fingers) = device, state
    (noise, lost), (measured, path, volts, gripped) = disturbed, course
    function, unit, request, answer, memory, places = b
    ticks, first = volts.shape[0], commands.shape[0] - 1
    states, masses = np.empty((2, 6)), np.full(first + 1, payload)
    numbers, voltages = request[:_GRIPPED].view(np.float64), answer[:_GRIPPED].view(np.float64)
    requested, answered = request.ctypes.data, answer.ctypes.data
    held, slowed = answer[_GRIPPED], math.exp(-PERIOD * jaw[1] / jaw[0])
    for k in range(ticks):
        if moves or k:
            states[0] = arm
            if not integrate_machine(p, commands, masses, PERIOD, SUBSTEP, first, acting, states):
                return k, DIVERGED
            arm[:] = states[1]
            _turn_fingers(fingers, voltages[3], jaw, slowed)
        for i in range(3):
            angle = arm[i]
            reading = angle + p[_SIN + i] * math.sin(angle) + p[_COS + i] * math.cos(angle) + noise[k, i]
            reading = _rounded(reading, resolution[1])
            measured[k + 1, i] = numbers[i] = measured[k, i] if lost[k] else reading
        measured[k + 1, 3] = numbers[3] = fingers[0]
        problem = exchange(function, unit, requested, answered)
        if problem != FINISHED:
            return k, problem
        commands[:-1] = commands[1:]
        for i in range(3):
            path[k, i] = memory[places[i]]
            commands[first, i] = _rounded(voltages[i], resolution[0])
        volts[k] = voltages
        gripped[k] = answer[_GRIPPED] != 0
        if answer[_GRIPPED] != held:
            return k + 1, FINISHED
    return ticks, FINISHED
