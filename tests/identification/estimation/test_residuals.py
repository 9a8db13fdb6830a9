import numpy as np
import pytest

from dtwin.identification.estimation.residuals import fit, shape, whiteness

GENERATOR = np.random.default_rng(0)


def test_white_noise_passes() -> None:
    passed = [whiteness([GENERATOR.uniform(size=(350, 3))]).white for _ in range(300)]
    # 3 joints at a significance of 1e-4: 0.1 alarms are expected.
    assert sum(passed) >= 298


@pytest.mark.parametrize("correlation", [0.3, -0.3, 0.9])
def test_coloured_noise_fails(correlation: float) -> None:
    noise = GENERATOR.standard_normal((350, 3))
    for k in range(1, 350):
        noise[k, 1] += correlation * noise[k - 1, 1]
    assert not whiteness([noise]).white
    p = whiteness([noise]).p_values
    assert p[1] < min(p[0], p[2])


def test_rounding_counts_as_white() -> None:
    assert whiteness([1e-12 * np.ones((350, 3)).cumsum(axis=0) / 350]).white


def test_experiments_do_not_correlate_across_their_ends() -> None:
    blocks = [GENERATOR.standard_normal((100, 3)) for _ in range(5)]
    forwards, backwards = whiteness(blocks), whiteness(blocks[::-1])
    assert forwards.p_values == pytest.approx(backwards.p_values, rel=1e-9)


def test_fit() -> None:
    angles = np.column_stack([np.sin(np.arange(100) * rate) for rate in (0.1, 0.2, 0.3)])
    assert fit(angles, angles) == pytest.approx(1.0)
    assert fit(angles, np.tile(angles.mean(axis=0), (100, 1))) == pytest.approx(0.0)
    half = angles.mean(axis=0) + 0.5 * (angles - angles.mean(axis=0))
    assert fit(angles, half) == pytest.approx(0.5)


def test_shape_of_noise() -> None:
    assert shape(GENERATOR.uniform(size=1050)) == 6.0
    assert shape(GENERATOR.standard_normal(1050)) == 2.0
    assert shape(GENERATOR.standard_t(3, size=1050)) == 2.0
    # |r|^4: kurtosis Gamma(5/4) Gamma(1/4) / Gamma(3/4)^2 = 2.188
    flat = GENERATOR.gamma(0.25, size=200_000) ** 0.25 * GENERATOR.choice((-1, 1), 200_000)
    assert shape(flat) == pytest.approx(4.0, rel=0.05)
