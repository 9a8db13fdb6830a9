"""Figures of trajectories that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from dtwin.simulation.figures import figures, fit

CONSTANTS = (0.2, 0.1, 0.1)


def trajectory(seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Joint 1 goes exponentially to 1 rad, joint 2 beyond it by 0.1 rad and back, joint 3 stays."""
    time = np.arange(round(seconds * 100) + 1) / 100
    theta = np.column_stack((1 - np.exp(-4 * time), 1 + 0.1 * np.sin(np.pi * time) * (time < 2), 0 * time))
    omega = np.column_stack((4 * np.exp(-4 * time), 0.1 * np.pi * np.cos(np.pi * time) * (time < 2), 0 * time))
    return theta, omega


def test_settling_needs_band_and_speed() -> None:
    theta, omega = trajectory()
    path = np.zeros((400, 3))
    found = figures(theta, omega, path, np.zeros((400, 3)), (1.0, 1.0, 0.0), CONSTANTS)
    # Joint 2 is the last: its speed ends at 2 s. The start of joint 2 is at its target, its band 1 mrad.
    assert found.settling_time == pytest.approx(2.0)
    slow = figures(theta[:181], omega[:181], path[:180], path[:180], (1.0, 1.0, 0.0), CONSTANTS)
    assert slow.settling_time is None


def test_two_percent_of_the_way_counts() -> None:
    theta, omega = trajectory()
    theta[:, 1], omega[:, 1:] = 0.0, 0.0
    path = np.zeros((400, 3))
    found = figures(theta, np.zeros_like(omega), path, path, (1.0, 0.0, 0.0), CONSTANTS)
    assert found.settling_time == pytest.approx(np.ceil(np.log(50) / 4 * 100) / 100)
    fast = figures(theta, omega, path, path, (1.0, 0.0, 0.0), CONSTANTS)
    assert fast.settling_time == pytest.approx(np.ceil(np.log(400) / 4 * 100) / 100)


def test_distance_overshoot_and_end() -> None:
    theta, omega = trajectory()
    path = theta[:-1] + np.array([0.01, -0.02, 0.0])
    found = figures(theta, omega, path, np.zeros((400, 3)), (0.5, 1.0, 0.0), CONSTANTS)
    assert found.tracking_max == pytest.approx((0.01, 0.02, 0.0))
    assert found.tracking_rms == pytest.approx((0.01, 0.02, 0.0))
    assert found.overshoot == (0.0, 0.0, 0.0)  # the path itself goes beyond the target
    path[:, 0] = np.minimum(path[:, 0], 0.5)
    direct = figures(theta, omega, path, np.zeros((400, 3)), (0.5, 1.0, 0.0), CONSTANTS)
    assert direct.overshoot == pytest.approx((0.5, 0.0, 0.0), abs=1e-6)
    assert found.final_error == pytest.approx((0.5, 0.0, 0.0), abs=1e-6)


def test_voltage_and_energy() -> None:
    theta = np.array([[0.0, 0, 0], [0.5, 0, 0], [0.25, 0, 0], [0.25, 0, 0]])
    volts = np.array([[8.0, 0, 0], [2.0, 0, 0], [-8.0, -3.0, 0]])
    found = figures(theta, np.zeros_like(theta), theta[:-1], volts, (0.25, 0.0, 0.0), CONSTANTS)
    assert found.peak_volts == (8.0, 3.0, 0.0)
    assert found.saturated == pytest.approx(2 / 3)
    assert found.energy == pytest.approx(0.2 * 8 * 0.5)  # what comes back does not count


def test_fit() -> None:
    y = np.random.default_rng(0).normal(size=(50, 3))
    assert fit(y, y) == (1.0, 1.0, 1.0)
    assert fit(y, np.tile(y.mean(axis=0), (50, 1))) == pytest.approx((0.0, 0.0, 0.0))
    half = y.mean(axis=0) + 0.5 * (y - y.mean(axis=0))
    assert fit(y, half) == pytest.approx((0.5, 0.5, 0.5))
