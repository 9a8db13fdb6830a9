"""How sure an estimate is when residuals are not white: the sandwich of their correlation in time.

Least squares alone would divide the noise by the number of rows. Residuals of a robot are friction that no term has
and last for seconds; they count by their autocorrelation (Newey and West 1987, here with the measured correlation
of each joint as that of a stationary process).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.arm.chain import Array
from dtwin.identification.chain.design import Design
from dtwin.identification.chain.fit import Fit, Prior, precision_of
from dtwin.identification.chain.moments import Moments, columns

_NOTHING: Final = 1e-13
"""Eigenvalue, in parts of the largest one, that rounding makes of 0."""
_LONGEST: Final = 3.0
"""Longest correlation in time that is looked at, s."""


def covariance_of(design: Design, moments: Moments, prior: Prior, found: Fit) -> tuple[Array, Array]:
    """Covariance of the unknowns that were used and of the logarithms of all gains, (used + n, used + n).

    And the part of it that is what bodies were guessed to be at most, of the same shape.
    """
    layout, share = moments.layout, moments.share
    chosen = np.flatnonzero(found.used)
    n, size = layout.joints, len(chosen)
    known = precision_of(prior, chosen)
    every = [columns(layout, rows) / found.gain[:, None] for rows in design.rows]
    predicted = [mine @ found.unknowns for mine in every]
    longest = longest_of(design)
    bread, meat = known.copy(), known.copy()
    for joint in range(n):
        weight = share / found.noise[joint] ** 2
        pairs = zip(design.rows, predicted, strict=True)
        correlation = correlation_of([rows.effort[:, joint] - told[:, joint] for rows, told in pairs], longest)
        places = layout.of_joint(joint)
        places = places[found.used[places]]  # the other unknowns do not act on this joint
        at = np.append(np.searchsorted(chosen, places), size + joint)
        for part, told in zip(every, predicted, strict=True):
            mine = np.concatenate([-part[:, joint, places], told[:, joint, None]], axis=1)
            bread[at[:, None], at] += weight * mine.T @ mine
            meat[at[:, None], at] += weight**2 * mine.T @ convolved(correlation, mine)
    effective = share * float(moments.counts.sum()) * n
    lost = effective / max(effective - size, 0.25 * effective)
    outer = inverse(bread)
    found_covariance: Array = outer @ (known + lost * (meat - known)) @ outer
    links = int(np.searchsorted(chosen, 10 * n))
    guessed: Array = outer[:, :links] @ known[:links, :links] @ outer[:, :links].T
    return found_covariance, guessed


def longest_of(design: Design) -> int:
    """Rows over which residuals are taken to be correlated."""
    return max(1, round(_LONGEST / float(np.median([rows.dt for rows in design.rows]))))


def correlation_of(residuals: list[Array], longest: int) -> Array:
    """Autocovariance of a joint's residual for lags 0 to longest, tapered so that it stays positive (Bartlett)."""
    total: Array = np.zeros(longest + 1)
    count = 0
    for residual in residuals:
        r = residual - residual.mean()
        padded = np.fft.rfft(r, 2 * len(r))
        lags = np.fft.irfft(padded * padded.conj())[: longest + 1]
        total[: len(lags)] += lags
        count += len(r)
    taper = 1.0 - np.arange(longest + 1) / (longest + 1)
    return np.asarray(total * taper / count, dtype=np.float64)


def convolved(correlation: Array, columns: Array) -> Array:
    """The matrix of covariances in time, a Toeplitz matrix, times columns (N, k)."""
    samples, longest = len(columns), min(len(correlation), len(columns)) - 1
    length = samples + longest
    kernel = np.zeros(length)
    kernel[: longest + 1] = correlation[: longest + 1]
    kernel[-longest:] += correlation[longest:0:-1] if longest else 0.0
    spectrum = np.fft.rfft(kernel)
    result: Array = np.fft.irfft(np.fft.rfft(columns, length, axis=0) * spectrum[:, None], length, axis=0)[:samples]
    return result


def inverse(matrix: Array) -> Array:
    """The inverse of a covariance or of a precision, whose unknowns may have units far apart.

    What rounding leaves of nothing, also below 0, counts as the least value that is told from nothing.
    """
    scale = 1.0 / np.sqrt(np.diag(matrix))
    values, vectors = np.linalg.eigh(matrix * scale * scale[:, None])
    found: Array = (vectors / np.maximum(values, _NOTHING * values[-1])) @ vectors.T
    return found * scale * scale[:, None]
