"""Quantiles and trend of latencies."""

import numpy as np

from dtwin.services.parts.latencies import MINUTE, RESOLUTION, Latencies


def test_nothing_measured_is_nothing() -> None:
    assert Latencies().summary() is None


def test_quantiles_are_those_of_the_samples() -> None:
    samples = np.random.default_rng(0).gamma(2.0, 0.0005, 20_000)
    latencies = Latencies()
    for k, sample in enumerate(samples):
        latencies.add(float(sample), 0.01 * k)
    found = latencies.summary()
    assert found is not None
    for share, value in ((0.50, found.p50), (0.99, found.p99)):
        assert abs(value - 1e3 * np.quantile(samples, share)) <= 1e3 * RESOLUTION
    assert found.max == 1e3 * samples.max()


def test_extremes_stay_within_the_histogram() -> None:
    latencies = Latencies()
    for latency in (0.0, 3600.0):
        latencies.add(latency, 0.0)
    found = latencies.summary()
    assert found is not None
    assert found.max == 3.6e6
    assert found.p50 <= 2e3 * RESOLUTION


def test_trend_is_the_slope_of_the_minutes() -> None:
    latencies = Latencies()
    for k in range(600):
        minute = k // 60
        latencies.add(0.001 + 0.0001 * minute, k * MINUTE / 60)
    found = latencies.summary()
    assert found is not None
    np.testing.assert_allclose(found.trend_per_minute, 0.1, rtol=1e-9)
