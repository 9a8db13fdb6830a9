"""Noise statistics and encoder faults."""

import math
from typing import cast

import numpy as np
import pytest

from dtwin.emulation.encoders import EncoderFaults, Encoders, NoiseKind
from dtwin.errors import ParameterError

ANGLES = [0.1, -0.2, 0.3, 0.9]


def encoders(kind: NoiseKind = "none", magnitude: float = 0.0) -> Encoders:
    return Encoders(kind, magnitude, np.random.default_rng(5))


def errors(kind: NoiseKind, magnitude: float, samples: int = 20_000) -> np.ndarray:
    source = encoders(kind, magnitude)
    return np.array([source.measure(ANGLES, 0.0) for _ in range(samples)]) - ANGLES


def test_without_noise_the_reading_is_the_truth() -> None:
    assert encoders().measure(ANGLES, 1.0) == ANGLES
    assert encoders("uniform", 0.0).measure(ANGLES, 1.0) == ANGLES


def test_uniform_noise_lies_between_zero_and_its_magnitude() -> None:
    noise = errors("uniform", 0.01)
    assert noise.min() >= -1e-15
    assert noise.max() < 0.01 + 1e-15
    # Standard error of the mean: 0.01 / sqrt(12 * 20000) = 2e-5; five of them.
    assert noise.mean(axis=0) == pytest.approx([0.005] * 4, abs=1e-4)
    assert noise.std(axis=0) == pytest.approx([0.01 / math.sqrt(12)] * 4, rel=0.02)


def test_gaussian_noise_is_centred() -> None:
    noise = errors("gaussian", 0.01)
    assert noise.mean(axis=0) == pytest.approx([0.0] * 4, abs=5 * 0.01 / math.sqrt(20_000))
    assert noise.std(axis=0) == pytest.approx([0.01] * 4, rel=0.03)


def test_encoders_err_independently() -> None:
    correlation = np.corrcoef(errors("gaussian", 0.01).T)
    assert np.abs(correlation - np.eye(4)).max() < 5 / math.sqrt(20_000)


def test_bias_and_drift_add_up() -> None:
    source = encoders()
    source.set_faults(EncoderFaults(offset=(0.02, 0.0, -0.03), rate=(0.0, 0.0, 0.001)))
    assert source.measure(ANGLES, 40.0) == pytest.approx([0.12, -0.2, 0.31, 0.9], abs=1e-15)


def test_another_scale_grows_with_the_angle_and_adds_to_a_bias() -> None:
    source = encoders()
    source.set_faults(EncoderFaults(offset=(0.02, 0.0, 0.0), scale=(1.1, 0.5, 1.0)))
    assert source.measure(ANGLES, 40.0) == pytest.approx([0.13, -0.1, 0.3, 0.9], abs=1e-15)


def test_frozen_encoder_repeats_its_last_reading() -> None:
    source = encoders("uniform", 0.01)
    before = source.measure(ANGLES, 0.0)
    source.set_faults(EncoderFaults(offset=(1.0, 1.0, 1.0), frozen=frozenset({2})))
    for _ in range(3):
        reading = source.measure([1.0, 1.0, 1.0, 1.0], 0.0)
        assert reading[1] == before[1]
        assert reading[0] >= 2.0
    source.set_faults(EncoderFaults())
    assert source.measure([1.0, 1.0, 1.0, 1.0], 0.0)[1] == pytest.approx(1.005, abs=0.005)


def test_the_true_angles_are_left_alone() -> None:
    angles = list(ANGLES)
    source = encoders("gaussian", 0.1)
    source.set_faults(EncoderFaults(offset=(1.0, 1.0, 1.0)))
    source.measure(angles, 0.0)
    assert angles == ANGLES


def test_unknown_noise_kind_lists_the_choices() -> None:
    with pytest.raises(ParameterError, match="'pink': expected none, uniform or gaussian"):
        encoders(cast(NoiseKind, "pink"))


@pytest.mark.parametrize("magnitude", [-0.1, math.nan, math.inf])
def test_noise_must_be_a_magnitude(magnitude: float) -> None:
    with pytest.raises(ParameterError, match="noise: expected"):
        encoders("uniform", magnitude)
