"""The search of settings, and the strength of the arm."""

import math

import pytest

from dtwin.bus.twin_messages import PredictedMotion
from dtwin.controller.motion import NAMES
from dtwin.controller.settings import usual_gains
from dtwin.parameters import ArmParameters, Gains, scaled
from dtwin.recovery.strength import RESERVE, Strength, holding
from dtwin.recovery.tuning import BOUND, SLOWER, STIFFER, Expect, search

GAINS = usual_gains("computed_torque")
USUAL = Strength.of(ArmParameters(), 0.21)
"""share of the voltage limit that holding the healthy arm takes, by place"""


def motion(carries: bool, rms: float, saturated: float = 0.0) -> PredictedMotion:
    nothing = (0.0, 0.0, 0.0)
    return PredictedMotion("pickup", "red", carries, (rms, 0.0, 0.0), nothing, nothing, saturated)


HEALTHY = [motion(True, 1.0), motion(False, 1.0)]


def with_ratios(loaded: float, empty: float, asked: list[tuple[float, float]], saturated: float = 0.0) -> Expect:
    """An arm that tracks better by the cube of a longer time, and by the inverse of stiffer gains."""

    def expect(gains: Gains, time: float) -> list[PredictedMotion]:
        stiffer, slower = gains.kp[0] / GAINS.kp[0], time / 2.0
        asked.append((slower, stiffer))
        better = 1.0 / (stiffer * slower**3)
        return [motion(True, loaded * better, saturated), motion(False, empty * better)]

    return expect


@pytest.mark.parametrize(
    ("loaded", "time", "stiffer", "ability"),
    [
        (1.0, 2.0, 1.0, "as before"),
        (1.1, 2.0, 1.15, "as before"),
        (1.9, 2.2, 1.5, "slower"),
        (9.9, 4.0, 1.3, "slower"),
    ],
)
def test_the_least_change_that_is_enough_is_taken(loaded: float, time: float, stiffer: float, ability: str) -> None:
    tuned = search(ArmParameters(), 0.2, USUAL, with_ratios(loaded, 0.5, []), GAINS, 2.0, HEALTHY)
    assert (tuned.target_time, tuned.ability) == (time, ability)
    assert tuned.gains.kp[0] / GAINS.kp[0] == pytest.approx(stiffer)
    assert tuned.gains.ki[1] / GAINS.ki[1] == pytest.approx(stiffer)
    assert tuned.ratio <= 1.0


@pytest.mark.parametrize(("empty", "ability"), [(0.5, "without a box"), (1000.0, "not at all")])
def test_an_arm_that_no_settings_help_is_judged_by_its_empty_motions(empty: float, ability: str) -> None:
    asked: list[tuple[float, float]] = []
    tuned = search(ArmParameters(), 0.2, USUAL, with_ratios(1000.0, empty, asked), GAINS, 2.0, HEALTHY)
    assert tuned.ability == ability
    assert tuned.ratio > BOUND
    assert len(asked) == len(SLOWER) * len(STIFFER)


@pytest.mark.parametrize(
    ("loaded", "saturated", "time", "ability"),
    [(2.0, 0.0, 2.0, "as before"), (3.1, 0.0, 2.2, "slower"), (1.3, 0.1, 2.0, "not at all")],
)
def test_an_arm_whose_gains_can_be_no_stiffer_works_with_what_is_nearest(
    loaded: float, saturated: float, time: float, ability: str
) -> None:
    """Its errors depend on its gains and hardly on its time; one at the voltage limit is too weak."""

    def expect(gains: Gains, time: float) -> list[PredictedMotion]:
        worse = loaded * (1.0 if time == 2.0 else 0.96)
        return [motion(True, worse, saturated), motion(False, worse, saturated)]

    tuned = search(ArmParameters(), 0.2, USUAL, expect, GAINS, 2.0, HEALTHY, stiffer=(1.0,))
    assert (tuned.gains, tuned.ability) == (GAINS, ability)
    assert tuned.target_time == pytest.approx(time)
    assert tuned.ratio == pytest.approx(loaded * (1.0 if time == 2.0 else 0.96))


def test_what_is_within_the_bound_goes_before_what_is_nearly_as_good() -> None:
    worse = {2.0: 1.24, 2.2: 1.19}

    def expect(gains: Gains, time: float) -> list[PredictedMotion]:
        return [motion(carries, worse.get(round(time, 3), 1.3)) for carries in (True, False)]

    tuned = search(ArmParameters(), 0.2, USUAL, expect, GAINS, 2.0, HEALTHY, stiffer=(1.0,))
    assert tuned.target_time == pytest.approx(2.2)


def test_stiffer_gains_are_not_tried_at_the_voltage_limit() -> None:
    asked: list[tuple[float, float]] = []
    search(ArmParameters(), 0.2, USUAL, with_ratios(1000.0, 1.0, asked, saturated=0.1), GAINS, 2.0, HEALTHY)
    assert [stiffer for _, stiffer in asked] == [1.0] * len(SLOWER)


@pytest.mark.parametrize(("share", "ability"), [(0.8, "without a box"), (0.2, "not at all")])
def test_nothing_is_tried_with_an_arm_that_cannot_hold_its_box(share: float, ability: str) -> None:
    asked: list[tuple[float, float]] = []
    weak = ArmParameters().with_values({"K2": share * ArmParameters().get("K2")})
    tuned = search(weak, 0.21, USUAL, with_ratios(1.0, 1.0, asked), GAINS, 2.0, HEALTHY)
    assert (tuned.ability, tuned.ratio, asked) == (ability, math.inf, [])


def test_the_strength_that_is_left_follows_the_voltage_constant() -> None:
    arm = ArmParameters()
    shares = holding(arm, 0.21)
    assert tuple(shares) == NAMES
    strength = Strength.of(arm, 0.21)
    assert not strength.beyond(arm, 0.21)
    # Gravity at red by hand: q1 + q2 + q3 = 0, so that the third link is level.
    level, forearm = 0.12993861 * 0.14 + 0.21 * 0.1608, 0.11604 * 0.1 + (0.12993861 + 0.21) * 0.13246938
    torque = 9.81 * (level + forearm * math.cos(2.5298 - 2.0654))
    assert shares["red"] == pytest.approx(torque / (8.0 * arm.get("K2")), rel=1e-3)
    just = shares["red"] / (1.0 - RESERVE)
    assert strength.beyond(scaled(arm, "K", 0.999 * just), 0.21) == ["red"]
    assert not strength.beyond(scaled(arm, "K", 1.001 * just), 0.21)


def test_an_arm_that_never_had_the_reserve_works_on_with_what_it_has() -> None:
    """A fault of joint 1 makes no place harder to hold at which joint 2 is the weakest."""
    arm = scaled(ArmParameters(), "K", holding(ArmParameters(), 0.21)["red"] / (1.0 - 0.5 * RESERVE))
    strength = Strength.of(arm, 0.21)
    assert strength.usual["red"] == pytest.approx(1.0 - 0.5 * RESERVE)
    assert not strength.beyond(arm.with_values({"K1": 0.95 * arm.get("K1")}), 0.21)
    assert strength.beyond(arm.with_values({"K2": 0.99 * arm.get("K2")}), 0.21) == ["red"]
    assert strength.beyond(arm, 0.22) == ["red"]
