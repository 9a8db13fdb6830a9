import numpy as np
import pytest
from numpy.typing import ArrayLike

from dtwin.errors import DivergenceError, ParameterError
from dtwin.parameters import PARAMETER_NAMES, PayloadModel, scaled
from dtwin.twin.rollout import rollout
from dtwin.twin.sensitivity import COLUMN_NAMES, STATE_NAMES, sensitivities
from tests.support.arms import DEFAULT, Array

ARM = DEFAULT.with_values({"mu1": 0.01, "mu2": 0.008, "mu3": 0.012})
START = np.array([0.3, -0.5, 0.8, 0.2, 0.1, -0.3])
VOLTS = np.repeat(np.random.default_rng(0).uniform(-2, 2, (10, 3)), 10, axis=0)
VOLTS[40:45] = 9.0
PAYLOAD = np.repeat([0.0, 0.2], 50)
IDENTIFIED = PARAMETER_NAMES[:18]


def difference_quotient(name: str, payload_model: PayloadModel) -> Array:
    """Central differences at h, 2h and 4h, extrapolated to sixth order."""

    def moved(step: float) -> Array:
        parameters, start = ARM, START.copy()
        if name in STATE_NAMES:
            start[STATE_NAMES.index(name)] += step
        else:
            parameters = ARM.with_values({name: ARM.get(name) + step})
        return rollout(parameters, start, VOLTS, PAYLOAD, payload_model=payload_model)

    h = 1e-4 if name in STATE_NAMES else 1e-4 * ARM.get(name)
    d1, d2, d4 = ((moved(step) - moved(-step)) / (2 * step) for step in (h, 2 * h, 4 * h))
    return (16 * (4 * d1 - d2) / 3 - (4 * d2 - d4) / 3) / 15


@pytest.mark.parametrize("payload_model", ["point", "weight"])
def test_every_column_is_the_derivative_of_the_rollout(payload_model: PayloadModel) -> None:
    states, derivatives = sensitivities(
        ARM, START, VOLTS, PAYLOAD, with_respect_to=COLUMN_NAMES, payload_model=payload_model
    )
    assert np.abs(states - rollout(ARM, START, VOLTS, PAYLOAD, payload_model=payload_model)).max() < 1e-12
    assert derivatives.shape == (101, 6, 27)
    for column, name in enumerate(COLUMN_NAMES):
        expected = difference_quotient(name, payload_model)
        error = np.abs(derivatives[..., column] - expected).max()
        assert error <= 1e-7 * np.abs(expected).max(), name


def test_columns_come_in_the_order_asked() -> None:
    every = sensitivities(ARM, START, VOLTS, PAYLOAD, with_respect_to=COLUMN_NAMES)[1]
    names = ["omega2", "K3", "mu1", "l2"]
    some = sensitivities(ARM, START, VOLTS, PAYLOAD, with_respect_to=names)[1]
    picked = every[..., [COLUMN_NAMES.index(name) for name in names]]
    assert np.abs(some - picked).max() <= 1e-12 * np.abs(picked).max()
    assert sensitivities(ARM, START, VOLTS, with_respect_to=[])[1].shape == (101, 6, 0)


def test_friction_that_is_absent_still_has_its_derivative() -> None:
    nearly = DEFAULT.with_values({"mu2": 1e-10})
    absent = sensitivities(DEFAULT, START, VOLTS, with_respect_to=["mu2"])[1]
    present = sensitivities(nearly, START, VOLTS, with_respect_to=["mu2"])[1]
    assert np.abs(absent).max() > 1
    assert np.abs(absent - present).max() < 1e-6 * np.abs(absent).max()


def excited(payload: ArrayLike, payload_model: PayloadModel = "point") -> Array:
    """Derivatives of the angles by the 18 parameters, each times its parameter, as a matrix."""
    volts = 1.5 * np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], (35, 3)), 10, axis=0)
    derivatives = sensitivities(
        DEFAULT, np.zeros(6), volts, payload, with_respect_to=IDENTIFIED, payload_model=payload_model
    )[1]
    return derivatives[:, :3].reshape(-1, 18) * DEFAULT.vector()[:18]


def rank(matrix: Array) -> int:
    """Derivatives are exact, so what is not in the rank is rounding: 1e-15, far below the rest."""
    singular = np.linalg.svd(matrix, compute_uv=False)
    return int((singular > 1e-9 * singular[0]).sum())


def test_forces_and_masses_in_the_same_proportion_move_the_arm_alike() -> None:
    """K, m, I and D times one factor cancel without a payload."""
    common = np.array([name[0] in "KmID" for name in IDENTIFIED], dtype=float)
    empty, loaded = excited(0.0), excited(0.2)
    assert np.abs(empty @ common).max() < 1e-10 * np.abs(empty).max()
    assert np.abs(loaded @ common).max() > 1e-3 * np.abs(loaded).max()


@pytest.mark.parametrize(("payload_model", "loaded_rank"), [("point", 13), ("weight", 14)])
def test_parameters_that_a_run_can_tell_apart(payload_model: PayloadModel, loaded_rank: int) -> None:
    """Six moments, K, D, l1 and l2 are 14, less a common factor: 13.

    A point payload held throughout only shifts the moments; a weight shifts gravity alone and so sets the factor.
    Loaded and empty motion together, in one run or two, set the factor and l3.
    """
    empty, loaded = excited(0.0, payload_model), excited(0.2, payload_model)
    assert rank(empty) == 13
    assert rank(loaded) == loaded_rank
    assert rank(np.vstack((empty, loaded))) == 15
    assert rank(excited(np.repeat([0.0, 0.2], 175), payload_model)) == 15


def test_bad_input_is_named() -> None:
    with pytest.raises(ParameterError, match=r"unknown name 'K4' in with_respect_to: expected K1, K2, .* or omega3"):
        sensitivities(ARM, START, VOLTS, with_respect_to=["K4"])
    with pytest.raises(ParameterError, match="payload: expected at least 0 kg"):
        sensitivities(ARM, START, VOLTS, -1.0, with_respect_to=["K1"])
    with pytest.raises(DivergenceError, match="sensitivities of the analytic twin diverged at t = "):
        sensitivities(scaled(ARM, "D", 10.0), [0, 0, 0, 1, 1, 1], VOLTS, with_respect_to=["K1"])
