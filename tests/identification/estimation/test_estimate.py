from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from scipy.special import chdtri

from dtwin.errors import IdentificationError, ParameterError
from dtwin.identification.data import Experiment
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, Loss, identify
from dtwin.identification.estimation.problem import START, Prior
from dtwin.identification.excitation.design import predict
from dtwin.identification.excitation.plan import Plan
from dtwin.parameters import PARAMETER_NAMES
from tests.support.arms import Array
from tests.support.identification import ARM, FREE, NO_MASSES, SETTINGS, clean, measured, noisy, truth

UNIFORM = 12**-0.5
"""The standard deviation of noise that is uniform between 0 and 1."""


def relative_errors(estimate: Estimate, names: Sequence[str] = FREE) -> Array:
    return np.array([estimate.values[name] for name in names]) / truth(names) - 1


def off(settings: EstimationSettings, seed: int) -> EstimationSettings:
    """The settings with a start that is up to 50 % away in every free parameter."""
    factors = np.random.default_rng(seed).uniform(0.5, 1.5, len(settings.free))
    values = {name: settings.known.get(name) * f for name, f in zip(settings.free, factors, strict=True)}
    return replace(settings, known=settings.known.with_values(values))


def test_without_noise_every_parameter_is_exact() -> None:
    for settings in (SETTINGS, *(off(SETTINGS, seed) for seed in range(5))):
        estimate = identify([clean()], settings)
        assert estimate.converged
        assert np.abs(relative_errors(estimate)).max() < 1e-6
        assert np.abs(estimate.problem.offset(estimate.x)).max() < 1e-9


def test_masses_known_two_runs_determine_the_fifteen_others() -> None:
    settings = EstimationSettings(NO_MASSES, ARM.with_values({name: START.get(name) for name in NO_MASSES}))
    runs = [clean(), measured(payload=0.0)]
    assert np.abs(relative_errors(identify(runs, settings), NO_MASSES)).max() < 1e-6
    estimate = identify([noisy(k, 0.005, given=run) for k, run in enumerate(runs)], settings)
    assert estimate.identifiability.rank == 15
    error = relative_errors(estimate, NO_MASSES) * truth(NO_MASSES)
    standard = np.array([estimate.standard_errors[name] for name in NO_MASSES])
    # Largest of 15 standard normal errors: 4 standard errors are exceeded once in a thousand times.
    assert np.all(np.abs(error) < 4 * standard)


@pytest.mark.parametrize(("loss", "lowest", "highest"), [("gaussian", 0.8, 1.2), ("adaptive", 0.3, 0.7)])
def test_errors_are_at_the_bound_and_intervals_hold(loss: Loss, lowest: float, highest: float) -> None:
    """The errors are those of 24 runs at four noise levels, from two kinds of starts."""
    bounds = predict([Plan()], FREE, ARM, 1.0).relative
    ratios, inside, distances = [], [], []
    for run in range(24):
        level = (0.001, 0.005, 0.010, 0.025)[run % 4]
        settings = replace(SETTINGS if run % 8 < 4 else off(SETTINGS, run), loss=loss)
        estimate = identify([noisy((1, run), level)], settings)
        assert estimate.converged
        error = relative_errors(estimate)
        ratios.append(error / (level * UNIFORM * np.array([bounds[name] for name in FREE])))
        standard = np.array([estimate.standard_errors[name] for name in FREE]) / truth(FREE)
        inside.append(np.abs(error) < 1.96 * standard)
        covariance = estimate.covariance[:12, :12] / np.outer(truth(FREE), truth(FREE))
        distances.append(error @ np.linalg.solve(covariance, error))
        assert np.allclose(estimate.problem.offset(estimate.x), level / 2, atol=0.1 * level)
    root_mean_square = np.sqrt(np.mean(np.square(ratios)))
    assert lowest < root_mean_square < highest
    # The errors of a run are correlated, their distance in the metric of the covariance is not: chi squared.
    total = float(np.sum(distances))
    assert 0.6 * 12 * 24 < total < chdtri(12 * 24, 0.0001) * 1.15
    assert 0.90 < np.mean(inside) < 0.99


def test_offsets_that_are_not_estimated_spoil_the_rest() -> None:
    noise = noisy(0, 0.010)
    biased = identify([noise], replace(SETTINGS, offsets=False, starts=1))
    right = identify([noise], SETTINGS)
    assert abs(relative_errors(biased)[0]) > 0.03
    assert abs(relative_errors(right)[0]) < 0.01


def test_gaussian_noise_is_taken_for_gaussian() -> None:
    estimate = identify([noisy(3, 0.003, "gaussian")], SETTINGS)
    assert estimate.shape == 2.0
    assert estimate.noise == pytest.approx(0.003, rel=0.15)


def test_robust_loss_shrugs_off_outliers() -> None:
    usual = noisy(0, 0.002, "gaussian")
    angles = usual.measured.copy()
    hit = np.random.default_rng(1).random(angles.shape) < 0.03
    angles[hit] += 0.2
    spoilt = Experiment(angles, usual.volts, usual.payload, usual.start, usual.period, usual.payload_model)
    standard = np.array([identify([usual], SETTINGS).standard_errors[name] for name in FREE]) / truth(FREE)
    robust = np.abs(relative_errors(identify([spoilt], replace(SETTINGS, loss="huber", starts=1)))) / standard
    plain = np.abs(relative_errors(identify([spoilt], replace(SETTINGS, loss="gaussian", starts=1)))) / standard
    assert robust.max() < 5
    assert plain.max() > 10


def test_a_prior_narrows_what_data_leave_open() -> None:
    empty = measured(payload=0.0, noise=0.005)
    open_ = identify([empty], SETTINGS)
    assert open_.identifiability.rank == 11
    assert np.isnan(open_.standard_errors["K1"])
    prior = replace(SETTINGS, priors={"K1": Prior(ARM.get("K1"), 0.001)})
    estimate = identify([empty], prior)
    assert estimate.identifiability.rank == 12
    assert estimate.standard_errors["K1"] == pytest.approx(0.001, rel=0.05)
    assert abs(estimate.values["K1"] - ARM.get("K1")) < 1e-4
    assert abs(estimate.values["K2"] - ARM.get("K2")) < 4 * estimate.standard_errors["K2"]


def test_unknown_initial_state_is_estimated_too() -> None:
    free = measured(noise=0.005, known=False)
    estimate = identify([free], SETTINGS)
    assert len(estimate.x) == 21
    standard = np.array([estimate.standard_errors[name] for name in FREE]) / truth(FREE)
    assert np.all(np.abs(relative_errors(estimate)) < 4.5 * standard)


def test_a_wrong_model_is_told_by_its_residuals() -> None:
    rubbing = measured(noise=0.002, arm=ARM.with_values({"mu1": 0.02}))
    estimate = identify([rubbing], replace(SETTINGS, starts=1))
    assert not estimate.whiteness.white


def test_equal_data_give_equal_estimates() -> None:
    first, second = (identify([noisy(7, 0.01)], off(SETTINGS, 1)) for _ in range(2))
    assert np.array_equal(first.x, second.x)
    assert np.array_equal(first.covariance, second.covariance)


def test_bad_settings_are_named() -> None:
    with pytest.raises(ParameterError, match="unknown parameter 'K4': expected K1, K2"):
        identify([clean()], EstimationSettings(("K4",)))
    with pytest.raises(ParameterError, match="prior for m1: expected a free parameter: K1"):
        identify([clean()], EstimationSettings(("K1",), priors={"m1": Prior(0.1, 0.1)}))
    with pytest.raises(ParameterError, match="there twice in K1, K1"):
        identify([clean()], EstimationSettings(("K1", "K1")))
    with pytest.raises(IdentificationError, match="loss 'cauchy': expected adaptive, gaussian or huber"):
        EstimationSettings(PARAMETER_NAMES, loss=cast(Loss, "cauchy"))
