"""Parameters that a body can have: positive mass, positive inertia, triangle inequalities of its principal moments.

A body's parameters are possible if and only if its pseudo-inertia, a symmetric matrix of mass, first and second
moments, is positive definite (Wensing, Kim and Slotine 2018). It is written as L L^T, with the logarithms of the
diagonal of L (log-Cholesky, Rucker and Wensing 2022): any ten numbers give a possible
body, and no constraint is left.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.optimize import least_squares

from dtwin.arm.chain import Array, symmetric

_TRIANGLE: Final = np.tril_indices(4)
_DIAGONAL: Final = np.flatnonzero(_TRIANGLE[0] == _TRIANGLE[1])
_LEAST: Final = 1e-6
"""Least eigenvalue of a pseudo-inertia that the search begins with, in parts of its largest."""
_FARTHEST: Final = 12.0
"""Largest change of a number of L, or of the logarithm of one of its diagonal."""
_STEP: Final = 1e-30


def pseudo_inertia(parameters: Array) -> Array:
    """Second moments, first moments and mass of ten inertial parameters, (10,): the matrix (4, 4)."""
    inertia = symmetric(parameters[4:])
    found = np.empty((4, 4))
    found[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    found[:3, 3] = found[3, :3] = parameters[1:4]
    found[3, 3] = parameters[0]
    return found


def is_possible(parameters: Array) -> bool:
    """Whether a body can have these ten parameters."""
    return bool(np.linalg.eigvalsh(pseudo_inertia(parameters)).min() > 0.0)


def to_body(logs: Array) -> Array:
    """The ten parameters of numbers (..., 10): entries of L row by row, those of its diagonal as logarithms."""
    entries = logs.astype(np.result_type(logs, float), copy=True)
    entries[..., _DIAGONAL] = np.exp(entries[..., _DIAGONAL])
    factor = np.zeros((*logs.shape[:-1], 4, 4), entries.dtype)
    factor[..., _TRIANGLE[0], _TRIANGLE[1]] = entries
    p = factor @ np.swapaxes(factor, -1, -2)
    inertia = np.trace(p[..., :3, :3], axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - p[..., :3, :3]
    six = inertia[..., *np.tril_indices(3)]
    return np.concatenate([p[..., 3, 3, None], p[..., :3, 3], six], axis=-1)


def from_body(parameters: Array) -> Array:
    """The numbers (10,) of ten parameters; the nearest possible ones where a body cannot have these."""
    values, vectors = np.linalg.eigh(pseudo_inertia(parameters))
    least = _LEAST * max(float(values.max()), 1e-9)
    factor = np.linalg.cholesky(vectors * np.maximum(values, least) @ vectors.T)
    entries = factor[_TRIANGLE]
    entries[_DIAGONAL] = np.log(entries[_DIAGONAL])
    return entries


def nearest_possible(estimate: Array, precision: Array, start: Array) -> Array:
    """The possible bodies whose parameters are nearest to an estimate, in the metric of its precision.

    Args:
        estimate: ten parameters of each of k bodies, (10 k,).
        precision: inverse of their covariance, (10 k, 10 k).
        start: parameters to begin at, (10 k,), such as those of the data sheet.

    Returns:
        (10 k,); the estimate itself where it is possible already.
    """
    bodies = estimate.reshape(-1, 10)
    if all(is_possible(body) for body in bodies):
        return estimate
    values, vectors = np.linalg.eigh(precision)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T

    def residual(logs: Array) -> Array:
        away: Array = root @ (to_body(logs.reshape(-1, 10)).ravel() - estimate)
        return away

    def slope(logs: Array) -> Array:
        rows = logs.reshape(-1, 10)
        found = np.zeros((len(estimate), len(estimate)))
        for k, unit in enumerate(np.eye(10)):
            change = to_body(rows + 1j * _STEP * unit).imag / _STEP
            for body in range(len(rows)):
                found[10 * body : 10 * body + 10, 10 * body + k] = change[body]
        return root @ found

    begin = np.concatenate([from_body(body) for body in start.reshape(-1, 10)])
    room = (begin - _FARTHEST, begin + _FARTHEST)
    found = least_squares(residual, begin, jac=slope, bounds=room, x_scale="jac", max_nfev=200)
    return to_body(found.x.reshape(-1, 10)).ravel()
