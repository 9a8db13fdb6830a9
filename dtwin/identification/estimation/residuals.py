"""What the residuals say: noise, its shape, whether anything but noise is left, and the fit on unseen data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.optimize import brentq
from scipy.special import gammaln
from scipy.stats import chi2

from dtwin.identification.data import Array

LAGS: Final = 10
SIGNIFICANCE: Final = 1e-4
"""probability per joint that white residuals are called coloured"""
NEGLIGIBLE: Final = 0.05
"""autocorrelation that is no reason to reject a model, however many samples prove it"""
EXACT: Final = 1e-9
"""rad, root mean square below which residuals are rounding: nothing is left to explain"""
_FLATTEST: Final = 6.0
"""a larger exponent gains little and leans on ever fewer residuals"""


@dataclass(frozen=True, slots=True)
class Whiteness:
    """Ljung-Box test of the residuals of the three joints over LAGS lags (Biometrika 65, 1978).

    Attributes:
        p_values: probability of autocorrelations at least this large if the residuals are white.
        largest: autocorrelation in absolute value, a joint.
    """

    p_values: tuple[float, ...]
    largest: tuple[float, ...]

    @property
    def white(self) -> bool:
        """Whether no joint shows a significant autocorrelation that is not negligible."""
        pairs = zip(self.p_values, self.largest, strict=True)
        return all(p > SIGNIFICANCE or largest < NEGLIGIBLE for p, largest in pairs)


def whiteness(residuals: Sequence[Array]) -> Whiteness:
    """Tests residuals (N, 3) of each experiment, rad; correlations across experiments do not count."""
    centred = [block - block.mean(axis=0) for block in residuals]
    count = sum(map(len, centred))
    power = np.sum([np.sum(block**2, axis=0) for block in centred], axis=0)
    if np.all(np.sqrt(power / count) < EXACT):
        return Whiteness((1.0,) * 3, (0.0,) * 3)
    lags = range(1, min(LAGS, min(map(len, centred)) - 1) + 1)
    products = [np.sum([np.sum(block[k:] * block[:-k], axis=0) for block in centred], axis=0) for k in lags]
    correlations = np.array(products) / np.maximum(power, np.finfo(float).tiny)
    statistic = count * (count + 2) * np.sum(correlations**2 / (count - np.array(lags)[:, None]), axis=0)
    return Whiteness(tuple(chi2.sf(statistic, len(lags)).tolist()), tuple(np.abs(correlations).max(axis=0).tolist()))


def fit(measured: Array, predicted: Array) -> Array:
    """(3,): 1 - ||y - yhat|| / ||y - mean(y)||, 1 is perfect; for angles (N, 3)."""
    spread = np.linalg.norm(measured - measured.mean(axis=0), axis=0)
    result: Array = 1.0 - np.linalg.norm(measured - predicted, axis=0) / np.maximum(spread, np.finfo(float).tiny)
    return result


def shape(residuals: Array) -> float:
    """Exponent p of the exponential-power density exp(-|r|^p) with the residuals' kurtosis.

    2 is Gaussian, and the answer unless a test tells the noise to be flatter; uniform noise has no finite p and gives
    the largest allowed, 6 (Box and Tiao, Bayesian Inference in Statistical Analysis, 1973, ch. 3).
    """
    centred = residuals - residuals.mean()
    kurtosis = float(np.mean(centred**4) / np.mean(centred**2) ** 2)
    if kurtosis > 3.0 - 3.0 * math.sqrt(24.0 / residuals.size):
        return 2.0
    if kurtosis <= _kurtosis(_FLATTEST):
        return _FLATTEST
    return float(brentq(lambda p: _kurtosis(p) - kurtosis, 2.0, _FLATTEST))


def _kurtosis(p: float) -> float:
    return math.exp(gammaln(5 / p) + gammaln(1 / p) - 2 * gammaln(3 / p))
