"""Stability of the closed loop of function blocks and arm where the arm rests, by the eigenvalues of one tick.

The state between two ticks consists of theta and omega of the arm and, in the controller block, of the two samples
before and the sums of the errors. One tick of the real blocks and of the twin maps this state to the next one. The
map, linearised about rest, is stable when all its eigenvalues lie inside the unit circle (Franklin, Powell and
Workman, Digital Control of Dynamic Systems, ch. 4). Coulomb friction is left out, because it would hide a slow
instability.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from dtwin.controller.motion import MotionController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import COULOMB_WIDTH, PERIOD, ArmParameters, Triple, scaled
from dtwin.simulation.figures import Array
from dtwin.simulation.whatif import SUBSTEPS
from dtwin.twin.dynamics import gravity, integrate

_STEP: Final = 1e-5
"""Step of the difference quotients in rad, rad/s, rad s or V.

Their truncation error is of the order of its square, their rounding error of 1e-16 divided by it.
"""
_MEMORY: Final = ("Y1", "Y2", "SUM")
_JOINTS: Final = (1, 2, 3)


def spectral_radius(
    controller: MotionController, settings: ControlSettings, arm: ArmParameters, payload: float, theta: Triple
) -> float:
    """Largest absolute eigenvalue of one tick of the closed loop at rest; the loop is stable below 1.

    Error sums that no gain uses are left out: they grow without an effect.

    Args:
        controller: controller whose blocks are used; its current motion ends.
        settings: settings of the blocks.
        arm: arm that is controlled.
        payload: mass of the held box, kg.
        theta: angles at which the arm rests, rad.
    """
    plant = _plant(arm, payload, theta)
    sums, law = _law(controller, settings, payload, theta)
    # States: theta, omega, y[k-1], y[k-2], sum[k-1]; the law sees theta, y[k-1], y[k-2] and the sums.
    seen = np.zeros((12, 15))
    for block, column in enumerate((0, 6, 9, 12)):
        seen[3 * block : 3 * block + 3, column : column + 3] = np.eye(3)
    tick = np.zeros((15, 15))
    tick[:6, :6] = plant[:, :6]
    tick[:6] += plant[:, 6:] @ law @ seen
    tick[6:9, 0:3] = np.eye(3)
    tick[9:12, 6:9] = np.eye(3)
    tick[12:15] = sums @ seen
    used = [*range(12), *(12 + joint for joint, gain in enumerate(settings.gains.ki) if gain > 0)]
    return float(np.abs(np.linalg.eigvals(tick[np.ix_(used, used)])).max())


def _plant(arm: ArmParameters, payload: float, theta: Triple) -> Array:
    """Derivatives (6, 9) of the arm's state after a tick by theta, omega and volts."""
    vector = np.array(scaled(arm, "mu", 0.0).vector())
    load = np.array([payload])
    hold = gravity(np.array(theta), vector, payload, False) / np.array(arm.voltage_constant)

    def tick(point: Array) -> Array:
        states = np.empty((2, 6))
        states[0] = point[:6]
        integrate(vector, point[None, 6:], load, PERIOD, SUBSTEPS, False, COULOMB_WIDTH, states)
        return states[1]

    return _differences(tick, np.concatenate((theta, np.zeros(3), hold)))


def _law(
    controller: MotionController, settings: ControlSettings, payload: float, theta: Triple
) -> tuple[Array, Array]:
    """Derivatives of the next error sums and of the volts by theta, y[k-1], y[k-2] and error sums, each (3, 12)."""
    controller.begin(theta, theta, settings, carries=payload > 0)
    resource = controller.resource
    rest = resource.snapshot()
    rows = [f"CONTROLLER.SUM{joint}" for joint in _JOINTS]
    memory = [f"CONTROLLER.{name}{joint}" for name in _MEMORY for joint in _JOINTS]

    def tick(point: Array) -> Array:
        resource.restore(rest)
        for name, value in zip(memory, point[3:].tolist(), strict=True):
            resource.write(name, value)
        first, second, third = point[:3].tolist()
        volts = controller.step((first, second, third))
        return np.array((*(resource.read(name) for name in rows), *volts))

    slopes = _differences(tick, np.concatenate((theta, theta, theta, np.zeros(3))))
    return slopes[:3], slopes[3:]


def _differences(function: Callable[[Array], Array], point: Array) -> Array:
    """Jacobian of a function at a point by central differences."""
    columns = []
    for k in range(len(point)):
        offset = np.zeros(len(point))
        offset[k] = _STEP
        columns.append((function(point + offset) - function(point - offset)) / (2.0 * _STEP))
    return np.column_stack(columns)
