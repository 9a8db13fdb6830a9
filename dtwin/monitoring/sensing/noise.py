"""What the noise of an encoder is like: how strong, how heavy its tails, how lasting."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.estimation.belief import NOISE_FLOOR
from dtwin.monitoring.estimation.kernels import huber

Array = NDArray[np.float64]

_LOUDER: Final = 1.2
"""factor by which noise must exceed what is believed to be believed instead"""
_CLIPS: Final = np.array([math.inf, 2.5, 2.0, 1.7, 1.4, 1.2, 1.0, 0.8, 0.6])
_SCALES: Final = np.geomspace(0.4, 2.5, 40)
"""of the core of Huber's density, relative to the median of the noise"""
_HEAVIER: Final = 5.0
"""log-likelihood by which heavy tails have to explain the noise better than a normal distribution"""
_CORRELATED: Final = 3.5
"""standard errors from which on a correlation of neighbouring samples is believed"""
_MOST: Final = 0.98
"""correlation: noise that lasts longer cannot be told from motion"""


class Noise(NamedTuple):
    """The noise of one encoder.

    Attributes:
        deviation: of the core of its distribution, rad.
        clip: standard deviations beyond which its tails are exponential.
        lasting: how many samples of it tell as much as one of white noise.
    """

    deviation: float
    clip: float
    lasting: float

    @property
    def white(self) -> float:
        """Standard deviation of white noise that tells as little over some time, rad."""
        return self.deviation * math.sqrt(self.lasting)

    def differs(self, believed: float) -> bool:
        """Whether it is not the normal white noise of a standard deviation (rad) that is believed in."""
        louder = self.white > _LOUDER * max(believed, NOISE_FLOOR)
        return louder or math.isfinite(self.clip) or self.lasting > 1.0


def judge(segments: list[Array]) -> Noise:
    """Judges noise of mean 0 in several stretches of time, (n,) each, rad."""
    values = np.concatenate(segments)
    middle = max(1.4826 * float(np.median(np.abs(values))), NOISE_FLOOR)
    z = np.abs(values) / (middle * _SCALES[:, None])
    fits = []
    for clip, (_, constant) in zip(_CLIPS, map(huber, _CLIPS), strict=True):
        counted = np.minimum(z, clip)
        fits.append(-(0.5 * counted * (2.0 * z - counted)).sum(axis=1) - len(values) * (np.log(_SCALES) + constant))
    likelihood = np.array(fits)
    best = int(likelihood.max(axis=1).argmax())
    heavy = likelihood[best].max() > likelihood[0].max() + _HEAVIER
    if not heavy:
        return Noise(float(values.std()), math.inf, _lasting(segments))
    deviation, clip = middle * float(_SCALES[likelihood[best].argmax()]), float(_CLIPS[best])
    limited = [np.clip(segment, -clip * deviation, clip * deviation) for segment in segments]
    return Noise(deviation, clip, _lasting(limited))


def _lasting(segments: list[Array]) -> float:
    """How many samples count as one: (1 + r) / (1 - r) of an autoregression of first order (Bartlett 1935).

    The level and slope that were taken out of each stretch make its correlation look smaller, by (2 + 4 r) / n
    (Kendall 1954); it is taken to be one standard error above that.
    """
    power = sum(float(segment @ segment) for segment in segments)
    product = sum(float(segment[1:] @ segment[:-1]) for segment in segments)
    count = sum(map(len, segments))
    correlation = product / power if power > 0.0 else 0.0
    if power < NOISE_FLOOR**2 * count or correlation * math.sqrt(count) < _CORRELATED:
        return 1.0
    mean_length = count / len(segments)
    correlation += (2.0 + 4.0 * correlation) / mean_length
    correlation += math.sqrt(max(1.0 - correlation**2, 0.0) / count)
    correlation = min(correlation, _MOST)
    return (1.0 + correlation) / (1.0 - correlation)
