"""The sampled linear loop of function blocks and arm where the arm rests.

The blocks are differentiated as a black box: their variables and the angles are moved a little, one tick runs, and
the differences of variables and voltages are the columns of their state-space matrices. The arm is linearised about
the pose, where gravity is held by the motors, and sampled exactly with its voltages held from tick to tick, also when
they act a part of a tick late (Franklin, Powell and Workman, Digital Control of Dynamic Systems, ch. 4.3). Coulomb
friction is left out, because it would hide a slow instability.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from dtwin.controller.motion import ARM, MotionController
from dtwin.controller.ports import MEMORY
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import PERIOD, ArmParameters, JointVector
from dtwin.simulation.figures import Array
from dtwin.twin.closed_loop import TickResponses
from dtwin.twin.effects import NO_EFFECTS, Effects
from dtwin.twin.machine import machine_acceleration, vector_of
from iec61499.native.resource import NativeResource

_STEP: Final = 1e-5
"""Step of the difference quotients in the unit of the variable.

Their truncation error is of the order of its square, their rounding error of 1e-16 divided by it.
"""
_IDLE: Final = 1e-6
"""Change of a variable, by the change of another or of an angle, below which it counts as none."""
_MEMORY: Final = tuple(name for names in MEMORY for name in names)
ComplexArray = NDArray[np.complexfloating]


class StateSpace(NamedTuple):
    """A sampled linear system x[k+1] = A x[k] + B u[k], y[k] = C x[k] + D u[k] (n states, m inputs, p outputs).

    Attributes:
        A: (n, n), from the states to the next ones.
        B: (n, m), from the inputs to the next states.
        C: (p, n), from the states to the outputs.
        D: (p, m), from the inputs to the outputs.
    """

    A: Array
    B: Array
    C: Array
    D: Array

    def response(self, z: ComplexArray) -> ComplexArray:
        """Frequency responses C (z - A)^-1 B + D at points of the unit circle, (N, p, m)."""
        resolvent = z[:, None, None] * np.eye(len(self.A)) - self.A
        return np.asarray(self.C @ np.linalg.solve(resolvent, self.B[None]) + self.D, dtype=np.complex128)


@dataclass(frozen=True, slots=True, eq=False)
class Plant:
    """The arm near a pose: x' = A x + B V with x = (theta, omega).

    Attributes:
        A: (6, 6), per second.
        B: (6, 3), by volts.
    """

    A: Array
    B: Array

    def sampled(self, delay: float = 0.0) -> StateSpace:
        """The arm from volts to angles over one tick, with the volts held and acting late by a number of ticks."""
        return _sampled(self, delay)


@lru_cache(maxsize=512)
def _sampled(plant: Plant, delay: float) -> StateSpace:
    whole = math.floor(delay)
    late = (delay - whole) * PERIOD
    state, full = _held(plant.A, plant.B, PERIOD)
    new = _held(plant.A, plant.B, PERIOD - late)[1]
    # The volts of `whole` ticks ago act at the end of the tick, those of one tick more at its beginning.
    past = whole + 1
    A = np.zeros((6 + 3 * past, 6 + 3 * past))
    B = np.zeros((6 + 3 * past, 3))
    A[:6, :6] = state
    A[:6, 3 + 3 * past :] = full - new
    if whole:
        A[:6, 3 + 3 * whole : 6 + 3 * whole] += new
    else:
        B[:6] = new
    B[6:9] = np.eye(3)
    A[9:, 6:-3] = np.eye(3 * whole)
    C = np.zeros((3, len(A)))
    C[:, :3] = np.eye(3)
    return StateSpace(*map(_unchanging, (A, B, C, np.zeros((3, 3)))))


@dataclass(frozen=True, slots=True, eq=False)
class Loop:
    """A plant under a controller.

    Attributes:
        controller: controller from angles (rad) to volts.
        plant: arm near the pose at which it rests.
        late: ticks after which the volts act.
    """

    controller: StateSpace
    plant: Plant
    late: float = 0.0

    def closed(self, delay: float = 0.0) -> Array:
        """The matrix of one tick of the closed loop, with the volts acting later by a number of ticks."""
        plant, control = self.plant.sampled(self.late + delay), self.controller
        count = len(plant.A)
        size = count + len(control.A)
        matrix = np.empty((size, size))
        matrix[:count, :count] = plant.A + plant.B @ control.D @ plant.C
        matrix[:count, count:] = plant.B @ control.C
        matrix[count:, :count] = control.B @ plant.C
        matrix[count:, count:] = control.A
        return matrix

    def radius(self, delay: float = 0.0) -> float:
        """Largest absolute eigenvalue of one tick; the loop is stable below 1."""
        return float(np.abs(np.linalg.eigvals(self.closed(delay))).max())

    def returned(self, z: ComplexArray) -> ComplexArray:
        """Return ratio L = -K P at the voltages of the motors, (N, 3, 3), at points of the unit circle."""
        ratio: ComplexArray = -self.controller.response(z) @ self.plant.sampled(self.late).response(z)
        return ratio


def lateness(effects: Effects) -> float:
    """Time after which an arm with effects obeys a command, ticks; a lag delays by its time constant at most."""
    return (effects.delay + max(effects.lag)) / PERIOD


def later(effects: Effects, late: float) -> Effects:
    """The effects of an arm whose commands act some ticks later than they did."""
    return replace(effects, delay=effects.delay + late * PERIOD)


def linear_loop(
    controller: MotionController,
    settings: ControlSettings,
    arm: ArmParameters,
    payload: float,
    theta: JointVector,
    late: float = 0.0,
    effects: Effects = NO_EFFECTS,
) -> Loop:
    """The loop of the function blocks and an arm at rest.

    Args:
        controller: controller whose blocks are used; its current motion ends.
        settings: settings of the blocks.
        arm: arm that is controlled.
        payload: mass of the held box, kg.
        theta: angles at which the arm rests, rad.
        late: ticks after which the arm obeys a command.
        effects: what the arm has beside its parameters; lag and delay count only in `late`, dry friction, dead zone
            and sag not at all.
    """
    blocks = linear_blocks(controller, settings, theta, carries=payload > 0)
    return Loop(blocks, linear_arm(arm, payload, theta, effects), late)


@lru_cache(maxsize=64)
def linear_arm(arm: ArmParameters, payload: float, theta: JointVector, effects: Effects = NO_EFFECTS) -> Plant:
    """The arm near the pose theta (rad), with a box of mass payload (kg) in its gripper; it may have effects."""
    vector = vector_of(arm, effects)

    def accelerations(points: Array) -> Array:
        return np.array([machine_acceleration(vector, point[:6], point[6:], payload) for point in points])

    rest = np.concatenate((theta, np.zeros(3)))
    falling = machine_acceleration(vector, rest, np.zeros(3), payload)
    by_volt = [machine_acceleration(vector, rest, volts, payload) - falling for volts in np.eye(3)]
    hold = -np.linalg.solve(np.column_stack(by_volt), falling)
    slopes = _differences(accelerations, np.concatenate((theta, np.zeros(3), hold)))
    A = np.vstack((np.eye(3, 6, 3), slopes[:, :6]))
    return Plant(_unchanging(A), _unchanging(np.vstack((np.zeros((3, 3)), slopes[:, 6:]))))


def linear_blocks(
    controller: MotionController, settings: ControlSettings, theta: JointVector, *, carries: bool
) -> StateSpace:
    """The function blocks near rest at theta (rad), from angles to volts; the states are the variables MEMORY.

    Variables that stay as they are, whatever is measured, are left out: what another law remembers, and integrals
    that no gain feeds.
    """
    controller.start(theta, theta, settings, carries=carries)
    resource = controller.resource
    if isinstance(resource, NativeResource):
        machine_code = _in_machine_code(resource)
        at_rest = machine_code.values()
        slopes = _differences(partial(machine_code.after, carries), np.array((*at_rest, *theta)))
    else:
        at_rest = np.array([resource.read(name) for name in _MEMORY])
        slopes = _differences(partial(_after, controller), np.array((*at_rest, *theta)))
    count = len(_MEMORY)
    live = np.flatnonzero(np.abs(slopes[:count] - np.eye(count, count + 3)).max(axis=1) > _IDLE)
    from_states, from_angles = slopes[:, live], slopes[:, count:]
    return StateSpace(from_states[live], from_angles[live], from_states[count:], from_angles[count:])


def _held(A: Array, B: Array, time: float) -> tuple[Array, Array]:
    """State and input matrices over a time (s) with the input held."""
    size, inputs = B.shape
    block = np.zeros((size + inputs, size + inputs))
    block[:size] = np.hstack((A, B))
    both = expm(block * time)
    return both[:size, :size], both[:size, size:]


@lru_cache(maxsize=8)
def _in_machine_code(resource: NativeResource) -> TickResponses:
    return TickResponses(resource, ARM, _MEMORY)


def _after(controller: MotionController, points: Array) -> Array:
    """What `TickResponses.after` gives, by the Python runtime."""
    resource = controller.resource
    rest = resource.snapshot()
    found = []
    for *values, first, second, third in points.tolist():
        resource.restore(rest)
        for name, value in zip(_MEMORY, values, strict=True):
            resource.write(name, value)
        volts = controller.step((first, second, third))
        found.append((*map(resource.read, _MEMORY), *volts))
    resource.restore(rest)
    return np.array(found)


def _unchanging(matrix: Array) -> Array:
    """A matrix that nobody can change, because many share it."""
    matrix.setflags(write=False)
    return matrix


def _differences(function: Callable[[Array], Array], point: Array) -> Array:
    """Jacobian at a point by central differences, of a function that takes and gives a row for every point."""
    offsets = _STEP * np.eye(len(point))
    found = function(np.concatenate((point + offsets, point - offsets)))
    jacobian: Array = (found[: len(point)] - found[len(point) :]).T / (2.0 * _STEP)
    return jacobian
