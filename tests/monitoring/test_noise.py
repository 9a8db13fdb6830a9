"""Noise of other distributions than the normal one: how it is judged, and that it is no failure."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad

from dtwin.logs.log import Log
from dtwin.monitoring.estimation import kernels
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import stream
from dtwin.monitoring.sensing.noise import judge
from dtwin.monitoring.sensing.readings import Readings
from dtwin.parameters import ArmParameters

LEVEL = 1e-3
"""rad"""
Draw = Callable[[np.random.Generator, int], np.ndarray]


def lasting(correlation: float) -> Draw:
    """Draws an autoregression of first order."""

    def draw(generator: np.random.Generator, count: int) -> np.ndarray:
        steps = LEVEL * math.sqrt(1.0 - correlation**2) * generator.standard_normal((count, 3))
        values = np.empty_like(steps)
        values[0] = LEVEL * generator.standard_normal(3)
        for k in range(1, count):
            values[k] = correlation * values[k - 1] + steps[k]
        return values

    return draw


KINDS: dict[str, Draw] = {
    "normal": lambda generator, count: LEVEL * generator.standard_normal((count, 3)),
    "Laplace": lambda generator, count: LEVEL * generator.laplace(size=(count, 3)) / math.sqrt(2.0),
    "Student": lambda generator, count: LEVEL * generator.standard_t(3.0, size=(count, 3)) / math.sqrt(3.0),
    "lasting 0.8": lasting(0.8),
    "lasting 0.95": lasting(0.95),
}
"""Three readings a sample, of standard deviation LEVEL."""


@pytest.mark.parametrize("clip", [0.6, 1.4, 2.5, math.inf])
def test_the_constants_of_a_density_are_its_integrals(clip: float) -> None:
    def density(z: float) -> float:
        counted = min(abs(z), clip)
        return math.exp(-0.5 * counted * (2.0 * abs(z) - counted)) / math.sqrt(2.0 * math.pi)

    bound = clip if math.isfinite(clip) else 10.0
    whole = 2.0 * quad(density, 0.0, bound)[0] + 2.0 * quad(density, bound, 60.0)[0]
    squared = 2.0 * quad(lambda z: min(z, clip) ** 2 * density(z), 0.0, bound)[0]
    squared += 2.0 * quad(lambda z: min(z, clip) ** 2 * density(z), bound, 60.0)[0]
    share, constant = kernels.huber(clip)
    assert constant == pytest.approx(math.log(whole), abs=1e-9)
    assert share == pytest.approx(squared / whole, rel=1e-9)


def test_normal_white_noise_is_believed_to_be_that() -> None:
    for number in range(40):
        noise = judge([LEVEL * np.random.default_rng(number).standard_normal(400)])
        assert noise.deviation == pytest.approx(LEVEL, rel=0.15)
        assert noise.clip == math.inf
        assert noise.lasting == 1.0


@pytest.mark.parametrize("kind", ["Laplace", "Student"])
def test_heavy_tails_are_heard(kind: str) -> None:
    for number in range(10):
        noise = judge([KINDS[kind](np.random.default_rng(number), 400)[:, 0]])
        assert noise.clip < 2.0
        assert noise.deviation < LEVEL


@pytest.mark.parametrize("correlation", [0.5, 0.8])
def test_lasting_noise_counts_as_fewer_samples(correlation: float) -> None:
    found = [judge([lasting(correlation)(np.random.default_rng(k), 400)[:, 0]]).lasting for k in range(20)]
    assert np.median(found) == pytest.approx((1.0 + correlation) / (1.0 - correlation), rel=0.35)


@pytest.mark.parametrize("kind", list(KINDS))
def test_such_noise_is_no_failure(kind: str, run_cell: Callable[..., Log]) -> None:
    log = run_cell(60.0, 5, noise=0.0)
    seen = stream(log)
    noisy = replace(seen, measured=seen.measured + KINDS[kind](np.random.default_rng(1), len(seen)))
    monitor = Monitor(assumed(ArmParameters(), (LEVEL, LEVEL, LEVEL)))
    noisy.feed(monitor, 0, len(noisy))
    assert [event.text for event in monitor.events if event.kind != "spike"] == []


@pytest.mark.parametrize("kind", ["Laplace", "lasting 0.8"])
def test_a_failure_is_found_through_such_noise(kind: str, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell(45.0, 3, "K1*=0.6@31-38", noise=0.0))
    noisy = replace(seen, measured=seen.measured + KINDS[kind](np.random.default_rng(1), len(seen)))
    monitor = Monitor(assumed(ArmParameters(), (LEVEL, LEVEL, LEVEL)))
    noisy.feed(monitor, 0, len(noisy))
    assert min(found.detected for found in monitor.history) == pytest.approx(31.0, abs=0.2)
    named = [found for found in monitor.history if found.parameter == "K1"]
    assert named[0].size == pytest.approx(-0.4, abs=0.06)
    assert "K1" not in monitor.findings.current


def test_a_reading_is_a_spike_where_the_noise_hardly_ever_gets() -> None:
    angle, far = np.zeros(3), np.array([15e-3, 0.0, 0.0])
    for clip, spike in ((math.inf, True), (0.6, False)):
        readings = Readings((LEVEL, LEVEL, LEVEL))
        readings.expect_tails((clip, clip, clip))
        generator = np.random.default_rng(0)
        for _ in range(30):
            readings.update(LEVEL * generator.standard_normal(3))
            readings.judge(angle, np.full(3, LEVEL), True)
        readings.update(angle + far)
        assert bool(readings.judge(angle, np.full(3, LEVEL), True)[0]) is not spike
