"""The motion of an arm with effects against the twin with effects, and against the motion of one without."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dtwin.monitoring.candidate import Candidate
from dtwin.monitoring.estimation.belief import TIMING, Unmodelled, assumed
from dtwin.monitoring.estimation.estimator import HANDLING, Estimator
from dtwin.monitoring.estimation.layout import ARM, ARM_NAMES, INDEX, MOVING, PAYLOAD, SIZE, TORQUE, W
from dtwin.monitoring.estimation.motion import Array, MachineMotion, Motion, RigidMotion
from dtwin.monitoring.estimation.stepping import freed
from dtwin.monitoring.estimation.traces import STANDSTILL
from dtwin.monitoring.estimation.tuning import Tuning
from dtwin.monitoring.kinds import parse_fault_id, plausible_sizes
from dtwin.monitoring.signatures import Onset
from dtwin.monitoring.tracking.moments import Moment, rows_of
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.twin.effects import Effects
from dtwin.twin.machine import machine_rollout, vector_of
from tests.support.motion import carry

ARM_HERE = ArmParameters(coulomb=(0.01, 0.01, 0.01))
EFFECTS = Effects((1e-3,) * 3, (0.004,) * 3, (0.1,) * 3, (0.008,) * 3, delay=0.013, eccentric_sin=(0.003, 0.0, 0.0))
STATE = np.array([-0.6, -1.5, 2.2, 0.8, -1.1, 0.6])
VOLTS = np.random.default_rng(0).normal(0.0, 2.0, (12, 3))
SLIPPERY = Effects(rotor_inertia=(1e-9, 0.0, 0.0))


def states(arm: ArmParameters = ARM_HERE) -> Array:
    x = np.zeros(SIZE)
    x[:6], x[ARM:PAYLOAD], x[PAYLOAD] = STATE, [arm.get(name) for name in ARM_NAMES], 0.2
    return x


def carried(motion: Motion, x: Array, locked: int = 0) -> Array:
    """The state after all of VOLTS."""
    motion.reset()
    for volts in VOLTS:
        x[:6], _ = carry(motion, x, volts, True, locked)
    return x


def test_late_and_lagging_voltages_act_as_they_do_in_the_twin() -> None:
    expected = machine_rollout(vector_of(ARM_HERE, EFFECTS), STATE, VOLTS, np.full(len(VOLTS), 0.2))[0][-1]
    np.testing.assert_allclose(carried(MachineMotion(ARM_HERE, EFFECTS), states())[:6], expected, rtol=0, atol=1e-12)


def test_a_copy_goes_on_by_itself() -> None:
    motion, x = MachineMotion(ARM_HERE, EFFECTS), states()
    carried(motion, x)
    other = motion.copy()
    expected = carry(motion.copy(), x, VOLTS[0], True, 0)[0]
    carry(other, x, VOLTS[3], True, 0)
    np.testing.assert_array_equal(carry(motion, x, VOLTS[0], True, 0)[0], expected)


@pytest.mark.parametrize("name", ["theta", "omega", "torque", "payload"])
def test_derivatives_are_those_of_the_map(name: str) -> None:
    index = {"theta": 1, "omega": 4, "torque": TORQUE + 1, "payload": PAYLOAD}[name]
    motion, x = MachineMotion(ARM_HERE, EFFECTS), states()
    begun, F = carry(motion.copy(), x, VOLTS[0], True, 0)
    x[index] += 1e-4
    np.testing.assert_allclose((carry(motion, x, VOLTS[0], True, 0)[0] - begun) / 1e-4, F[:, index], rtol=2e-3)


@pytest.mark.parametrize("name", ["K1", "K2", "D2", "D3", "torque2", "payload"])
def test_without_effects_derivatives_are_those_of_the_equations_of_motion(name: str) -> None:
    arm, index = ArmParameters(), INDEX[name]
    ours = carry(MachineMotion(arm, SLIPPERY), states(arm), VOLTS[0], True, 0)[1][3:, index]
    exact = carry(RigidMotion(arm), states(arm), VOLTS[0], True, 0)[1][3:, index]
    np.testing.assert_allclose(ours, exact, rtol=0, atol=0.1 * np.abs(exact).max())


def test_a_box_that_is_not_held_moves_nothing() -> None:
    x = states()
    x[PAYLOAD] = 0.0
    for motion in (MachineMotion(ARM_HERE, EFFECTS), RigidMotion(ARM_HERE)):
        assert not carry(motion, x, VOLTS[0], False, 0)[1][:, PAYLOAD].any()


@pytest.mark.parametrize("joint", [1, 2, 3])
def test_a_locked_joint_stays_where_it_is(joint: int) -> None:
    x = carried(MachineMotion(ARM_HERE, EFFECTS), states(), joint)
    assert x[joint - 1] == STATE[joint - 1]
    assert x[2 + joint] == 0.0
    assert np.all(np.abs(np.delete(x[:3] - STATE[:3], joint - 1)) > 1e-3)


def test_eccentric_encoders_are_expected() -> None:
    belief = replace(assumed(ARM_HERE, (1e-3, 1e-3, 1e-3)), effects=EFFECTS)
    estimator = Estimator(belief, Tuning())
    readings = STATE[:3] + np.array([0.003 * np.sin(STATE[0]), 0.0, 0.0])
    estimator.initialise(readings, False)
    np.testing.assert_allclose(estimator.x[:3], STATE[:3], rtol=0, atol=1e-5)
    np.testing.assert_allclose(estimator.expected()[0], readings, rtol=0, atol=1e-5)


def test_torques_that_last_fade_and_come_back_as_often_as_stated() -> None:
    """The variance of a Gauss-Markov process that nobody measures stays what it is; a known torque fades."""
    error = Unmodelled(slow=(0.02, 0.01, 0.03), memory=0.2)
    estimator = Estimator(replace(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)), error=error), Tuning())
    estimator.initialise(STATE[:3], False)
    estimator.x[TORQUE] = 0.05
    for _ in range(20):
        estimator.predict(VOLTS[0], False)
    assert estimator.x[TORQUE] == pytest.approx(0.05 * np.exp(-20 * PERIOD / error.memory))
    np.testing.assert_allclose(estimator.P.diagonal()[TORQUE:MOVING], np.square(error.slow), rtol=0.01)


def test_the_motion_is_in_doubt_while_a_box_comes_or_goes() -> None:
    """A torque of 1 N m more or less for a sample changes speeds by its derivative, in as many samples as stated."""
    belief = replace(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)), error=Unmodelled(grip=1.0))
    estimator = Estimator(belief, Tuning())
    estimator.initialise(STATE[:3], False)
    grown = []
    for _ in range(HANDLING + 2):
        estimator.P[:] = 0.0
        estimator.predict(VOLTS[0], True)
        grown.append(estimator.deviation("w2") / np.linalg.norm(estimator.F[4, TORQUE:MOVING]))
    np.testing.assert_allclose(grown[:HANDLING], 1.0, rtol=1e-3)
    assert max(grown[HANDLING:]) < 0.01


@pytest.mark.parametrize("lost", [False, True])
def test_a_box_that_has_gone_may_still_touch_a_finger_for_a_second(lost: bool) -> None:
    """A tenth of what is in doubt while it is handled, or slips, stays in doubt until the arm has left it."""
    belief = replace(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)), error=Unmodelled(grip=1.0))
    estimator = Estimator(belief, Tuning())
    estimator.initialise(STATE[:3], True)
    if lost:
        for _ in range(HANDLING):
            estimator.predict(VOLTS[0], True)
        estimator.lose("payload")
    grown = []
    for _ in range(102):
        estimator.P[:] = 0.0
        estimator.predict(VOLTS[0], lost)
        grown.append(estimator.deviation("w2") / np.linalg.norm(estimator.F[4, TORQUE:MOVING]))
    np.testing.assert_allclose(grown[:HANDLING], 1.0, rtol=1e-3)
    np.testing.assert_allclose(grown[HANDLING:100], 0.1, rtol=1e-2)
    assert max(grown[100:]) < 0.01


@pytest.mark.parametrize("speed", [0.0, 0.1, 2.0])
def test_near_standstill_nobody_knows_how_much_dry_friction_acts(speed: float) -> None:
    """It may be anything up to its level, 30 mN m here: a torque in doubt that fades as the joint gets faster."""
    belief = assumed(ArmParameters().with_values({"mu2": 0.02}), (1e-3, 1e-3, 1e-3))
    estimator = Estimator(replace(belief, effects=Effects(stiction=(0.0, 0.01, 0.0))), Tuning())
    estimator.initialise(STATE[:3], False)
    estimator.x[W:ARM], estimator.P[:] = speed, 0.0
    estimator.predict(VOLTS[0], False)
    torque = np.array([0.0, 0.03, 0.0]) * np.exp(-0.5 * (estimator.x[W + 1] / 0.05) ** 2)
    slopes = estimator.F[W + 1, TORQUE:MOVING]
    expected = np.sum(np.square(slopes) * (np.square(torque) + np.square(belief.error.white)))
    assert estimator.deviation("w2") == pytest.approx(np.sqrt(expected), rel=1e-6)


@pytest.mark.parametrize("deviation", [0.02, 0.2, 2.0])
def test_dry_friction_tells_the_speed_of_a_joint_no_faster_than_it_can_slow_one(deviation: float) -> None:
    """A joint that friction holds counts as standing, but one that may move takes time, and a box may push it on."""
    belief = assumed(ArmParameters().with_values({"mu2": 0.1}), (1e-3, 1e-3, 1e-3))
    estimator = Estimator(replace(belief, effects=Effects(stiction=(0.0, 0.05, 0.0))), Tuning())
    estimator.initialise(np.array([-np.pi / 2, 0.0, 0.0]), False)  # it hangs
    kept = []
    for _ in range(HANDLING + 3):
        estimator.x[W:ARM], estimator.P[:] = 0.0, 0.0
        estimator.P[W + 1, W + 1] = deviation**2
        estimator.predict(np.zeros(3), True)
        kept.append(math.sqrt(estimator.P[W + 1, W + 1]))
    assert min(kept[:HANDLING]) >= deviation * (1.0 - 1e-12)
    if deviation > STANDSTILL:
        np.testing.assert_allclose(kept[HANDLING:], deviation - STANDSTILL, rtol=0.01)
    else:
        assert max(kept[HANDLING:]) < 0.8 * deviation


def test_play_moves_an_angle_without_any_torque() -> None:
    belief = replace(
        assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)), error=Unmodelled((0.0, 0.0, 0.0), displacement=5e-4)
    )
    estimator = Estimator(belief, Tuning())
    estimator.initialise(STATE[:3], False)
    estimator.P[:] = 0.0
    estimator.predict(VOLTS[0], False)
    np.testing.assert_allclose(estimator.P, 25e-8 * np.diag([*np.ones(3), *np.zeros(SIZE - 3)]), atol=1e-8)


def test_a_gear_that_yields_swings_after_a_jump_of_the_torque_and_settles() -> None:
    """A jump of V volts swings a joint by compliance K V; after 0.1 s a share of 1/e is left."""
    error = Unmodelled((0.0, 0.0, 0.0), compliance=(0.02, 0.02, 0.02))
    belief = replace(assumed(ArmParameters(), (1e-3, 1e-3, 1e-3)), error=error)
    estimator = Estimator(belief, Tuning())
    estimator.initialise(np.zeros(3), False)
    estimator.predict(np.zeros(3), False)
    swung = []
    for _ in range(11):
        estimator.P[:] = 0.0
        estimator.predict(np.array([0.0, 3.0, 0.0]), False)
        swung.append(estimator.deviation("q2"))
    assert swung[0] == pytest.approx(0.02 * 3.0 * ArmParameters().get("K2"), rel=1e-3)
    assert swung[10] == pytest.approx(swung[0] / np.e, rel=1e-3)
    assert estimator.deviation("q1") < 1e-3 * swung[0]


def test_when_a_voltage_changes_is_in_doubt_and_a_constant_one_is_not() -> None:
    """A jump of V volts that comes a time too late lacks K V for that share of a sample; it shows in two halves."""
    error = Unmodelled((0.0, 0.0, 0.0), timing=TIMING)
    belief = replace(assumed(ArmParameters(), (1e-3,) * 3), effects=Effects(delay=PERIOD), error=error)
    estimator = Estimator(belief, Tuning())
    estimator.initialise(np.array([-np.pi / 2, 0.0, 0.0]), False)
    estimator.predict(np.zeros(3), False)
    found = []
    for _ in range(4):
        estimator.P[:] = 0.0
        estimator.predict(np.array([0.0, 3.0, 0.0]), False)
        found.append(estimator.deviation("w2") / abs(estimator.F[W + 1, TORQUE + 1]))
    late = 3.0 * ArmParameters().get("K2") * TIMING / PERIOD
    np.testing.assert_allclose(found, [0.0, late / 2, late / 2, 0.0], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(("volts", "news"), [(0.3, False), (3.0, True)])
def test_that_a_joint_rests_tells_of_a_lock_only_where_friction_would_not_hold_it(volts: float, news: bool) -> None:
    belief = assumed(ArmParameters().with_values({"mu2": 0.1}), (1e-3,) * 3)
    estimator = Estimator(replace(belief, effects=SLIPPERY), Tuning())
    hanging, command = np.array([-np.pi / 2, 0.0, 0.0]), np.array([0.0, volts, 0.0])
    estimator.initialise(hanging, False)
    estimator.x[W:ARM] = 0.0
    locked = Candidate(parse_fault_id("lock2"), Onset(0, 1, estimator), plausible_sizes(belief.arm))
    assert (abs(freed(estimator.arrays(), estimator.motion_arrays(), 1, command)) > STANDSTILL) == news
    every = np.ones(3, dtype=bool)
    locked.follow(rows_of([Moment(command, False, 0.0, hanging, every, every, True, -1000.0)]))
    assert (locked.gain > 0.0) == news
