"""A model identified from one noisy run, which several tests write, store and export."""

import numpy as np

from dtwin.identification.estimation.estimate import identify
from dtwin.identification.result import from_estimate
from tests.support.identification import SETTINGS, noisy

ESTIMATE = identify([noisy(0, 0.005)], SETTINGS)
FIT = np.array([0.99, 0.98, 0.97])
MODEL = from_estimate(ESTIMATE, FIT, "a test")
