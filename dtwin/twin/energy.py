"""The energy of the arm."""

from __future__ import annotations

import math

from dtwin.twin import dynamics
from dtwin.twin.compiled import kernel
from dtwin.twin.dynamics import Array, coefficients, mass_matrix


@kernel(uses=(dynamics,))
def energy(state: Array, p: Array, payload: float = 0.0, weight_only: bool = False) -> tuple[float, float]:
    """Kinetic and potential energy, J; the potential energy is zero with the arm stretched out horizontally.

    Args:
        as of the kernels of `dtwin.twin.dynamics`.
    """
    arm = coefficients(p, payload, weight_only)
    M = mass_matrix(state[:3], p, payload, weight_only)
    kinetic = 0.0
    for i in range(3):
        for j in range(3):
            kinetic += 0.5 * M[i, j] * state[3 + i] * state[3 + j]
    q1, q12, q123 = state[0], state[0] + state[1], state[0] + state[1] + state[2]
    return kinetic, arm.G1 * math.sin(q1) + arm.G2 * math.sin(q12) + arm.G3 * math.sin(q123)
