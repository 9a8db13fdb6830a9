"""What is refused before it reaches a controller, and what is predicted of the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dtwin.controller.motion import MotionController
from dtwin.controller.settings import USUAL_GAINS, ControlSettings, usual_gains
from dtwin.parameters import PERIOD, PICKUP, PLACES, ArmParameters, Gains, scaled
from dtwin.settings.change import Refused
from dtwin.simulation.checks import MOTIONS, TOLERANCE, Checker, Motion
from dtwin.simulation.margins.demands import DEMANDS, cases
from dtwin.simulation.margins.poses import places
from dtwin.simulation.places import angles_of, legs_of
from dtwin.simulation.whatif import MotionCase, Simulator
from dtwin.task import DEFAULT_TASK
from dtwin.twin.effects import Effects
from dtwin.twin.kinematics import forward

USUAL = ControlSettings()


def test_prediction_is_the_worst_of_the_motions(checker: Checker, simulator: Simulator) -> None:
    prediction = checker.check(USUAL, ArmParameters())
    loads = [(m, 0.2 if m.carries else 0.0) for m in MOTIONS] + [(m, 0.2 + 0.01) for m in MOTIONS if m.carries]
    found = [
        simulator.run(
            MotionCase(m.goal, USUAL, angles_of(m.start), payload=load, carries=m.carries, duration=2.5)
        ).figures
        for m, load in loads
    ]
    for joint in range(3):
        assert prediction.tracking[joint] == max(figures.tracking_max[joint] for figures in found)
        assert prediction.peak_volts[joint] == max(figures.peak_volts[joint] for figures in found)
    worst = max(zip(found, loads, strict=True), key=lambda pair: max(pair[0].tracking_max))
    assert prediction.worst == worst[1][0]
    assert prediction.spectral_radius < 1.0


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        (
            replace(USUAL, gains=usual_gains("computed_torque", kp=(1000.0,) * 3)),
            "blue with a box: not stable: spectral radius 1.00",
        ),
        (replace(USUAL, gains=usual_gains("computed_torque", kd=(200.0,) * 3)), "not stable"),
        (replace(USUAL, gains=Gains((0.0,) * 3, (0.0,) * 3, (0.0,) * 3)), "not stable"),
        (replace(USUAL, law="row_sum", payload_model="point"), "not stable"),
        (replace(USUAL, payload_model="weight"), "not stable"),
        (replace(USUAL, model=scaled(ArmParameters(), "K", 0.5)), "not stable"),
        (replace(USUAL, target_time=0.9), "pickup to green: joint 3 would leave its path by"),
        (replace(USUAL, model=scaled(ArmParameters(), "D", 20.0)), "would leave its path"),
        (replace(USUAL, target_time=0.01), "target time: expected 0.1 to 60 s, got 0.01"),
        (
            replace(USUAL, gains=usual_gains("computed_torque", ki=(1.0, 1e6, 1.0))),
            "ki2: expected 0 to 100000, got 1e",
        ),
        (replace(USUAL, model=replace(ArmParameters(), length=(0.15, 5.0, 0.16))), "l2: expected 0.01 to 0.5, got 5"),
    ],
)
def test_bad_settings_are_refused_with_the_reason(checker: Checker, settings: ControlSettings, reason: str) -> None:
    with pytest.raises(Refused, match=reason):
        checker.check(settings, ArmParameters())


def test_what_is_bad_for_another_arm_is_refused(checker: Checker) -> None:
    """The arm that the twin knows takes the plant's place, not the one that the controller believes in."""
    weak = ArmParameters().with_values({"K2": 0.03})
    with pytest.raises(Refused):
        checker.check(USUAL, weak)
    assert max(checker.predict(USUAL, weak, MOTIONS[:2]).tracking) > 0.1


def test_only_the_motions_that_are_asked_for_count(checker: Checker) -> None:
    fast = replace(USUAL, target_time=1.0)
    with pytest.raises(Refused, match="green"):
        checker.check(fast, ArmParameters())
    assert checker.check(fast, ArmParameters(), [Motion("pickup", "red", True)]).worst.goal == "red"


def test_what_an_arm_has_beside_its_parameters_counts(checker: Checker) -> None:
    sticking = Checker(effects=Effects(stiction=(0.01, 0.01, 0.01), rotor_inertia=(1e-4, 1e-4, 1e-4)))
    rough, smooth = sticking.check(USUAL, ArmParameters()), checker.check(USUAL, ArmParameters())
    assert rough.rms > 1.3 * smooth.rms
    assert rough.disk_margin != smooth.disk_margin
    with pytest.raises(Refused, match="not stable"):
        Checker(effects=Effects(delay=0.03)).check(USUAL, ArmParameters())


def test_an_arm_too_slow_for_the_margins_is_not_kept_from_what_keeps_its_own() -> None:
    settings = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade")
    slow, arm = Checker(effects=Effects(delay=0.025)), ArmParameters()
    with pytest.raises(Refused, match="margin"):
        slow.check(settings, arm)
    share = slow.tolerate(settings, arm)
    everywhere = cases(MotionController(), settings, arm, places(), 2.5, Effects(delay=0.025))
    short = [DEMANDS["cascade"].shortfall(case.margins) for case in everywhere]
    assert len(short) == 8
    assert share == pytest.approx(TOLERANCE * min(lack.share for lack in short if lack is not None), rel=1e-9)
    assert slow.keeps_margins(settings, arm), "what the usual settings have is enough, at every place"
    slow.check(replace(settings, model=scaled(arm, "K", 0.98)), arm)
    with pytest.raises(Refused, match="margin"):
        slow.check(replace(settings, model=scaled(arm, "K", 0.85)), arm)
    with pytest.raises(Refused, match="not stable"):
        slow.check(replace(settings, model=scaled(arm, "K", 0.3)), arm)
    assert Checker().tolerate(settings, arm) == 1.0
    unstable = replace(settings, model=scaled(arm, "K", 0.3))
    assert slow.tolerate(unstable, arm) == 1.0, "nothing is allowed because all was lost"
    with pytest.raises(Refused, match="margin"):
        slow.check(settings, arm)


def test_more_time_is_not_refused_for_margins_that_it_does_not_change(checker: Checker) -> None:
    """A shorter time, or a heavier box beside the longer one, is; and all of it where other settings are in force."""
    usual = USUAL_GAINS["cascade"]
    first, second, third = usual.kp
    fast = ControlSettings(law="cascade", gains=replace(usual, kp=(5.0 * first, 5.0 * second, 5.0 * third)))
    longer = replace(fast, target_time=fast.target_time + 1.0)
    refused = [(longer, None), (longer, USUAL), (replace(fast, target_time=1.9), fast)]
    for settings, in_force in [*refused, (replace(longer, payload=0.21), fast)]:
        with pytest.raises(Refused, match="gain margin"):
            checker.check(settings, ArmParameters(), in_force=in_force)
    assert checker.check(longer, ArmParameters(), in_force=fast).spectral_radius < 1.0


def test_commands_that_come_late_count_in_margins_and_motions() -> None:
    settings, arm = ControlSettings(gains=USUAL_GAINS["cascade"], law="cascade"), ArmParameters()
    found = Checker().check(settings, arm, late=1.0)
    assert found == Checker(effects=Effects(delay=PERIOD)).check(settings, arm)
    in_time = Checker().check(settings, arm)
    assert found.disk_margin < in_time.disk_margin
    assert max(found.tracking) > max(in_time.tracking)


def test_ways_between_bodies_are_checked_where_the_arm_takes_them() -> None:
    """Most are shorter and faster; a weak arm that could not go slowly past them, stretched out, goes along them."""
    straight, ways = Checker().check(USUAL, ArmParameters()), Checker(via=True).check(USUAL, ArmParameters())
    assert max(ways.tracking) > 1.2 * max(straight.tracking)
    assert (ways.disk_margin, ways.spectral_radius) == (straight.disk_margin, straight.spectral_radius)
    weak = ArmParameters().with_values({"K2": 0.8 * ArmParameters().get("K2")})
    slow = ControlSettings(4.0, USUAL_GAINS["cascade"], "cascade", weak, 0.2)
    with pytest.raises(Refused, match="pickup to red: joint 2 would leave its path"):
        Checker().check(slow, weak)
    assert max(Checker(via=True).check(slow, weak).tracking) < 0.1


def test_what_is_expected_of_an_arm_among_bodies_is_its_ways() -> None:
    arm, checker = ArmParameters(), Checker(via=True)
    ways = checker.expect(USUAL, arm, 0.21)
    motions = {motion for motion, _ in ways}
    assert len(motions) == len(ways) > len(MOTIONS)
    assert all((end, start, not carries) in motions for start, end, carries in motions)
    assert {motion.goal for motion in motions if motion.carries} > set(PLACES)
    both = [*ways, *checker.expect(USUAL, arm, USUAL.payload)]
    farthest = np.max([figures.tracking_max for _, figures in both], axis=0)
    np.testing.assert_allclose(checker.check(USUAL, arm).tracking, farthest)
    assert [motion for motion, _ in checker.expect(USUAL, arm, 0.21, loaded=True)] == [
        motion for motion, _ in ways if motion.carries
    ]
    assert [motion for motion, _ in Checker().expect(USUAL, arm, 0.21)] == list(MOTIONS)


def test_ways_lead_from_the_pickup_to_every_place_and_back() -> None:
    legs = legs_of(DEFAULT_TASK, MotionController(via=True).point)
    carried = [leg for leg in legs if leg.carries]
    assert {(leg.goal, leg.start) for leg in carried} == {(leg.start, leg.goal) for leg in legs if not leg.carries}
    starts, goals = {leg.start for leg in carried}, {leg.goal for leg in carried}
    assert starts - goals == {PICKUP.theta}
    ends = [forward(goal, ArmParameters())[:2] for goal in goals - starts]
    places = [(place.x, place.y) for place in PLACES.values()]
    np.testing.assert_allclose(sorted(ends), sorted(places), atol=5e-4)
    assert all(leg.duration(2.0) >= 2.0 for leg in legs)
    assert MotionController(via=True).point("nowhere") is None
