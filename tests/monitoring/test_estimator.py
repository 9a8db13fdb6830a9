"""The estimator against the twin it is built on, and on runs of the cell."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from dtwin.errors import ParameterError
from dtwin.logs.log import Log
from dtwin.monitoring.estimation.belief import Belief, assumed
from dtwin.monitoring.estimation.bounds import bounds
from dtwin.monitoring.estimation.estimator import Estimator
from dtwin.monitoring.estimation.layout import ARM_NAMES, BIAS, DRIFT, INDEX, MOVING, NAMES, PAYLOAD
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.offline import stream
from dtwin.parameters import ArmParameters
from dtwin.twin.rollout import rollout

ARM = ArmParameters()
STATE = np.array([-0.6, -1.5, 2.2, 0.8, -1.1, 0.6])
VOLTS = np.array([2.0, -1.0, 1.5])
ALL = np.ones(3, dtype=bool)


def at(state: np.ndarray, gripped: bool = False, arm: ArmParameters = ARM) -> Estimator:
    """An estimator that is certain of a state."""
    estimator = Estimator(assumed(arm, (1e-3, 1e-3, 1e-3)), Tuning())
    estimator.initialise(state[:3], gripped)
    estimator.x[:6] = state
    estimator.P[:] = 0.0
    return estimator


@pytest.mark.parametrize("gripped", [False, True])
def test_the_mean_follows_the_twin(gripped: bool) -> None:
    estimator = at(STATE, gripped)
    for _ in range(50):
        estimator.predict(VOLTS, gripped)
    expected = rollout(ARM, STATE, np.tile(VOLTS, (50, 1)), 0.2 if gripped else 0.0)[-1]
    np.testing.assert_allclose(estimator.x[:6], expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["K1", "K3", "D2", "mu1", "c2", "I3", "payload"])
def test_parameters_act_as_they_do_in_the_twin(name: str) -> None:
    """A step with a changed state is that of the twin with the changed parameter; F is its derivative."""
    size = 1e-4 * (0.2 if name == "payload" else ARM.get(name) or 0.01)
    estimator, changed = at(STATE, True), at(STATE, True)
    changed.x[INDEX[name]] += size
    estimator.predict(VOLTS, True)
    changed.predict(VOLTS, True)
    arm = ARM if name == "payload" else ARM.with_values({name: ARM.get(name) + size})
    payload = 0.2 + size if name == "payload" else 0.2
    expected = rollout(arm, STATE, VOLTS[None], payload)[-1]
    moved = changed.x[:6] - estimator.x[:6]
    np.testing.assert_allclose(changed.x[:6], expected, rtol=0, atol=1e-3 * np.abs(moved).max())
    np.testing.assert_allclose(moved, estimator.F[:, INDEX[name]] * size, rtol=1e-3, atol=1e-12)


def test_volts_beyond_the_limit_count_as_the_limit() -> None:
    first, second = at(STATE), at(STATE)
    first.predict(np.array([8.0, -8.0, 0.0]), False)
    second.predict(np.array([20.0, -9.0, 0.0]), False)
    np.testing.assert_array_equal(first.x, second.x)


def test_readings_draw_the_estimate_as_bayes_demands() -> None:
    """With an independent prior per joint, the correction is the precision-weighted mean."""
    estimator = at(STATE)
    prior, noise = 4e-6, 1e-6
    for i in range(3):
        estimator.P[i, i] = prior
    measured = STATE[:3] + np.array([1e-3, -2e-3, 0.0])
    likelihood = estimator.correct(measured, ALL)
    share = prior / (prior + noise)
    np.testing.assert_allclose(estimator.x[:3], STATE[:3] + share * np.array([1e-3, -2e-3, 0.0]))
    np.testing.assert_allclose(np.diag(estimator.P)[:3], prior * noise / (prior + noise))
    s = prior + noise
    expected = -0.5 * np.sum((measured - STATE[:3]) ** 2 / s + np.log(2 * np.pi * s))
    assert likelihood == pytest.approx(expected)


def test_unused_readings_change_nothing() -> None:
    estimator = at(STATE)
    estimator.P += np.eye(len(NAMES)) * 1e-6
    before = estimator.x.copy()
    assert estimator.correct(STATE[:3] + 1.0, np.zeros(3, dtype=bool)) == 0.0
    np.testing.assert_array_equal(estimator.x, before)


def test_a_new_box_has_the_prior_mass_and_an_empty_gripper_none(belief: Belief) -> None:
    estimator = Estimator(belief, Tuning())
    estimator.initialise(STATE[:3], False)
    assert estimator.x[PAYLOAD] == 0.0 == estimator.P[PAYLOAD, PAYLOAD]
    estimator.predict(VOLTS, True)
    assert estimator.x[PAYLOAD] == 0.2
    assert estimator.deviation("payload") == pytest.approx(Tuning().box_deviation)
    estimator.predict(VOLTS, False)
    assert estimator.x[PAYLOAD] == 0.0 == estimator.deviation("payload")


def test_a_box_is_expected_to_weigh_what_boxes_move_like_on_this_arm(belief: Belief) -> None:
    """The numbers of an arm that was identified without a box may share a factor, which boxes tell."""
    estimator = Estimator(replace(belief, load=0.9), Tuning())
    estimator.initialise(STATE[:3], False)
    estimator.predict(VOLTS, True)
    assert estimator.x[PAYLOAD] == pytest.approx(0.18)
    assert estimator.deviation("payload") == pytest.approx(0.9 * Tuning().box_deviation)
    with pytest.raises(ParameterError, match="load: expected a share above 0, got 0"):
        replace(belief, load=0.0)


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_locked_joint_stays_where_it_is(joint: int) -> None:
    estimator = at(STATE)
    estimator.lock(joint)
    for _ in range(30):
        estimator.predict(VOLTS, False)
    assert estimator.x[joint - 1] == STATE[joint - 1]
    assert estimator.x[2 + joint] == 0.0
    assert np.all(np.abs(np.delete(estimator.x[:3] - STATE[:3], joint - 1)) > 1e-3)
    assert np.linalg.eigvalsh(estimator.P).min() > -1e-12


def test_copies_are_independent(belief: Belief, run_cell: Callable[..., Log]) -> None:
    seen = stream(run_cell())
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], False)
    twin = estimator.copy()
    for k in range(1, 50):
        twin.predict(seen.volts[k - 1, :3], False)
        twin.correct(seen.measured[k], ALL)
    for k in range(1, 50):
        estimator.predict(seen.volts[k - 1, :3], False)
        estimator.correct(seen.measured[k], ALL)
    np.testing.assert_array_equal(estimator.x, twin.x)
    np.testing.assert_array_equal(estimator.P, twin.P)


def test_innovations_of_a_healthy_arm_are_white_and_the_truth_is_within_its_errors(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    log = run_cell()
    seen = stream(log)
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], bool(seen.gripped[0]))
    whitened, misses = [], []
    for k in range(1, len(seen)):
        estimator.predict(seen.volts[k - 1, :3], bool(seen.gripped[k - 1]))
        estimator.correct(seen.measured[k], ALL)
        whitened.append(estimator.innovation / np.sqrt(estimator.variance))
        deviation = np.sqrt(np.diag(estimator.P)[3:6])
        misses.append((estimator.x[3:6] - log.stack("omega")[k]) / deviation)
    z = np.array(whitened)[200:]
    assert np.all(np.abs(z.mean(axis=0)) < 5 / np.sqrt(len(z)))
    assert np.all((z**2).mean(axis=0) > 0.8)
    assert np.all((z**2).mean(axis=0) < 1.2)
    assert np.all(np.abs((z[1:] * z[:-1]).mean(axis=0)) < 5 / np.sqrt(len(z)))
    assert np.all(np.mean(np.abs(misses), axis=0) < 2.0)
    errors = [(estimator.x[INDEX[n]] - ARM.get(n)) / estimator.deviation(n) for n in ARM_NAMES if n[:2] != "mu"]
    assert np.max(np.abs(errors)) < 4.0
    assert np.abs(estimator.P - estimator.P.T).max() == 0.0


def test_bounds_keep_the_estimate_physical(belief: Belief) -> None:
    estimator = Estimator(belief, Tuning())
    estimator.initialise(STATE[:3], True)
    estimator.x[INDEX["K2"]], estimator.x[PAYLOAD] = -1.0, -3.0
    estimator.correct(STATE[:3], ALL)
    assert estimator.x[INDEX["K2"]] == 0.0
    assert estimator.x[PAYLOAD] == 0.0


def test_friction_that_cannot_be_moves_the_arm_like_the_nearest_that_can() -> None:
    """The estimate may pass the bounds until more is measured; the motion and what is told may not."""
    beyond, nearest = at(STATE), at(STATE)
    for estimator, damping, coulomb in ((beyond, 1.0, -0.01), (nearest, 0.92, 0.0)):
        estimator.x[INDEX["D1"]], estimator.x[INDEX["mu2"]] = damping, coulomb
        estimator.remember("D1")
        estimator.predict(VOLTS, False)
    np.testing.assert_array_equal(beyond.x[:6], nearest.x[:6])
    assert beyond.x[INDEX["D1"]] == 1.0
    change = beyond.change("D1")
    assert change is not None
    assert change.value == 0.92


def test_what_was_remembered_is_refined_as_an_augmented_filter_would(
    belief: Belief, run_cell: Callable[..., Log]
) -> None:
    """A clone's mean, variance and covariance are those of one more constant in a filter of one more state."""
    seen = stream(run_cell())
    estimator = Estimator(belief, Tuning())
    estimator.initialise(seen.measured[0], False)
    for k in range(1, 500):
        estimator.predict(seen.volts[k - 1, :3], bool(seen.gripped[k - 1]))
        estimator.correct(seen.measured[k], ALL)
    name, size = "K1", len(NAMES)
    index = INDEX[name]
    estimator.remember(name)
    assert estimator.change(name) == (estimator.x[index], estimator.x[index], 0.0)
    mean = float(estimator.x[index])
    P = np.pad(estimator.P, ((0, 1), (0, 1)))
    P[size], P[:, size] = P[index], P[:, index]
    P[size, size] = estimator.P[index, index]
    estimator.spread({name: 0.03})
    P[index, index] += 0.03**2
    for k in range(500, 600):
        estimator.predict(seen.volts[k - 1, :3], bool(seen.gripped[k - 1]))
        A = np.eye(size + 1)
        A[:6] = 0.0
        A[:6, :MOVING] = estimator.F
        for i in range(3):
            A[BIAS + i, DRIFT + i] = 0.01
        P = A @ P @ A.T
        x = estimator.x.copy()
        P[:size, :size] = estimator.P  # what the process adds to the states themselves is not in question here
        for i in range(3):
            h = np.zeros(size + 1)
            h[i] = h[BIAS + i] = 1.0
            s = h @ P @ h + belief.noise[i] ** 2
            gain = P @ h / s
            innovation = seen.measured[k, i] - x[i] - x[BIAS + i]
            x += gain[:size] * innovation
            mean += gain[size] * innovation
            P = P - np.outer(gain, h @ P)
        estimator.correct(seen.measured[k], ALL)
    change = estimator.change(name)
    assert change is not None
    assert change.before == pytest.approx(mean, rel=1e-9)
    assert change.deviation**2 == pytest.approx(P[index, index] - 2 * P[index, size] + P[size, size], rel=1e-6)
    assert change.before != estimator.x[index]
    estimator.forget(name)
    assert estimator.change(name) is None


def test_a_box_that_comes_is_compared_with_what_boxes_are(belief: Belief) -> None:
    estimator = Estimator(belief, Tuning())
    estimator.initialise(STATE[:3], False)
    estimator.remember("payload")
    estimator.predict(VOLTS, True)
    assert estimator.change("payload") == (0.2, 0.2, pytest.approx(Tuning().box_deviation))


def test_a_belief_with_coulomb_friction_is_followed() -> None:
    arm = replace(ARM, coulomb=(0.01, 0.008, 0.006))
    estimator = at(STATE, False, arm)
    for _ in range(20):
        estimator.predict(VOLTS, False)
    expected = rollout(arm, STATE, np.tile(VOLTS, (20, 1)))[-1]
    np.testing.assert_allclose(estimator.x[:6], expected, rtol=0, atol=1e-10)


def test_dry_friction_of_a_machine_may_grow_beyond_what_it_has() -> None:
    arm = ArmParameters(coulomb=(0.02, 0.03, 0.01))
    rigid, machine = bounds(arm, rigid=True)[1], bounds(arm, rigid=False)[1]
    for joint, own in enumerate(arm.coulomb, 1):
        assert rigid[INDEX[f"mu{joint}"]] == max(own, 0.015)
        assert machine[INDEX[f"mu{joint}"]] == 0.2
