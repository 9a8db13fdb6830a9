"""LAW 2 of COMPUTED_TORQUE_CONTROL_3 and STATE_OBSERVER_3: the cascade against the equations of the analytic twin."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.settings import USUAL_GAINS
from dtwin.parameters import ArmParameters
from dtwin.twin.dynamics import coriolis, gravity, mass_matrix
from tests.support.driven import Array, Driven, step, triple

TS = 0.01
ARM = ArmParameters()
P = np.array(ARM.vector())
K, D = np.array(ARM.voltage_constant), np.array(ARM.damping)
KP, KI, KD = (np.array(getattr(USUAL_GAINS["cascade"], name)) for name in ("kp", "ki", "kd"))
LIMIT = 8.0


def cascade(payload: float = 0.0, **inputs: object) -> Driven:
    block = Driven("COMPUTED_TORQUE_CONTROL_3")
    block.fire("GAINS", **triple("KP", KP), **triple("KI", KI), **triple("KD", KD))
    block.fire("RESET", LAW=2, GRIPPED=payload > 0, PAYLOAD_MASS=payload, **inputs)
    return block


def fire(block: Driven, theta: Array, omega: Array, path: tuple[Array, Array, Array], lead: float = 0.0) -> Array:
    named = {**triple("THETA_E", theta), **triple("OMEGA_E", omega), **triple("THETA", theta)}
    for name, values in zip(("THETA_D", "OMEGA_D", "ALPHA_D"), path, strict=True):
        named |= triple(name, values)
    assert block.fire("REQ", **named, LEAD=lead) == ["CNF"]
    return block.triple("V")


def rest(theta: Array) -> tuple[Array, Array, Array]:
    return theta, np.zeros(3), np.zeros(3)


@given(seed=st.integers(0, 2**32 - 1), payload=st.sampled_from([0.0, 0.2]), lead=st.sampled_from([0.0, 0.01]))
def test_voltages_and_expected_accelerations_follow_the_law(seed: int, payload: float, lead: float) -> None:
    generator = np.random.default_rng(seed)
    block = cascade(payload)
    integral = np.zeros(3)
    for _ in range(4):
        q, w, a = generator.uniform(-4, 4, 3), generator.normal(0, 0.5, 3), generator.normal(0, 1, 3)
        theta, omega = q + generator.normal(0, 2e-4, 3), w + generator.normal(0, 2e-3, 3)
        error = q + lead * w + lead**2 / 2 * a - theta
        slower = w + lead * a - omega
        integral = integral + TS * KI * error
        wanted = KP * error + integral + KD * slower
        later, faster = q + TS / 2 * w + TS**2 / 8 * a, w + TS / 2 * a
        M = mass_matrix(later, P, payload)
        torque = M @ (a + wanted) + coriolis(later, faster, P, payload) + gravity(later, P, payload)
        torque = torque + D * (faster + (KP * error + integral) / KD)
        volts = fire(block, theta, omega, (q, w, a), lead)
        if np.abs(torque / K).max() > LIMIT:
            return
        np.testing.assert_allclose(volts, torque / K, rtol=1e-10, atol=1e-10)
        known = M @ (KP * error + KD * slower) + D * (KP * error / KD + slower)
        expected = a + np.linalg.solve(M + TS * np.diag(D), known)
        np.testing.assert_allclose(block.triple("ALPHA"), expected, rtol=1e-8, atol=1e-8)


def test_the_arm_in_small_steps_moves_as_the_controller_expects() -> None:
    """One tick of the true arm: the velocity changes by what ALPHA says, to the linear order of the implicit step."""
    theta = np.array([0.4, -0.8, 0.6])
    block = cascade()
    volts = fire(block, theta - np.array([1e-3, 0.0, 0.0]), np.zeros(3), rest(theta))
    after = step(np.array([*(theta - np.array([1e-3, 0.0, 0.0])), 0.0, 0.0, 0.0]), volts.tolist())
    expected = TS * block.triple("ALPHA")
    np.testing.assert_allclose(after[3:], expected, rtol=0.35, atol=2e-3)


def test_a_new_path_moves_no_voltage() -> None:
    """The error that is left when a path starts anew at the measured angles goes over into the integrals."""
    theta = np.array([0.4, -0.8, 0.6])
    off = theta + np.array([0.003, -0.002, 0.004])
    block = cascade()
    for _ in range(20):
        before = fire(block, off, np.zeros(3), rest(theta))
    block.fire("RESET")
    after = fire(block, off, np.zeros(3), rest(off))
    model = (gravity(off, P) - gravity(theta, P)) / K
    held = (block.triple("SUM") @ mass_matrix(off, P) - block.triple("SUM") @ mass_matrix(theta, P)) / K
    # The step that the integrals made in the last tick is all that differs, beside the pose of the model.
    np.testing.assert_allclose(after - before - model - held, 0.0, atol=0.06)
    assert np.abs(after - gravity(off, P) / K).min() > 0.1


def test_what_the_integrals_balanced_another_model_knows() -> None:
    """A motor that has lost torque is held by its integral, which the model with that lost torque must not add to."""
    theta = np.array([0.4, -0.8, 0.6])
    block = cascade()
    for _ in range(100):
        held = fire(block, theta - 0.01, np.zeros(3), rest(theta))
    weak = ARM.with_values({"K3": 0.35 * ARM.get("K3")})
    block.fire("MODEL", K3=weak.get("K3"))
    after = fire(block, theta, np.zeros(3), rest(theta))
    np.testing.assert_allclose(after, gravity(theta, P) / np.array(weak.voltage_constant), rtol=1e-12)
    assert held[2] / 0.35 > after[2] + 0.5, "with the integral it would be that much more"


def test_an_arm_that_others_move_leaves_no_integrals() -> None:
    theta = np.zeros(3)
    block = cascade()
    for _ in range(20):
        fire(block, theta + 0.01, np.zeros(3), rest(theta))
    assert np.abs(block.triple("SUM")).min() > 1.0
    block.fire("RESET", HELD=True)
    assert block.triple("SUM").tolist() == [0.0, 0.0, 0.0]
    fire(block, theta + 0.01, np.zeros(3), rest(theta))
    assert block.triple("ALPHA").tolist() == [0.0, 0.0, 0.0]
    fire(block, theta + 0.01, np.zeros(3), rest(theta))
    assert np.abs(block.triple("ALPHA")).min() > 0.1, "it is driven again, and the observer has to know"


def test_integrals_stay_bounded_at_the_voltage_limit() -> None:
    """An arm that hangs half a radian off for 20 s: the integrals settle at a part of what they would come to."""
    theta = np.array([0.4, -0.8, 0.6])
    block = cascade()
    sizes = []
    for _ in range(2000):
        volts = fire(block, theta - np.array([0.5, 0.0, 0.0]), np.zeros(3), rest(theta))
        sizes.append(np.abs(block.triple("SUM")).max())
    assert volts[0] == LIMIT
    assert sizes[-1] == pytest.approx(sizes[-100], rel=1e-3)
    assert sizes[-1] < 0.05 * 20.0 * KI[0] * 0.5


def test_an_error_of_position_beyond_a_tenth_of_a_radian_asks_for_no_more_speed() -> None:
    """However far a reading says that the arm is away, it is driven no faster than by Kp / Kd times 0.1 rad."""
    theta, joint = np.array([0.4, -0.8, 0.6]), np.array([0.0, 0.0, 1.0])
    half, limit, far = (fire(cascade(), theta - off * joint, np.zeros(3), rest(theta)) for off in (0.05, 0.1, 0.5))
    np.testing.assert_allclose(far, limit, atol=1e-9)
    assert limit[2] - half[2] > 0.5


def test_friction_and_dead_zone_are_compensated() -> None:
    theta, omega = np.zeros(3), np.array([1.0, -1.0, 0.01])
    path = (theta, omega, np.zeros(3))
    plain = fire(cascade(), theta, omega, path)
    rough = cascade()
    rough.fire("MODEL", MU1=0.03, MU2=0.03, MU3=0.03)
    np.testing.assert_allclose(fire(rough, theta, omega, path) - plain, [0.03 / K[0], -0.03 / K[1], 0.006 / K[2]])
    numb = fire(cascade(DEAD_ZONE=0.3), theta, omega, path)
    np.testing.assert_allclose(numb - plain, 0.3 * np.clip(10.0 * plain, -1.0, 1.0), atol=1e-12)


def test_distance_and_speed_are_told_to_the_safe_stop() -> None:
    block = cascade()
    fire(block, np.array([0.1, -0.2, 0.0]), np.array([1.0, -3.0, 2.0]), rest(np.zeros(3)))
    assert block["FOLLOWING"] == pytest.approx(0.2)
    assert block["SPEED"] == 3.0


def observe(block: Driven, theta: Array, alpha: Array) -> None:
    assert block.fire("REQ", **triple("THETA", theta), **triple("ALPHA", alpha)) == ["CNF"]


def test_errors_of_the_observer_vanish_with_its_bandwidth() -> None:
    """A double pole at BANDWIDTH: at rest an error of the velocity decays like (1 + c k) exp(-BANDWIDTH k Ts)."""
    block = Driven("STATE_OBSERVER_3", BANDWIDTH=50.0, DELAY=0.0)
    observe(block, np.zeros(3), np.zeros(3))
    block.resource.write("DUT.OM1", 1.0)
    errors = []
    for _ in range(40):
        observe(block, np.zeros(3), np.zeros(3))
        errors.append(block["OMEGA_E1"])
    pole = math.exp(-0.5)
    k = np.arange(1, 41)
    first, second = np.linalg.lstsq(np.column_stack((pole**k, k * pole**k)), np.array(errors), rcond=None)[0]
    np.testing.assert_allclose(errors, (first + second * k) * pole**k, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0, 0.005, 0.01])
def test_the_observer_predicts_a_known_acceleration_exactly(delay: float) -> None:
    """Accelerations that the controller expected act DELAY after the sample; angle and velocity are those then."""
    generator = np.random.default_rng(3)
    block = Driven("STATE_OBSERVER_3", BANDWIDTH=150.0, DELAY=delay)
    theta, omega = generator.normal(0, 1, 3), np.zeros(3)
    before, expected = np.zeros(3), np.zeros(3)
    observe(block, theta, expected)
    for _ in range(60):
        before, expected = expected, generator.normal(0, 3, 3)
        for alpha, time in ((before, delay), (expected, TS - delay)):
            theta, omega = theta + time * omega + time**2 / 2 * alpha, omega + time * alpha
        observe(block, theta, expected)
    ahead = theta + delay * omega + delay**2 / 2 * expected
    # Within a tick the observer takes the mean of the accelerations, whose order moves an angle by their difference.
    slack = 1e-12 + 12.0 * delay * (TS - delay)
    np.testing.assert_allclose(block.triple("OMEGA_E"), omega + delay * expected, atol=1e-9 + 200 * slack)
    np.testing.assert_allclose(block.triple("THETA_E"), ahead, atol=1e-9 + 200 * slack * TS)


def test_the_observer_begins_anew_at_rest() -> None:
    block = Driven("STATE_OBSERVER_3", BANDWIDTH=150.0, DELAY=0.01)
    for k in range(10):
        observe(block, np.full(3, 0.05 * k), np.zeros(3))
    assert block["OMEGA_E1"] == pytest.approx(5.0, rel=0.01)
    block.fire("INIT")
    observe(block, np.full(3, 2.0), np.zeros(3))
    assert block.triple("OMEGA_E").tolist() == [0.0, 0.0, 0.0]
    assert block.triple("THETA_E").tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize("lost", [1, 3])
def test_a_sample_that_comes_again_does_not_slow_the_observed_arm(lost: int) -> None:
    """It was taken for an arm that stands all at once: motors got their whole voltage, and the arm was stopped."""
    speed, code = np.array([2.2, 2.0, -3.1]), math.tau / 2**14
    block = Driven("STATE_OBSERVER_3", GATE=0.08)
    theta = [code * np.round((speed * TS * k) / code) for k in range(60)]
    for reading in theta[:30]:
        observe(block, reading, np.zeros(3))
    for k in range(30, 30 + lost):
        observe(block, theta[29], np.zeros(3))
        np.testing.assert_allclose(block.triple("ANGLE"), speed * TS * k, atol=0.005)
    for k in range(30 + lost, 60):
        observe(block, theta[k], np.zeros(3))
        np.testing.assert_allclose(block.triple("OMEGA_E"), speed, atol=0.1)
    assert block["DOUBT"] <= lost


def test_a_coarse_encoder_that_happened_to_repeat_nothing_is_believed_at_rest() -> None:
    """After twenty turns of the noise without a repeated code each repeated one was doubted, and stopped an arm."""
    block = Driven("STATE_OBSERVER_3", GATE=0.08)
    for k in range(40):
        observe(block, np.full(3, 2e-4 * (k % 2)), np.zeros(3))
    for _ in range(20):
        observe(block, np.full(3, 2e-4), np.zeros(3))
    assert block["DOUBT"] == 0.0


def pulled(block: Driven, effort: float, joint: int = 1) -> None:
    """One sample at rest that repeats the reading while the feedback pulls at a joint."""
    assert block.fire("REQ", **triple("THETA", np.zeros(3)), **{f"EFFORT{joint}": effort}) == ["CNF"]


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_reading_that_stays_although_more_pulls_than_its_drive_holds_is_not_believed(joint: int) -> None:
    """Of an arm that is not known the whole torque has to pull, of a known one its share."""
    for share, doubted in ((0.4, True), (1.0, False)):
        block = Driven("STATE_OBSERVER_3", GATE=0.08, **{f"PULL{joint}": share})
        for k in range(40):
            pulled(block, 0.01 * k, joint)
        assert block[f"SIGHT{joint}"] == 0
        for _ in range(20):
            pulled(block, 0.6, joint)
        assert (block[f"SIGHT{joint}"], block["DOUBT"]) == ((-1, 20.0) if doubted else (0, 0.0))


def test_what_a_stopped_reading_has_asked_for_is_taken_back() -> None:
    """The integral of an error that stays drove an arm whose encoder had stopped at rest, also after its stop."""
    theta = np.array([0.4, -0.8, 0.6])
    block = cascade()
    for _ in range(10):
        fire(block, theta - 0.001, np.zeros(3), rest(theta))
    before = block.triple("SUM")
    block.fire("REQ", SIGHT1=0, SIGHT2=0, SIGHT3=0)
    for _ in range(100):
        fire(block, theta - 0.001, np.zeros(3), rest(theta))
    np.testing.assert_allclose(block.triple("SUM"), before + 1.01 * KI * 0.001, rtol=1e-9)
    block.fire("REQ", SIGHT2=-1)
    kept = block.triple("SUM")
    assert kept[1] == pytest.approx(before[1], rel=1e-9)
    assert kept[0] > 2.0 * before[0]
    assert kept[2] > 2.0 * before[2]
    block.fire("REQ", SIGHT2=1)
    assert block["SUM2"] == pytest.approx(kept[1] + 0.01 * KI[1] * 0.001, rel=1e-9), (
        "it goes on when it is seen again"
    )


@pytest.mark.parametrize(("joint", "sight"), [(1, (-1, 1, 1)), (2, (1, -1, 1))])
def test_a_joint_that_nobody_sees_is_given_inertia_by_what_the_joints_beyond_feel(
    joint: int, sight: tuple[int, ...]
) -> None:
    """Its voltage differs from that of the law by 0.6 (joint 1) or 0.3 of what its acceleration takes, no more."""
    theta = np.array([0.4, -0.8, 0.6])
    block, free = cascade(), cascade()
    for each in (block, free):
        fire(each, theta, np.zeros(3), rest(theta))
    block.fire("REQ", **{f"SIGHT{k}": one for k, one in enumerate(sight, 1)})
    free.fire("REQ", **{f"SIGHT{k}": max(one, 0) for k, one in enumerate(sight, 1)})
    np.testing.assert_array_equal(block.triple("V"), free.triple("V"))
    torque = np.array([0.3 + 7.0 * block["M11"], 0.3 + 7.0 * block["M22"], 0.3 + 7.0 * block["J33"]])
    before = block.triple("EFFORT") * torque
    for size in (0.0002, 0.08):
        off = theta - np.array([0.0, 0.0, size])
        added = (fire(block, off, np.zeros(3), rest(theta)) - fire(free, off, np.zeros(3), rest(theta))) * K
        felt = block.triple("EFFORT") * torque - before
        felt -= np.clip(felt, -0.05, 0.05)
        column = np.array([block["M11"], block["M21"], block["M31"]])
        if joint == 2:
            column = np.array([0.0, block["M22"], block["M32"]])
        beyond, own = column[joint:], column[joint - 1]
        expected = np.zeros(3)
        braking = {1: 0.6, 2: 0.3}[joint] * own * beyond @ felt[joint:] / (beyond @ beyond + 0.01 * own**2)
        expected[joint - 1] = -np.clip(braking, -0.25, 0.25)
        np.testing.assert_allclose(added, expected, rtol=1e-9, atol=1e-12)
        assert (added[joint - 1] != 0.0) == (size > 0.01), "friction may hold what is less"


def test_what_the_joints_beyond_feel_is_forgotten_when_a_path_begins_or_the_joint_is_seen() -> None:
    theta = np.array([0.4, -0.8, 0.6])
    for event, inputs in (("RESET", {}), ("REQ", {"SIGHT1": 1})):
        block = cascade()
        block.fire("REQ", SIGHT1=-1, SIGHT2=1, SIGHT3=1)
        assert block["UNSEEN"]
        block.fire(event, **inputs)
        assert not block["UNSEEN"]
    block = cascade()
    for _ in range(2):
        block.fire("REQ", SIGHT1=-1, SIGHT2=1, SIGHT3=-1)
        assert not block["UNSEEN"], "what moves more than one joint is not known"
    assert fire(block, theta, np.zeros(3), rest(theta)).shape == (3,)
