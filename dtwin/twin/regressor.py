"""The equations of motion as a linear form: motor torque = Y(q, q', q'') @ base parameters, lengths known.

The nine masses, inertias and centres of mass act only through the moments z_i, J_i of `dtwin.twin.dynamics`, so
these six and the friction coefficients are the minimal set: over random motions Y has full column rank (Gautier
and Khalil, Direct calculation of minimum set of inertial parameters of serial robots, 1990).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from dtwin.parameters import COULOMB_WIDTH, GRAVITY, ArmParameters, JointVector
from dtwin.twin.dynamics import Array

BASE_NAMES: Final = ("J1", "J2", "J3", "z1", "z2", "z3", "D1", "D2", "D3", "mu1", "mu2", "mu3")
"""Names of the columns of `regressor`: J in kg m^2, z in kg m, D in N m s/rad, mu in N m."""


def base_parameters(parameters: ArmParameters, payload: float = 0.0) -> Array:
    """Values of the base parameters in the order of BASE_NAMES, (12,), SI units.

    The payload (kg) counts as a point mass at the tip.
    """
    m, c, l = parameters.mass, parameters.com, parameters.length
    beyond = (m[1] + m[2] + payload, m[2] + payload, payload)
    moments = [m[i] * c[i] + beyond[i] * l[i] for i in range(3)]
    second = [parameters.inertia[i] + m[i] * c[i] ** 2 + beyond[i] * l[i] ** 2 for i in range(3)]
    return np.array([*second, *moments, *parameters.damping, *parameters.coulomb])


def regressor(
    theta: ArrayLike, omega: ArrayLike, alpha: ArrayLike, length: JointVector, coulomb_width: float = COULOMB_WIDTH
) -> Array:
    """The regressor Y, with motor torque = Y @ base_parameters.

    Args:
        theta: (..., 3), joint angles, rad.
        omega: (..., 3), joint velocities, rad/s.
        alpha: (..., 3), joint accelerations, rad/s^2.
        length: lengths l1, l2, l3, m; l3 acts only through the payload's share of the base parameters.
        coulomb_width: velocity over which Coulomb friction changes sign, rad/s.

    Returns:
        Y of shape (..., 3, 12): one row per joint, one column per name of BASE_NAMES.
    """
    q, w, a = (np.asarray(values, dtype=np.float64) for values in (theta, omega, alpha))
    l1, l2, _ = length
    absolute = np.cumsum(q, axis=-1)
    weight = GRAVITY * np.cos(absolute)
    w_sum, a_sum = np.cumsum(w, axis=-1), np.cumsum(a, axis=-1)
    Y = np.zeros((*q.shape[:-1], 3, len(BASE_NAMES)))
    for link in range(3):
        Y[..., : link + 1, link] = a_sum[..., link, None]
        Y[..., : link + 1, 3 + link] = weight[..., link, None]
        Y[..., link, 6 + link] = w[..., link]
        Y[..., link, 9 + link] = np.tanh(w[..., link] / coulomb_width)
    # Link i hangs from the end of link j < i: z_i l_j couples their absolute accelerations.
    for i, j, l in ((1, 0, l1), (2, 0, l1), (2, 1, l2)):
        difference = absolute[..., i] - absolute[..., j]
        cos, sin = l * np.cos(difference), l * np.sin(difference)
        of_link = cos * a_sum[..., j] + sin * w_sum[..., j] ** 2
        of_carrier = cos * a_sum[..., i] - sin * w_sum[..., i] ** 2
        Y[..., : i + 1, 3 + i] += of_link[..., None]
        Y[..., : j + 1, 3 + i] += of_carrier[..., None]
    return Y
