"""The search: limits are kept, equal seeds give equal results, and fronts hold what nothing beats."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.campaign.spread import Workforce
from dtwin.controller.settings import ControlSettings, usual_gains
from dtwin.errors import ParameterError
from dtwin.parameters import ArmParameters, Gains
from dtwin.simulation.checks import MOTIONS, Motion
from dtwin.simulation.objective import (
    UNUSABLE,
    CandidateScore,
    Limits,
    Objective,
    possible_arms,
    scenarios_for,
    score,
)
from dtwin.simulation.optimise import POPULATION, Optimum, optimise

ARM = ArmParameters()
RED = (Motion("pickup", "red", True), Motion("red", "pickup", False))
SMALL = Objective(ControlSettings(), scenarios_for(RED[1:], ARM, (0.2, 0.2)))


@pytest.fixture(scope="module")
def found() -> Optimum:
    return optimise(SMALL, (0.5, 2.5), candidates=3 * POPULATION, workforce=Workforce(1), seed=2)


def test_the_best_is_better_than_what_is_in_use(found: Optimum) -> None:
    assert found.reference.cost == pytest.approx(1.0)
    assert found.best.cost < 0.8
    assert found.best.terms["time"] < 0.8 * found.reference.terms["time"]
    assert len(found.scores) == 3 * POPULATION
    assert found.best.cost == min(each.cost for each in found.scores)


def test_usable_candidates_keep_the_limits(found: Optimum) -> None:
    limits = SMALL.limits
    usable = [each for each in found.scores if not each.broken]
    assert 5 < len(usable) < len(found.scores)
    for each in usable:
        assert each.terms["tracking"] <= limits.tracking
        assert each.terms["voltage"] <= limits.voltage
        assert each.cost < UNUSABLE
    for each in found.scores:
        assert (each.cost >= UNUSABLE) == bool(each.broken)
        assert 0.5 <= each.target_time <= 2.5 + 1e-9


def test_equal_seeds_give_equal_results_whatever_the_number_of_processes(found: Optimum) -> None:
    again = optimise(SMALL, (0.5, 2.5), candidates=2 * POPULATION, workforce=Workforce(2), seed=2)
    assert again.scores == found.scores[: 2 * POPULATION]
    other = optimise(SMALL, (0.5, 2.5), candidates=2 * POPULATION, workforce=Workforce(1), seed=3)
    assert other.scores[1:] != found.scores[1 : 2 * POPULATION]


def test_a_fixed_target_time_stays() -> None:
    found = optimise(SMALL, (2.0, 2.0), candidates=2 * POPULATION, workforce=Workforce(1))
    assert {round(each.target_time, 9) for each in found.scores} == {2.0}


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=30))
def test_the_front_is_what_nothing_beats(points: list[tuple[int, int]]) -> None:
    scores = tuple(
        CandidateScore(1.0, usual_gains("computed_torque"), {"time": a, "energy": b}, "", 1.0, 1) for a, b in points
    )
    front = Optimum(
        CandidateScore(1.0, usual_gains("computed_torque"), {}, "", 1.0, 1),
        CandidateScore(1.0, usual_gains("computed_torque"), {}, "", 1.0, 1),
        scores,
        1.0,
    ).front("time", "energy")
    kept = [(each.terms["time"], each.terms["energy"]) for each in front]
    beaten = {p for p in points if any(q != p and q[0] <= p[0] and q[1] <= p[1] for q in points)}
    assert set(kept) == set(points) - beaten
    assert kept == sorted(kept)
    assert len(kept) == len(set(kept))


def test_weights_choose_what_counts() -> None:
    slow, fast = (score(SMALL, target_time, usual_gains("computed_torque")) for target_time in (3.0, 1.5))
    assert fast.cost == pytest.approx(1.0)  # its own reference
    by_time = replace(SMALL, reference=slow.terms)
    assert score(by_time, 1.5, usual_gains("computed_torque")).cost == pytest.approx(
        fast.terms["time"] / slow.terms["time"]
    )
    both = replace(by_time, weights={"time": 1.0, "tracking": 3.0})
    expected = (fast.terms["time"] / slow.terms["time"] + 3 * fast.terms["tracking"] / slow.terms["tracking"]) / 4
    assert score(both, 1.5, usual_gains("computed_torque")).cost == pytest.approx(expected)


@pytest.mark.parametrize(
    ("limits", "gains", "target_time", "broken"),
    [
        (Limits(), usual_gains("computed_torque", kp=(2000.0,) * 3), 2.0, "stability"),
        (Limits(voltage=2.0), usual_gains("computed_torque"), 2.0, "voltage"),
        (Limits(tracking=1e-4), usual_gains("computed_torque"), 2.0, "tracking"),
        (Limits(overshoot=1e-6), usual_gains("computed_torque"), 1.0, "overshoot"),
        (
            Limits(tracking=9.0, overshoot=9.0),
            usual_gains("computed_torque", kp=(20.0,) * 3, ki=(2.0,) * 3),
            0.6,
            "settling",
        ),
    ],
)
def test_broken_limits_are_named(limits: Limits, gains: Gains, target_time: float, broken: str) -> None:
    assert score(replace(SMALL, limits=limits), target_time, gains).broken == broken


def test_possible_arms_spread_as_the_covariance_says() -> None:
    names = ["K1", "D2", "offset1"]
    covariance = np.array([[4e-6, 1e-6, 0], [1e-6, 1e-6, 0], [0, 0, 1.0]])
    arms = possible_arms(ARM, names, covariance, 4000, np.random.default_rng(0))
    values = np.array([[arm.get("K1"), arm.get("D2")] for arm in arms])
    np.testing.assert_allclose(np.cov(values.T), covariance[:2, :2], rtol=0.15)
    np.testing.assert_allclose(values.mean(axis=0), [ARM.get("K1"), ARM.get("D2")], rtol=1e-3)
    assert all(arm.mass == ARM.mass for arm in arms)


def test_scenarios_cover_motions_noise_boxes_and_arms() -> None:
    other = replace(ARM, damping=(0.06, 0.06, 0.06))
    plain = scenarios_for(MOTIONS, ARM, (0.19, 0.21), noise=0.001)
    assert [s.noise for s in plain].count(0.001) == len(MOTIONS)
    assert {s.payload for s in plain if s.motion.carries} == {0.19, 0.2, 0.21}
    assert {s.payload for s in plain if not s.motion.carries} == {0.0}
    uncertain = scenarios_for(MOTIONS, ARM, (0.19, 0.21), [other])
    assert [s.motion for s in uncertain if s.arm == other] == list(MOTIONS)
    with pytest.raises(ParameterError, match="boxes"):
        scenarios_for(MOTIONS, ARM, (0.21, 0.19))


@pytest.mark.parametrize(
    ("weights", "message"),
    [({"speed": 1.0}, "unknown term 'speed'"), ({"time": -1.0}, "weight of time"), ({"time": 0.0}, "above 0")],
)
def test_wrong_costs_are_refused(weights: dict[str, float], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        replace(SMALL, weights=weights)


def test_wrong_searches_are_refused() -> None:
    with pytest.raises(ParameterError, match="target times: expected a range above 0 s"):
        optimise(SMALL, (2.0, 1.0))
    with pytest.raises(ParameterError, match="candidates: expected at least 80"):
        optimise(SMALL, (1.0, 2.0), candidates=10)
    with pytest.raises(ParameterError, match="--workers: expected at least 1"):
        optimise(SMALL, (1.0, 2.0), workforce=Workforce(0))


def test_the_usual_settings_of_the_cascade_keep_the_limits_on_paths_with_detours() -> None:
    """Some of its paths go beyond their goal on purpose, which is no overshoot; its gains lie within the search."""
    settings = ControlSettings(2.0, usual_gains("cascade"), "cascade", ArmParameters(), 0.2)
    objective = Objective(settings, scenarios_for(MOTIONS, ArmParameters(), (0.2, 0.2), (), 0.0))
    assert score(objective, 2.0, settings.gains).broken == ""
    found = optimise(objective, (2.0, 2.0), candidates=80, workforce=Workforce(1))
    assert not found.best.broken
    assert found.best.cost <= 1.0
