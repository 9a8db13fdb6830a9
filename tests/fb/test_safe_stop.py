"""The safe stop: SAFE_STOP decides, PATH_PLANNER brakes, DATA_SELECTOR takes the torque off; and all of them in the
application."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.parameters import PLACES, ArmParameters
from dtwin.twin.rollout import rollout
from tests.support.driven import JOINTS, THESIS, Application, Array, Driven, to, triple

NONE, BRAKING, STANDSTILL, TORQUE_OFF = range(4)
NOMINAL, DEGRADING, FAILED, UNKNOWN = range(4)
BRAKING_SAMPLES = 40
LASTING = 8
"""Samples in a row after which an arm is off its path or too fast: more than those after which the bridge knows of an
arm without voltage."""
LOOSE_SAMPLES = 30
"""Samples that a standing arm may be far from where it shall be: one that is pushed comes back."""
VERDICT = "TWIN.MONITORING.VERDICT"


def decision(stop: int) -> Driven:
    """The block, in which a stop is in force."""
    block = Driven("SAFE_STOP")
    if stop != NONE:
        block.fire("VERDICT", STATE=UNKNOWN if stop == TORQUE_OFF else FAILED, CONFIDENCE=1.0)
    if stop == STANDSTILL:
        for _ in range(BRAKING_SAMPLES):
            block.fire("REQ", AWAY=0.0)
    assert block["STOP"] == stop
    return block


@given(
    st.integers(-1, 4),
    st.floats(0, 1) | st.just(float("nan")),
    st.floats(0.5, 1),
    st.booleans(),
    st.integers(NONE, TORQUE_OFF),
)
def test_what_a_verdict_does(state: int, confidence: float, limit: float, release: bool, before: int) -> None:
    block = decision(before)
    block.resource.write("DUT.CONFIDENCE_LIMIT", limit)
    assert block.fire("VERDICT", STATE=state, CONFIDENCE=confidence, RELEASE=release) == ["HALT", "ANSWER"]
    sure = confidence >= limit
    if state == UNKNOWN and sure:
        expected = TORQUE_OFF
    elif state == FAILED and sure:
        expected = max(before, BRAKING)
    elif release and before != BRAKING:
        expected = NONE
    else:
        expected = before
    assert block["STOP"] == expected


def test_an_arm_that_stays_where_it_shall_is_held_for_ever() -> None:
    block = decision(BRAKING)
    for sample in range(1, 300):
        assert block.fire("REQ", AWAY=0.25) == ["HALT"]
        assert block["STOP"] == (BRAKING if sample < BRAKING_SAMPLES else STANDSTILL)


@pytest.mark.parametrize("away", [0.2501, float("inf"), float("nan")])
def test_an_arm_that_does_not_stand_loses_its_torque(away: float) -> None:
    block = decision(BRAKING)
    for _ in range(BRAKING_SAMPLES - 1):
        block.fire("REQ", AWAY=away)
        assert block["STOP"] == BRAKING
    for _ in range(LOOSE_SAMPLES - 1):
        block.fire("REQ", AWAY=away)
        assert block["STOP"] == STANDSTILL
    block.fire("REQ", AWAY=away)
    assert block["STOP"] == TORQUE_OFF
    block.fire("REQ", AWAY=0.0)
    assert block["STOP"] == TORQUE_OFF


def test_an_arm_that_was_pushed_away_and_comes_back_keeps_its_torque() -> None:
    block = decision(STANDSTILL)
    for _ in range(3):
        for _ in range(LOOSE_SAMPLES - 1):
            block.fire("REQ", AWAY=0.4)
        block.fire("REQ", AWAY=0.1)
    assert block["STOP"] == STANDSTILL


@pytest.mark.parametrize(("following", "speed"), [(0.51, 0.0), (0.0, 2.6), (float("nan"), 0.0), (0.0, float("nan"))])
@pytest.mark.parametrize("before", [NONE, BRAKING, STANDSTILL, TORQUE_OFF])
def test_an_arm_that_stays_off_its_path_or_too_fast_is_stopped(following: float, speed: float, before: int) -> None:
    block = decision(before)
    for _ in range(3):
        for _ in range(LASTING - 1):
            assert block.fire("CHECK", FOLLOWING=following, SPEED=speed) == []
        assert block.fire("CHECK", FOLLOWING=0.5, SPEED=2.5) == []
    for _ in range(LASTING - 1):
        assert block.fire("CHECK", FOLLOWING=following, SPEED=speed) == []
    assert block["STOP"] == before
    runs = speed != speed and before in (BRAKING, STANDSTILL)
    assert block.fire("CHECK", FOLLOWING=following, SPEED=speed) == (["HALT"] if before == NONE or runs else [])
    assert block["STOP"] == (TORQUE_OFF if runs else max(before, BRAKING))


@pytest.mark.parametrize(("saturated", "doubt"), [(26.0, 0.0), (0.0, 12.1), (float("nan"), 0.0), (0.0, float("nan"))])
def test_voltages_cut_off_for_long_and_readings_not_to_be_explained_stop_the_arm(
    saturated: float, doubt: float
) -> None:
    block = decision(NONE)
    assert block.fire("CHECK", SATURATED=25.0, DOUBT=12.0) == []
    assert block.fire("CHECK", SATURATED=saturated, DOUBT=doubt) == ["HALT"]
    assert block["STOP"] == BRAKING


@pytest.mark.parametrize("before", [BRAKING, STANDSTILL])
def test_a_stopped_arm_that_runs_away_loses_its_torque(before: int) -> None:
    block = decision(before)
    for _ in range(LASTING - 1):
        assert block.fire("CHECK", SPEED=6.1) == []
    assert block.fire("CHECK", SPEED=6.0) == []
    for _ in range(LASTING - 1):
        assert block.fire("CHECK", SPEED=6.1) == []
    assert block.fire("CHECK", SPEED=6.1) == ["HALT"]
    assert block["STOP"] == TORQUE_OFF


def test_a_signal_is_bound_by_no_path_but_by_a_velocity_of_its_own() -> None:
    """Limits of the task's motions stopped an identification signal in its first samples."""
    block = decision(NONE)
    for _ in range(3 * LASTING):
        fast = {"FOLLOWING": 9.0, "SPEED": 9.0, "FASTEST": 24.9, "SATURATED": 99.0, "DOUBT": 99.0}
        assert block.fire("CHECK", OVERRIDE=True, **fast) == []
    for _ in range(LASTING - 1):
        assert block.fire("CHECK", FASTEST=25.1) == []
    assert block.fire("CHECK") == ["HALT"]
    assert block["STOP"] == BRAKING


def test_a_stop_for_leaving_the_path_goes_on_like_any_other() -> None:
    block = decision(NONE)
    for _ in range(LASTING):
        block.fire("CHECK", FOLLOWING=1.0, SPEED=0.0)
    for sample in range(1, BRAKING_SAMPLES + 1):
        block.fire("REQ", AWAY=0.0)
        assert block["STOP"] == (BRAKING if sample < BRAKING_SAMPLES else STANDSTILL)
    block.fire("VERDICT", STATE=NOMINAL, CONFIDENCE=0.0, RELEASE=True)
    assert block["STOP"] == NONE


def test_braking_starts_anew_after_a_release() -> None:
    block = decision(STANDSTILL)
    block.fire("VERDICT", STATE=NOMINAL, RELEASE=True)
    block.fire("VERDICT", STATE=FAILED, CONFIDENCE=1.0, RELEASE=False)
    for _ in range(BRAKING_SAMPLES - 1):
        block.fire("REQ", AWAY=0.0)
    assert block["STOP"] == BRAKING


@pytest.mark.parametrize("stop", [NONE, BRAKING, STANDSTILL, TORQUE_OFF])
def test_a_restart_never_ends_a_stop(stop: int) -> None:
    block = decision(stop)
    assert block.fire("INIT") == ["HALT", "INITO"]
    assert block["STOP"] == (NONE if stop == NONE else TORQUE_OFF)


@given(
    start=st.lists(st.floats(-4, 4), min_size=3, max_size=3),
    colour=st.sampled_from(sorted(PLACES)),
    duration=st.floats(0.5, 3.0),
    ticks=st.integers(1, 320),
    behind=st.lists(st.floats(-0.099, 0.099), min_size=3, max_size=3),
)
def test_the_path_brakes_to_rest_without_a_jump_and_without_turning_back(
    start: list[float], colour: str, duration: float, ticks: int, behind: list[float]
) -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TIMING", T=duration)
    planner.fire("TARGET", **to(colour), **triple("THETA", start))
    for _ in range(ticks):
        planner.fire("REQ")
    theta, omega = planner.triple("THETA_D"), planner.triple("OMEGA_D")
    for tick in range(1, 45):
        stop, t = BRAKING if tick < BRAKING_SAMPLES else STANDSTILL, min(0.01 * tick, 0.3)
        measured = theta + omega * t * (1 - t / 0.6) - np.array(behind)
        assert planner.fire("REQ", STOP=stop, **triple("THETA", measured)) == ["STANDING", "CNF"]
        assert planner["MOVING"]
        np.testing.assert_allclose(planner.triple("THETA_D"), theta + omega * t * (1 - t / 0.6), atol=1e-12)
        np.testing.assert_allclose(planner.triple("OMEGA_D"), omega * (1 - t / 0.3), atol=1e-12)
        assert (np.sign(planner.triple("OMEGA_D")) * np.sign(omega) >= 0).all()
        np.testing.assert_allclose(planner.triple("ALPHA_D"), -omega / 0.3 * (tick < 30), atol=1e-12)
        distance = np.abs(planner.triple("THETA_D") - measured).max()
        assert planner["AWAY"] == distance
    assert not planner.triple("OMEGA_D").any()


def test_a_released_path_starts_at_rest_where_the_arm_is() -> None:
    planner = Driven("PATH_PLANNER")
    planner.fire("TARGET", **to("red"))
    for _ in range(70):
        planner.fire("REQ")
    path = triple("THETA", planner.triple("THETA_D"))
    for _ in range(50):
        planner.fire("REQ", STOP=STANDSTILL, **path)
    theta = planner.triple("THETA_D") + np.array([0.02, -0.03, 0.04])
    assert planner.fire("REQ", STOP=NONE, **triple("THETA", theta)) == ["RESET", "CNF"]
    np.testing.assert_array_equal(planner.triple("THETA_D"), theta)
    assert not planner.triple("OMEGA_D").any()
    for _ in range(201):
        assert planner.fire("REQ") == ["CNF"]
    np.testing.assert_array_equal(planner.triple("THETA_D"), PLACES["red"].theta)
    assert not planner["MOVING"]


@pytest.mark.parametrize("hold", [False, True])
def test_a_path_stopped_before_its_first_sample_stays_where_the_arm_is(hold: bool) -> None:
    planner = Driven("PATH_PLANNER")
    theta = np.array([1.0, -2.0, 0.5])
    planner.fire("TARGET", **to("red"), **triple("THETA", theta))
    for _ in range(60):
        assert planner.fire("REQ", STOP=BRAKING, HOLD=hold) == ["STANDING", "CNF"]
        np.testing.assert_array_equal(planner.triple("THETA_D"), theta)


def test_the_selector_knows_no_signal_during_a_stop_and_no_voltage_without_torque() -> None:
    block = Driven("DATA_SELECTOR")
    volts = {f"V_CONTROL{j}": float(j) for j in JOINTS} | {f"V_SIGNAL{j}": -float(j) for j in JOINTS}
    expected = {NONE: [-1, -2, -3], BRAKING: [1, 2, 3], STANDSTILL: [1, 2, 3], TORQUE_OFF: [0, 0, 0]}
    for stop in (NONE, BRAKING, STANDSTILL, TORQUE_OFF, NONE, TORQUE_OFF, BRAKING, NONE):
        assert block.fire("REQ", OVERRIDE=True, STOP=stop, **volts) == ["CNF"]
        assert block.triple("V").tolist() == expected[stop]
        block.fire("REQ", OVERRIDE=False, **volts)
        assert block.triple("V").tolist() == ([0, 0, 0] if stop == TORQUE_OFF else [1, 2, 3])


@pytest.mark.parametrize("stop", [NONE, BRAKING, STANDSTILL, TORQUE_OFF])
def test_no_voltage_drives_an_arm_that_is_too_fast(stop: int) -> None:
    """A lie that gets past all else may not drive the arm on: what brakes it then are its friction and its motors."""
    block = Driven("DATA_SELECTOR")
    volts = {f"V_CONTROL{j}": float(j) for j in JOINTS}
    block.fire("REQ", STOP=stop, SPEED=6.1, **volts)
    assert block.triple("V").tolist() == [0, 0, 0]
    block.fire("REQ", STOP=stop, SPEED=6.0)
    assert block.triple("V").tolist() == ([0, 0, 0] if stop == TORQUE_OFF else [1, 2, 3])


def test_a_signal_is_played_however_fast_the_arm_gets() -> None:
    """The limit of speed is that of the task's motions; beyond it a planned signal was 0 V."""
    block = Driven("DATA_SELECTOR")
    volts = {f"V_SIGNAL{j}": float(j) for j in JOINTS}
    for speed in (0.0, 6.1, 20.0, 6.1):
        block.fire("REQ", OVERRIDE=True, SPEED=speed, **volts)
        assert block.triple("V").tolist() == [1, 2, 3]
    block.fire("REQ", OVERRIDE=True, STOP=TORQUE_OFF)
    assert block.triple("V").tolist() == [0, 0, 0]


def test_a_stop_ends_the_identification_signal_and_lets_none_begin() -> None:
    block = Driven("SYS_IDENT_3211SIG")
    for ticks in (0, 10):
        block.fire("SWITCH", REQUEST=True)
        for _ in range(ticks):
            block.fire("REQ")
        assert block["OVERRIDE"] == (ticks > 0)
        block.fire("HALT", STOP=BRAKING)
        assert block.fire("REQ") == ["CNF"]
        assert not block["OVERRIDE"]
        block.fire("SWITCH", REQUEST=True)
        for _ in range(3):
            assert block.fire("REQ") == ["CNF"]
            assert not block["OVERRIDE"]
        block.fire("HALT", STOP=NONE)
        assert block.fire("REQ") == ["CNF"]
    block.fire("SWITCH", REQUEST=True)
    assert block.fire("REQ") == ["CNF", "SAMPLED"]


def test_a_stopped_sequence_neither_grips_nor_releases() -> None:
    block = Driven("PICK_AND_PLACE")
    at: dict[str, Any] = {"GRIPPER": 0.9, "BOX_PRESENT": True, "COLOUR": "red"}

    def settle(state: str, **inputs: Any) -> None:
        for _ in range(60):
            block.fire("REQ", **at, **inputs)
        assert block["$ECC"] == state

    settle("APPROACH", STOP=BRAKING)
    settle("CLOSE", STOP=NONE)
    at["GRIPPER"] = 0.4
    settle("APPROACH", STOP=STANDSTILL)
    assert (block["V_GRIPPER"], block["GRIPPED"]) == (3.0, False)
    settle("OPEN", STOP=NONE)
    at["GRIPPER"] = 0.9
    for stop in (TORQUE_OFF, BRAKING, STANDSTILL):
        settle("CARRY", MOVING=True, STOP=stop)
        assert (block["V_GRIPPER"], block["GRIPPED"]) == (-8.0, True)
    settle("CARRY", MOVING=True, STOP=NONE)
    assert (block["V_GRIPPER"], block["GRIPPED"]) == (-3.0, True)


def weaker(share: float) -> ArmParameters:
    """The arm whose motor 2 has a share of its torque."""
    return ArmParameters().with_values({"K2": share * ArmParameters().get("K2")})


class StoppableArm:
    """The application controls a true arm, whose motors may lose torque."""

    def __init__(self, writes: Mapping[str, Any] | None = None) -> None:
        self.application = Application(writes)
        self.resource = self.application.resource
        self.state: Array = np.zeros(6)
        self.arm = ArmParameters()
        self.volts: list[Array] = []
        self.answers = self.application.received(VERDICT)

    def ticks(self, count: int) -> None:
        for _ in range(count):
            answer = self.application.tick(self.state[:3].tolist())
            self.volts.append(np.array(answer[:4]))
            self.state = rollout(self.arm, self.state, np.array([answer[:3]]), 0.0)[1]

    def tell(self, state: int, confidence: float = 1.0, release: bool = False) -> int:
        """Sends a verdict and returns the stop that the blocks answer."""
        self.application.send(VERDICT, state, confidence, release)
        ((stop,),) = self.answers[-1:]
        assert stop == self.resource.read("TWIN.STOP")
        return int(stop)

    @property
    def stop(self) -> int:
        return int(self.resource.read("TWIN.STOP"))

    @property
    def path(self) -> Array:
        return np.array([self.resource.read(f"PLANNER.THETA_D{j}") for j in JOINTS])


@pytest.mark.parametrize("start", [1, 40, 100, 160, 199, 300])
def test_a_healthy_arm_stops_stands_and_goes_on_to_where_it_was_going(start: int) -> None:
    run = StoppableArm()
    run.ticks(start)
    assert run.tell(DEGRADING) == NONE
    assert run.tell(FAILED, 0.98) == NONE
    assert run.tell(FAILED, 0.99) == BRAKING
    before = np.abs(run.state[3:]).max()
    run.ticks(31)
    assert np.abs(run.state[3:]).max() < 0.02 + 0.1 * before
    run.ticks(500)
    assert run.stop == STANDSTILL
    assert np.abs(run.state[3:]).max() < 1e-3
    np.testing.assert_allclose(run.state[:3], run.path, atol=1e-3)
    assert run.tell(NOMINAL) == STANDSTILL
    assert run.tell(NOMINAL, release=True) == NONE
    run.ticks(500)
    target = [run.resource.read(f"PLANNER.THETA_T{j}") for j in JOINTS]
    np.testing.assert_allclose(run.state[:3], target, atol=2e-3)
    volts = np.array(run.volts[start:])[:, :3]
    assert np.abs(np.diff(volts, axis=0)).max() < 1.5  # the steps of the acceleration, no jump of the path
    assert np.abs(volts).max() < 8


def test_an_arm_without_torque_in_joint_2_gets_no_voltage_and_falls() -> None:
    run = StoppableArm(THESIS)
    run.ticks(100)
    run.arm = weaker(0.1)
    run.ticks(10)
    assert run.tell(FAILED) == BRAKING
    run.ticks(BRAKING_SAMPLES - 1)
    assert run.stop == BRAKING
    run.ticks(400)
    assert run.stop == TORQUE_OFF
    assert not np.array(run.volts)[-100:, :3].any()
    assert run.volts[-1][3] == 3.0
    off = next(i for i in range(110, 549) if not run.volts[i][:3].any())
    assert not np.array(run.volts)[off:, :3].any()
    run.arm = ArmParameters()
    assert run.tell(NOMINAL) == TORQUE_OFF
    assert run.tell(NOMINAL, release=True) == NONE
    run.ticks(700)
    target = [run.resource.read(f"PLANNER.THETA_T{j}") for j in JOINTS]
    np.testing.assert_allclose(run.state[:3], target, atol=2e-3)


def locked(joint: int, start: int) -> tuple[int, Array]:
    """The stop in which an arm ends whose joint, 0 to 2, is locked some ticks into a motion, and the last speeds."""
    run = StoppableArm()
    run.ticks(start)
    angle = float(run.state[joint])
    speeds: list[Array] = []
    for tick in range(500):
        if tick == 60 and run.stop == NONE:
            run.tell(FAILED)
        run.ticks(1)
        run.state[[joint, 3 + joint]] = angle, 0.0
        speeds.append(run.state[3:].copy())
    return run.stop, np.abs(speeds[-100:])


def test_most_arms_with_a_locked_joint_stand_instead_of_losing_all_torque() -> None:
    """The controller has summed up much over the distance of the locked joint, which must not swing the others; those
    that move fast as the path is put where they are may still leave it."""
    ends = [locked(joint, start) for joint in range(3) for start in (60, 80, 100, 120)]
    standing = [speeds for stop, speeds in ends if stop == STANDSTILL]
    assert len(standing) >= 9
    assert max(speeds.max() for speeds in standing) < 0.05


def test_without_knowing_the_angles_the_torque_goes_at_once() -> None:
    run = StoppableArm()
    run.ticks(100)
    assert run.tell(UNKNOWN) == TORQUE_OFF
    run.ticks(1)
    assert not run.volts[-1][:3].any()


@pytest.mark.parametrize("ticks", [0, 1, 2, 100])
def test_a_stop_takes_the_arm_back_from_the_identification_signal(ticks: int) -> None:
    run = StoppableArm()
    run.ticks(100)
    run.application.send("TWIN.IDENTIFICATION.REQUEST", True)
    run.ticks(ticks)
    assert run.tell(FAILED) == BRAKING
    speed = np.abs(run.state[3:]).max()
    run.ticks(1)
    assert not run.resource.read("SELECTOR.OVERRIDE")
    assert run.resource.read("PLANNER.$ECC") == "BRAKING"
    run.application.send("TWIN.IDENTIFICATION.REQUEST", True)
    run.ticks(600)
    assert speed > 0.1
    assert run.stop == STANDSTILL
    assert np.abs(run.state[3:]).max() < 1e-3
    run.tell(NOMINAL, release=True)
    run.ticks(500)
    target = [run.resource.read(f"PLANNER.THETA_T{j}") for j in JOINTS]
    np.testing.assert_allclose(run.state[:3], target, atol=2e-3)


@pytest.mark.parametrize("ticks", [10, 200])
def test_another_arm_gets_no_voltage_before_the_release(ticks: int) -> None:
    run = StoppableArm()
    run.ticks(100)
    run.tell(FAILED)
    run.ticks(ticks)
    run.state = run.state + np.array([1.0, 1.0, 1.0, 0.0, 0.0, 0.0])
    before = len(run.volts)
    run.ticks(200)
    assert run.resource.read("SEQUENCE.SYSTEM_TIME") == 1.97  # it begins anew with the third sample of the other arm
    assert run.stop == TORQUE_OFF
    assert not np.array(run.volts[before:])[:, :3].any()
    assert run.tell(NOMINAL, release=True) == NONE
    run.ticks(700)
    target = [run.resource.read(f"PLANNER.THETA_T{j}") for j in JOINTS]
    np.testing.assert_allclose(run.state[:3], target, atol=2e-3)


def test_a_stop_before_the_first_sample_holds_the_arm_where_it_is() -> None:
    run = StoppableArm()
    run.state[:3] = start = np.array([-1.5, 0.2, 0.1])
    assert run.tell(FAILED) == BRAKING
    run.ticks(300)
    assert run.stop == STANDSTILL
    np.testing.assert_array_equal(run.path, start)
    np.testing.assert_allclose(run.state[:3], start, atol=1e-3)


def test_a_release_starts_with_integrals_of_zero() -> None:
    run = StoppableArm(THESIS)
    run.ticks(60)
    run.arm = weaker(0.9)
    run.ticks(10)
    run.tell(FAILED)
    run.ticks(300)
    assert run.stop == STANDSTILL
    assert abs(run.resource.read("CONTROLLER.SUM2")) > 1.0
    run.tell(NOMINAL, release=True)
    run.ticks(1)
    theta, path = run.path, [run.resource.read(f"CONTROLLER.SUM{j}") for j in JOINTS]
    assert np.abs(path).max() < 1e-9
    np.testing.assert_array_equal(theta, [run.resource.read(f"PLANNER.THETA{j}") for j in JOINTS])


@pytest.mark.parametrize(("doubt", "limit", "stop"), [(13.0, 0.03, 3), (11.0, 0.03, 2), (13.0, 1.0e9, 2)])
def test_a_standing_arm_whose_readings_are_in_doubt_may_not_be_pushed_as_far(
    doubt: float, limit: float, stop: int
) -> None:
    block = decision(STANDSTILL)
    block.resource.write("DUT.BLIND_LIMIT", limit)
    block.fire("CHECK", FOLLOWING=0.0, SPEED=0.0, SATURATED=0.0, DOUBT=doubt, FASTEST=0.0, OVERRIDE=False)
    for _ in range(LASTING - 1):
        block.fire("REQ", AWAY=0.05)
    assert block["STOP"] == STANDSTILL
    block.fire("REQ", AWAY=0.05)
    assert block["STOP"] == stop
