"""Is the closed loop of blocks and arm stable where the arm rests? The eigenvalues of one tick tell.

The state between two ticks is theta and omega of the arm and, in the controller block, the two samples before and
the sums of the errors. One tick of the real blocks and of the twin maps it to the next; that map, linearised about
rest, is stable when all its eigenvalues lie inside the unit circle (Franklin, Powell and Workman, Digital Control of
Dynamic Systems, ch. 4). Coulomb friction is left out: it would hide a slow instability.
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
"""of the difference quotients, rad, rad/s, rad s or V: their error is its square, rounding is 1e-16 over it"""
_MEMORY: Final = ("Y1", "Y2", "SUM")
_JOINTS: Final = (1, 2, 3)


def spectral_radius(
    controller: MotionController, settings: ControlSettings, arm: ArmParameters, payload: float, theta: Triple
) -> float:
    """Largest absolute eigenvalue of one tick of the closed loop at rest; below 1 is stable.

    Error sums that no gain uses are not counted: they grow without an effect.

    Args:
        controller: whose blocks are used; a motion it is in is given up.
        settings: of the blocks.
        arm: that is controlled.
        payload: held, kg.
        theta: where the arm rests, rad.
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
    """(6, 9): the arm's state after a tick, by theta, omega and volts."""
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
    """(3, 12) twice: the next error sums, and the volts, by theta, y[k-1], y[k-2] and the error sums."""
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
    """Jacobian by central differences."""
    columns = []
    for k in range(len(point)):
        offset = np.zeros(len(point))
        offset[k] = _STEP
        columns.append((function(point + offset) - function(point - offset)) / (2.0 * _STEP))
    return np.column_stack(columns)
