import numpy as np
import pytest
from hypothesis import given

from dtwin.parameters import ArmParameters
from dtwin.twin.dynamics import inverse_dynamics
from dtwin.twin.regressor import BASE_NAMES, base_parameters, regressor
from tests.support.arms import DEFAULT, Array, accelerations, angles, arms, payloads, vector, velocities


@given(arms, payloads, angles, velocities, accelerations)
def test_regressor_times_base_parameters_is_the_torque(
    parameters: ArmParameters, payload: float, q: Array, w: Array, a: Array
) -> None:
    Y = regressor(q, w, a, parameters.length)
    pi = base_parameters(parameters, payload)
    torque = inverse_dynamics(q, w, a, vector(parameters), payload)
    # Terms cancel: rounding is relative to the largest of them.
    assert np.abs(Y @ pi - torque).max() <= 1e-13 * (np.abs(Y) @ np.abs(pi)).max() + 1e-15


def test_base_parameters_are_minimal_and_a_stack_of_samples_is_one_call() -> None:
    rng = np.random.default_rng(0)
    q, w, a = rng.normal(size=(3, 200, 3))
    Y = regressor(q, w, a, DEFAULT.length)
    assert Y.shape == (200, 3, len(BASE_NAMES))
    assert Y[7] == pytest.approx(regressor(q[7], w[7], a[7], DEFAULT.length))
    singular = np.linalg.svd(Y.reshape(-1, len(BASE_NAMES)), compute_uv=False)
    assert singular[-1] > 1e-4 * singular[0]


def test_torque_samples_identify_the_base_parameters() -> None:
    rng = np.random.default_rng(1)
    parameters = DEFAULT.with_values({"mu1": 0.01, "mu2": 0.02, "mu3": 0.03})
    q, w, a = rng.normal(size=(3, 50, 3))
    torque = np.array([inverse_dynamics(*sample, vector(parameters), 0.2) for sample in zip(q, w, a, strict=True)])
    Y = regressor(q, w, a, parameters.length).reshape(-1, len(BASE_NAMES))
    solution = np.linalg.lstsq(Y, torque.ravel(), rcond=None)[0]
    assert solution == pytest.approx(base_parameters(parameters, 0.2), rel=1e-10)
