"""Analysis of residuals: the whiteness test, the shape of the noise, and the fit of a prediction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import chdtrc, gammaln

from dtwin.identification.data import Array

LAGS: Final = 10
SIGNIFICANCE: Final = 1e-4
"""Significance level of the whiteness test of each joint."""
NEGLIGIBLE: Final = 0.05
"""Autocorrelation below which a model is not rejected, however significant it is."""
EXACT: Final = 1e-9
"""Root mean square below which residuals are rounding errors and count as white, rad."""
_FLATTEST: Final = 6.0
"""Largest exponent of the density: larger ones gain little and depend on ever fewer residuals."""


@dataclass(frozen=True, slots=True)
class Whiteness:
    """Ljung-Box test of the residuals of each joint over LAGS lags (Ljung and Box, Biometrika 65, 1978).

    Attributes:
        p_values: probability for each joint of autocorrelations at least this large if the residuals are white.
        largest: largest absolute autocorrelation of each joint.
    """

    p_values: tuple[float, ...]
    largest: tuple[float, ...]

    @property
    def white(self) -> bool:
        """Whether no joint shows a significant autocorrelation that is not negligible."""
        pairs = zip(self.p_values, self.largest, strict=True)
        return all(p > SIGNIFICANCE or largest < NEGLIGIBLE for p, largest in pairs)


def whiteness(residuals: Sequence[Array]) -> Whiteness:
    """Tests the residuals of all experiments, each (N, 3), rad; correlations across experiments do not count."""
    count = sum(map(len, residuals))
    power = np.sum([np.sum((block - block.mean(axis=0)) ** 2, axis=0) for block in residuals], axis=0)
    if np.all(np.sqrt(power / count) < EXACT):
        return Whiteness((1.0,) * 3, (0.0,) * 3)
    lags = range(1, min(LAGS, min(map(len, residuals)) - 1) + 1)
    correlations = autocorrelations(residuals, lags)
    statistic = count * (count + 2) * np.sum(correlations**2 / (count - np.array(lags)[:, None]), axis=0)
    return Whiteness(tuple(chdtrc(len(lags), statistic).tolist()), tuple(np.abs(correlations).max(axis=0).tolist()))


def autocorrelations(residuals: Sequence[Array], lags: Sequence[int]) -> Array:
    """Autocorrelation of each joint at each lag, (L, 3), of the residuals of all experiments, each (N, 3)."""
    centred = [block - block.mean(axis=0) for block in residuals]
    power = np.sum([np.sum(block**2, axis=0) for block in centred], axis=0)
    products = [np.sum([np.sum(block[k:] * block[:-k], axis=0) for block in centred], axis=0) for k in lags]
    found: Array = np.array(products) / np.maximum(power, np.finfo(float).tiny)
    return found


def fit(measured: Array, predicted: Array) -> Array:
    """Fit 1 - ||y - yhat|| / ||y - mean(y)|| of each joint, (3,), for angles of shape (N, 3); 1 is perfect."""
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    result: Array = 1.0 - np.linalg.norm(measured - predicted, axis=0) / np.maximum(spread, np.finfo(float).tiny)
    return result


def shape(residuals: Array) -> float:
    """Exponent p of the exponential-power density exp(-|r|^p) that has the kurtosis of the residuals.

    The exponent is 2 (Gaussian noise) unless the kurtosis is significantly below that of Gaussian noise. Uniform
    noise, which has no finite exponent, gives the largest one allowed, 6 (Box and Tiao, Bayesian Inference in
    Statistical Analysis, 1973, ch. 3).
    """
    from scipy.optimize import brentq  # loaded here: takes longer than the rest of the estimator, seldom needed

    centred = residuals - residuals.mean()
    kurtosis = float(np.mean(centred**4) / np.mean(centred**2) ** 2)
    if kurtosis > 3.0 - 3.0 * math.sqrt(24.0 / residuals.size):
        return 2.0
    if kurtosis <= _kurtosis(_FLATTEST):
        return _FLATTEST
    return float(brentq(lambda p: _kurtosis(p) - kurtosis, 2.0, _FLATTEST))


def _kurtosis(p: float) -> float:
    return math.exp(gammaln(5 / p) + gammaln(1 / p) - 2 * gammaln(3 / p))
