"""The thesis's monitor."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dtwin.errors import ParameterError
from dtwin.logs.log import Log
from dtwin.monitoring.offline import stream
from dtwin.monitoring.thesis import ABSOLUTE, IN_A_ROW, RELATIVE, ThesisMonitor, ThesisSettings
from dtwin.parameters import ArmParameters

ARM = ArmParameters()


def test_a_healthy_arm_moves_like_the_simulation(run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    monitor = ThesisMonitor(ARM, ThesisSettings(sample_time=0.01))
    worst = 0.0
    for row in range(0, len(seen), 10):
        seen.feed(monitor, row, row + 10)
        worst = max(worst, np.abs(monitor.simulated - seen.measured[row + 9]).max())
    assert worst < 0.05
    assert monitor.messages() == ("nominal",) * 3
    assert monitor.events == []


def test_k2_at_a_tenth_takes_ten_samples_in_a_row(run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell(45.0, 3, "K2*=0.1@31"))
    monitor = ThesisMonitor(ARM)
    seen.feed(monitor, 0, len(seen))
    (first, *_), times = monitor.events, monitor.failed
    assert "deviation detected on link" in first.text
    assert 31.0 + (IN_A_ROW - 1) * 0.5 < np.nanmin(times) < 41.0
    assert "deviation detected" in monitor.messages()
    verdict = monitor.verdict()
    assert {finding.cause for finding in monitor.standing()} == {"unknown"}
    assert verdict.units[f"joint {monitor.standing()[0].joint}"].state == "failed"


@pytest.mark.parametrize("sample_time", [0.01, 0.1, 0.5])
def test_finer_sampling_finds_it_sooner(sample_time: float, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell(45.0, 3, "K2*=0.1@31"))
    monitor = ThesisMonitor(ARM, ThesisSettings(sample_time, 0.01))
    seen.feed(monitor, 0, len(seen))
    latency = float(np.nanmin(monitor.failed)) - 31.0
    assert (IN_A_ROW - 1) * sample_time < latency < IN_A_ROW * sample_time + 4.0


def test_a_sample_deviates_beyond_both_thresholds_only() -> None:
    monitor = ThesisMonitor(ARM, ThesisSettings(sample_time=0.01))
    start = np.array([-0.6699, -1.5931, 2.2630])
    monitor.update(0, start, False, "")
    monitor.update(1, monitor.simulated.copy(), False, "")
    simulated = monitor.simulated.copy()
    beyond = ABSOLUTE + 1e-3
    monitor._compare(simulated + np.array([beyond, 0.0, -ABSOLUTE + 1e-3]))
    assert monitor.counts.tolist() == [1, 0, 0]
    assert monitor.messages() == ("may be degrading", "nominal", "nominal")
    assert beyond < RELATIVE * 4.0
    monitor._states[0, :3] = simulated = np.array([4.0, 4.0, 0.0])  # rad: a twentieth of it is more than 0.1 rad
    monitor._compare(simulated + np.array([beyond, 2 * beyond + 0.1, ABSOLUTE + 0.01]))
    assert monitor.counts.tolist() == [0, 1, 1]


def test_ten_in_a_row_and_not_nine_are_a_failure() -> None:
    monitor = ThesisMonitor(ARM, ThesisSettings(sample_time=0.01))
    monitor.update(0, np.array([-0.6699, -1.5931, 2.2630]), False, "")
    off = monitor.simulated + np.array([0.0, 0.5, 0.0])
    for _ in range(IN_A_ROW - 1):
        monitor._compare(off)
    monitor._compare(monitor.simulated)
    for _ in range(IN_A_ROW - 1):
        monitor._compare(off)
    assert monitor.messages()[1] == "may be degrading"
    monitor._compare(off)
    assert monitor.messages()[1] == "deviation detected"
    assert len(monitor.events) == 1


def test_a_new_motion_starts_the_simulation_anew(run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    grip = int(np.flatnonzero(seen.gripped)[0])
    monitor = ThesisMonitor(ARM)
    seen.feed(monitor, 0, grip)
    assert not np.array_equal(monitor.simulated, seen.measured[grip - 1])
    seen.feed(monitor, grip, grip + 1)
    np.testing.assert_array_equal(monitor.simulated, seen.measured[grip])


def test_missing_samples_are_simulated_over(run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    whole, gappy = ThesisMonitor(ARM), ThesisMonitor(ARM)
    kept = np.flatnonzero(np.arange(2000) % 7 != 3)
    seen.feed(whole, 0, 2000)
    part = replace(
        seen, **{name: getattr(seen, name)[kept] for name in ("sample", "measured", "volts", "gripped", "colour")}
    )
    part.feed(gappy, 0, len(part))
    assert gappy.missed == np.count_nonzero(np.arange(2000) % 7 == 3)
    assert gappy.messages() == ("nominal",) * 3
    np.testing.assert_allclose(gappy.simulated, whole.simulated, atol=0.02)


@pytest.mark.parametrize(
    ("sample_time", "step", "match"),
    [(0.015, 0.005, "sample time"), (0.0, 0.005, "sample time"), (0.5, 0.003, "step"), (0.5, 0.0, "step")],
)
def test_impossible_times(sample_time: float, step: float, match: str) -> None:
    with pytest.raises(ParameterError, match=match):
        ThesisSettings(sample_time, step)
