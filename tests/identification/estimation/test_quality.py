import numpy as np
import pytest

from dtwin.errors import IdentificationError
from dtwin.identification.data import Experiment, from_log
from dtwin.identification.estimation import quality
from dtwin.identification.estimation.estimate import EstimationSettings, identify
from dtwin.logs.collecting import RunLog
from tests.support.arms import Array
from tests.support.identification import FREE, SETTINGS, clean, noisy


def changed(measured: Array | None = None, volts: Array | None = None) -> Experiment:
    measured = clean().measured if measured is None else measured
    return Experiment(measured, clean().volts if volts is None else volts, clean().payload, clean().start)


def refusal(experiment: Experiment, settings: EstimationSettings = SETTINGS) -> str:
    with pytest.raises(IdentificationError) as caught:
        identify([experiment], settings)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_too_few_samples() -> None:
    assert refusal(clean().head(12)) == "too few samples: 12 for 15 unknowns, expected at least 20; record longer"


def test_no_motion() -> None:
    still = np.tile(clean().measured[0], (350, 1))
    assert refusal(changed(still)).startswith("no motion to identify from: joint 1 moved by 0 rad")
    frozen = clean().measured.copy()
    frozen[:, 1] = 0.3
    assert "joint 2 moved by" in refusal(changed(frozen))


def test_motion_drowned_in_noise() -> None:
    noise = 0.05 * np.random.default_rng(0).standard_normal((350, 3))
    assert "with noise of 0.0" in refusal(changed(0.01 * clean().measured + noise))


def test_saturated() -> None:
    volts = np.full((350, 3), 3.0)
    volts[:200, 2] = 11.0
    assert refusal(changed(volts=volts)).startswith("motor 3 was saturated in 57 % of the samples")


def test_diverged() -> None:
    jump = clean().measured.copy()
    jump[100:, 0] += 40.0
    assert "diverged: joint 1 jumps by 40" in refusal(changed(jump))
    jump[100, 0] = np.nan
    with pytest.raises(IdentificationError, match="measured of joint 1 at sample 100: expected a finite number"):
        changed(jump)


def test_noise_is_told_from_motion() -> None:
    assert quality.noise(noisy(0, 0.02, "gaussian").measured) == pytest.approx(0.02, rel=0.15)


def test_an_empty_log_is_refused() -> None:
    with pytest.raises(IdentificationError, match="too few samples: the log has 0"):
        from_log(RunLog().freeze())
    assert len(FREE) == 12
