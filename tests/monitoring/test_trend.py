"""Slow changes and their forecast."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest

from dtwin.monitoring import trend as trend_of_parameters
from dtwin.monitoring.estimation.belief import Belief
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import INDEX
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.learning.course import courses
from dtwin.monitoring.trend import FEWEST, INTERVAL, LATELY, Trend, line, rest


def grown(belief: Belief, name: str, course: Callable[[float], float], entries: int, noise: float = 0.0) -> Trend:
    """A trend whose parameter takes the value course(hours) at every entry."""
    estimator = Estimator(belief, Tuning())
    trend = Trend(estimator)
    generator = np.random.default_rng(0)
    for k in range(entries):
        time = INTERVAL * k
        estimator.x[INDEX[name]] = course(time / 3600.0) + noise * generator.standard_normal()
        trend.enter(time, estimator)
    return trend


def test_growing_friction_is_forecast(belief: Belief) -> None:
    healthy = belief.arm.get("D2")
    trend = grown(belief, "D2", lambda h: healthy * (1 + 0.2 * h), 360, noise=1e-4)
    (forecast,) = trend.forecasts()
    last = (359 * INTERVAL) / 3600
    assert forecast.parameter == "D2"
    assert forecast.cause == "friction"
    assert forecast.per_hour == pytest.approx(0.2, rel=0.02)
    assert forecast.hours == pytest.approx(2.5 - last, rel=0.05)
    assert forecast.earliest < 2.5 - last < forecast.latest
    assert "limit +50 %" in forecast.text()


@pytest.mark.parametrize("before", [0.1, pytest.param(3.0, marks=pytest.mark.thorough), 5.9])
def test_a_leak_is_forecast_long_before_its_limit_whenever_it_begins(belief: Belief, before: float) -> None:
    healthy = belief.arm.get("K2")
    leaking = 1.0 / 12.0  # five minutes at 1 % a minute: half of the way to the limit
    entries = round((before + leaking) * 3600 / INTERVAL)
    trend = grown(belief, "K2", lambda h: healthy * (1 - 0.6 * max(h - before, 0.0)), entries, noise=1e-4)
    (forecast,) = trend.forecasts()
    assert forecast.parameter == "K2"
    assert forecast.change == pytest.approx(-0.05, abs=0.01)
    assert 0.0 < forecast.hours < 0.2
    assert "min (" in forecast.text()


def test_a_change_that_dies_away_before_the_limit_is_no_news(belief: Belief) -> None:
    healthy = belief.arm.get("K1")

    def warming(hours: float) -> float:
        return healthy * (1 + 0.06 * math.expm1(-12.0 * hours))

    assert all(grown(belief, "K1", warming, entries, noise=1e-6).forecasts() == [] for entries in (45, 60, 200, 700))


def test_what_a_healthy_arm_was_seen_to_change_by_counts_for_nothing(belief: Belief) -> None:
    course = courses({"D1": (-1e-3, -0.5e-3), "K2": (-1e-4, -1e-4)}, 600.0)
    assert course["D1"] == pytest.approx((-0.1, 0.45))
    assert course["K2"] == pytest.approx((-0.06, 0.06))
    warms = dataclasses.replace(belief, courses=course)
    healthy = belief.arm.get("D1")

    def cold(hours: float) -> float:
        return healthy * (1 + 0.45 * math.exp(-12.0 * hours))

    def worn(hours: float) -> float:
        return healthy * (1 + 0.45 + 0.5 * hours)

    assert grown(warms, "D1", cold, 200, noise=1e-6).forecasts() == []
    (forecast,) = grown(warms, "D1", worn, 200, noise=1e-6).forecasts()
    assert forecast.limit == pytest.approx(0.5 + 0.45)


def test_dry_friction_and_each_joint_have_trends_of_their_own(belief: Belief) -> None:
    (forecast,) = grown(belief, "mu2", lambda h: 0.001 + 0.01 * h, 360, noise=1e-6).forecasts()
    assert forecast.parameter == "mu2"
    assert "mN m" in forecast.text()


def test_how_far_a_change_goes_on_is_that_of_the_exponential() -> None:
    hours = np.linspace(-1.0, 0.0, 100)
    left = rest(hours, np.exp(-3.0 * (hours + 1.0)))
    assert math.exp(-3.0) <= left < 0.3
    assert rest(hours, hours) == math.inf
    assert rest(hours, np.exp(hours)) == math.inf


def test_a_limit_that_is_reached(belief: Belief) -> None:
    healthy = belief.arm.get("K1")
    trend = grown(belief, "K1", lambda h: healthy * (0.95 - 0.1 * h), 360)
    (forecast,) = trend.forecasts()
    assert forecast.hours == 0.0
    assert "is reached" in forecast.text()


def test_an_encoder_that_wanders_counts_from_where_it_was_learned(belief: Belief) -> None:
    trend = grown(belief, "bias3", lambda h: 0.0025 - 0.004 * h, 720)
    (forecast,) = trend.forecasts()
    learned = 0.5 * FEWEST * INTERVAL / 3600
    assert forecast.parameter == "bias3"
    assert forecast.limit == pytest.approx(-0.01)
    assert forecast.hours == pytest.approx(2.5 - (719 * INTERVAL / 3600 - learned), rel=0.05)


@pytest.mark.parametrize("noise", [1e-4, 1e-3])
def test_a_healthy_arm_has_no_forecast(belief: Belief, noise: float) -> None:
    assert grown(belief, "D2", lambda h: belief.arm.get("D2"), 500, noise).forecasts() == []


def test_few_entries_tell_nothing_and_old_ones_are_dropped(belief: Belief, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trend_of_parameters, "KEPT", 2 * FEWEST)
    healthy = belief.arm.get("D2")
    assert grown(belief, "D2", lambda h: healthy * (1 + 3 * h), LATELY[0] - 1).forecasts() == []
    trend = grown(belief, "D2", lambda h: healthy, 2 * FEWEST + 50)
    assert len(trend.changes()[0]) == 2 * FEWEST
    trend.restart()
    assert trend.forecasts() == []


def test_the_line_is_that_of_least_squares_with_an_honest_error() -> None:
    generator = np.random.default_rng(1)
    x = np.linspace(-1.0, 0.0, 200)
    slopes, errors = [], []
    for _ in range(200):
        level, slope, error = line(x, 2.0 + 3.0 * x + 0.1 * generator.standard_normal(200))
        assert level == pytest.approx(2.0, abs=0.1)
        slopes.append(slope)
        errors.append(error)
    assert np.mean(slopes) == pytest.approx(3.0, abs=0.02)
    assert np.std(slopes) == pytest.approx(np.mean(errors), rel=0.25)


def test_residuals_that_follow_each_other_widen_the_error() -> None:
    generator = np.random.default_rng(2)
    x = np.linspace(-1.0, 0.0, 400)
    noise = np.zeros(400)
    for k in range(1, 400):
        noise[k] = 0.9 * noise[k - 1] + 0.1 * generator.standard_normal()
    _, _, error = line(x, noise)
    naive = noise.std() / math.sqrt(np.sum((x - x.mean()) ** 2))
    assert error > 2.0 * naive
