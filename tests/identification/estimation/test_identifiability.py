from typing import Any

import numpy as np
import pytest

from dtwin.identification.estimation.identifiability import (
    Identifiability,
    analyse,
    null_space,
    parameter_sensitivity,
)
from dtwin.identification.estimation.problem import Prior, Problem
from dtwin.identification.excitation.plan import Plan
from dtwin.parameters import PayloadModel
from tests.support.identification import ALL, ARM, FREE, NO_MASSES


def problem(free: tuple[str, ...], payloads: list[float], model: PayloadModel = "weight", **kwargs: Any) -> Problem:
    plans = [Plan(payload=payload, payload_model=model) for payload in payloads]
    return Problem(tuple(plan.experiment() for plan in plans), free, ARM, **kwargs)


def finding(*arguments: Any, **kwargs: Any) -> Identifiability:
    subject = problem(*arguments, **kwargs)
    return analyse(subject, subject.start())


@pytest.mark.parametrize(
    ("model", "free", "payloads", "rank"),
    [
        ("weight", ALL, [0.2], 14),
        ("weight", ALL, [0.0], 13),
        ("weight", ALL, [0.0, 0.2], 15),
        ("weight", NO_MASSES, [0.0, 0.2], 15),
        ("weight", FREE, [0.2], 12),
        ("weight", FREE, [0.0], 11),
        ("point", ALL, [0.2], 13),
        ("point", ALL, [0.0, 0.2], 15),
        ("point", FREE, [0.2], 11),
        ("point", FREE, [0.0, 0.2], 12),
    ],
)
def test_ranks(model: PayloadModel, free: tuple[str, ...], payloads: list[float], rank: int) -> None:
    assert finding(free, payloads, model).rank == rank


def test_both_runs_leave_one_direction_a_link() -> None:
    found = finding(ALL, [0.0, 0.2])
    assert found.identifiable == tuple(name for name in ALL if name[0] in "KlD")
    assert sum(found.missing) == 3
    assert {name[0] for group in found.combinations for name in group} == set("mIc")
    assert found.text().endswith("To determine the rest: fix the masses.")
    assert "These data fix 15 of 18 parameters" in found.text()


def test_the_finding_in_words() -> None:
    found = finding(ALL, [0.0])
    assert "l1, l2 are determined" in found.text()
    assert "l3 not at all" in found.text()
    assert "add a run with another payload and fix the masses" in found.text()
    assert finding(FREE, [0.2]).text() == "All 12 free parameters are determined."


def test_following_the_advice_works() -> None:
    found = finding(FREE, [0.0])
    assert found.unidentifiable == FREE
    assert found.advice == "To determine the rest: add a run with another payload."
    assert finding(FREE, [0.0, 0.2]).unidentifiable == ()


def test_one_prior_sets_the_common_scale() -> None:
    assert finding(FREE, [0.0], priors={"D2": Prior(0.05, 0.01)}).rank == 12


def test_null_directions_do_not_move_the_arm() -> None:
    subject = problem(ALL, [0.2])
    x = subject.start()
    null = null_space(parameter_sensitivity(subject, x))
    assert null.shape == (18, 4)
    angles = subject.simulate(x)[0]
    size = np.linalg.norm(subject.sensitivity(x, [np.ones(3)])[:, :18], axis=0)
    for direction in null.T / size:
        step = np.zeros_like(x)
        step[:18] = 1e-5 * direction / np.abs(direction).max()
        moved = np.abs(subject.simulate(x + step)[0] - angles).max()
        signs = np.random.default_rng(0).choice((-1.0, 1.0), len(x))
        elsewhere = np.abs(subject.simulate(x + step * signs)[0] - angles).max()
        assert moved < 1e-3 * elsewhere
