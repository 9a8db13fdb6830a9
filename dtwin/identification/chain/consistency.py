"""Parameters that a body can have: positive mass, positive inertia, triangle inequalities of its principal moments.

A body's parameters are possible if and only if its pseudo-inertia, a symmetric matrix of mass, first and second
moments, is positive definite (Wensing, Kim and Slotine 2018). The matrix is linear in the parameters, so that the
nearest possible bodies are the solution of a convex problem, which an interior-point method finds: Newton's steps,
with the logarithms of the determinants as barrier (Boyd and Vandenberghe 2004, 11.3).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Array, symmetric

_LEAST: Final = 1e-6
"""Least eigenvalue of a pseudo-inertia that the search begins with, in parts of its largest."""
_BARRIERS: Final = 10.0 ** np.arange(6.0, -4.0, -1.0)
"""Weights of the barrier, one after the other; the last one costs less than a tenth of a deviation."""
_STEPS: Final = 50
"""Newton's steps for one weight, at most."""
_CENTRED: Final = 1e-6
"""Newton's decrement, squared, that ends the steps for one weight."""


def pseudo_inertia(parameters: Array) -> Array:
    """Second moments, first moments and mass of ten inertial parameters, (..., 10): matrices (..., 4, 4)."""
    return np.einsum("...p,pab->...ab", parameters, _BASIS)


def _unit(parameters: Array) -> Array:
    inertia = symmetric(parameters[4:])
    found = np.empty((4, 4))
    found[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    found[:3, 3] = found[3, :3] = parameters[1:4]
    found[3, 3] = parameters[0]
    return found


_BASIS: Final = np.stack([_unit(unit) for unit in np.eye(10)])


def is_possible(parameters: Array) -> bool:
    """Whether a body can have these ten parameters."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(parameters)).min() > 0.0)


def body_of(matrix: Array) -> Array:
    """The ten parameters of a pseudo-inertia (4, 4)."""
    second = matrix[:3, :3]
    inertia = np.trace(second) * np.eye(3) - second
    return np.array([matrix[3, 3], *matrix[3, :3], *inertia[np.tril_indices(3)]])


def mended(parameters: Array) -> Array:
    """Ten parameters that a body can have, near these: eigenvalues that are too small are raised."""
    values, vectors = np.linalg.eigh(pseudo_inertia(parameters))
    least = _LEAST * max(float(values.max()), 1e-9)
    return body_of(vectors * np.maximum(values, least) @ vectors.T)


def nearest_possible(estimate: Array, precision: Array, start: Array) -> Array:
    """The possible bodies whose parameters are nearest to an estimate, in the metric of its precision.

    Args:
        estimate: ten parameters of each of k bodies, (10 k,).
        precision: inverse of their covariance, (10 k, 10 k).
        start: parameters to begin at, (10 k,), such as those of the data sheet.

    Returns:
        (10 k,); the estimate itself where it is possible already.
    """
    if all(is_possible(body) for body in estimate.reshape(-1, 10)):
        return estimate
    found = np.concatenate([mended(body) for body in start.reshape(-1, 10)])
    for weight in _BARRIERS:
        for _ in range(_STEPS):
            step, decrement = _newton(found, estimate, precision, float(weight))
            found = found + _length(found, step) * step
            if decrement < _CENTRED:
                break
    return found


def _newton(found: Array, estimate: Array, precision: Array, weight: float) -> tuple[Array, float]:
    """Newton's step of half the squared distance less the weighted barrier, and its decrement squared."""
    inverse = np.linalg.inv(pseudo_inertia(found.reshape(-1, 10)))
    along = inverse[:, None] @ _BASIS
    slope = precision @ (found - estimate) - weight * np.einsum("bpii->bp", along).ravel()
    curvature = precision.copy()
    for body, mine in enumerate(along):
        place = slice(10 * body, 10 * body + 10)
        curvature[place, place] += weight * np.einsum("pij,qji->pq", mine, mine)
    scale = 1.0 / np.sqrt(np.diag(curvature))
    step = -scale * np.linalg.solve(curvature * scale * scale[:, None], scale * slope)
    return step, float(-slope @ step) / weight


def _length(found: Array, step: Array) -> float:
    """The whole step, or nine tenths of the way to where a body would be impossible."""
    matrices, changes = pseudo_inertia(found.reshape(-1, 10)), pseudo_inertia(step.reshape(-1, 10))
    factors = np.linalg.inv(np.linalg.cholesky(matrices))
    least = float(np.linalg.eigvalsh(factors @ changes @ np.swapaxes(factors, 1, 2)).min())
    return 1.0 if least > -0.9 else -0.9 / least
