"""How the motion of an arm with `Effects` depends on where it starts: motions side by side, each a little apart.

The equations are those of `machine`, in `lanes`, with the exp and tanh that these have: what comes out differs from
the quotients of `integrate_machine` by rounding alone.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.parameters import PERIOD
from dtwin.twin import dynamics, elementary, lanes, machine
from dtwin.twin.compiled import kernel
from dtwin.twin.lanes import memory
from dtwin.twin.machine import MACHINE_NAMES, SUBSTEP, WIDTH, Array, constants, over_sample, regime

_LANES: Final = 16
_UNDISTURBED: Final = _LANES - 1
_load, _store = memory(_LANES)
_TORQUE: Final = MACHINE_NAMES.index("torque1")


@kernel(uses=(dynamics, elementary, lanes, machine))
def linearise_machine(
    p: Array, volts: Array, payload: float, steps: Array, acting: Array, state: Array, slopes: Array
) -> None:
    """Carries a state over the last of some samples, and tells how what it comes to depends on where it started.

    Args:
        p: (78,), see MACHINE_NAMES.
        volts: (n, 3), commands up to this sample, V.
        payload: mass at the tip, kg.
        steps: (m,), steps of the difference quotients: of the state (6,), of constant torques on the joints (3,),
            N m, and of the payload, which may be left out, kg.
        acting: (3,), as for `integrate_machine`.
        state: (6,), state at the start, rad and rad/s; replaced by that at the end.
        slopes: (6, m), receives the derivatives.
    """
    rows, c = np.empty((24, _LANES)), np.empty(15)
    constants(p, payload, c)
    for i in range(6):
        rows[i] = state[i]
    for i in range(3):
        rows[6 + i] = p[_TORQUE + i]
    for i in range(15):
        rows[9 + i] = c[i]
    for i in range(9):
        rows[i, i] += steps[i]
    if len(steps) > 9:
        constants(p, payload + steps[9], c)
        rows[9:, 9] = c
    x = (_load(rows, 0), _load(rows, 1), _load(rows, 2), _load(rows, 3), _load(rows, 4), _load(rows, 5))
    torque = (_load(rows, 6), _load(rows, 7), _load(rows, 8))
    held = (
        *(_load(rows, 9), _load(rows, 10), _load(rows, 11), _load(rows, 12), _load(rows, 13), _load(rows, 14)),
        *(_load(rows, 15), _load(rows, 16), _load(rows, 17), _load(rows, 18), _load(rows, 19), _load(rows, 20)),
        *(_load(rows, 21), _load(rows, 22), _load(rows, 23)),
    )
    v, sample, has = (acting[0], acting[1], acting[2]), volts.shape[0] - 1, regime(p, PERIOD)
    x, v = over_sample(x, v, volts, sample, torque, p, held, has, PERIOD, SUBSTEP, WIDTH)
    for i, value in enumerate(x):
        _store(rows, i, value)
    for i in range(6):
        state[i] = rows[i, _UNDISTURBED]
        for m in range(len(steps)):
            slopes[i, m] = (rows[i, m] - state[i]) / steps[m]
    acting[0], acting[1], acting[2] = v
