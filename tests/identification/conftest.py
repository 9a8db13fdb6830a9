"""A model identified from one noisy run, which several tests write, store and export."""

import numpy as np
import pytest

from dtwin.identification.estimation.estimate import Estimate, identify
from dtwin.identification.model import IdentifiedModel
from dtwin.identification.result import from_estimate
from tests.support.arms import Array
from tests.support.identification import SETTINGS, noisy


@pytest.fixture(scope="session")
def estimate() -> Estimate:
    return identify([noisy(0, 0.005)], SETTINGS)


@pytest.fixture(scope="session")
def fit() -> Array:
    return np.array([0.99, 0.98, 0.97])


@pytest.fixture(scope="session")
def model(estimate: Estimate, fit: Array) -> IdentifiedModel:
    return from_estimate(estimate, fit, "a test")
