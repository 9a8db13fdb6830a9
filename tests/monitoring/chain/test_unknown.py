"""Loads that nobody has weighed explain what least squares with all of them beside a cause would say."""

import numpy as np

from dtwin.arm.chain import Array
from dtwin.monitoring.chain.gathering import Evidence
from dtwin.monitoring.chain.unknown import Shared, starts_of

HELD = np.repeat([0, 1, 0, 2, 3, 0], 8)
RANDOM = np.random.default_rng(1)
INNOVATION = RANDOM.normal(size=(len(HELD), 2))
CAUSES = RANDOM.normal(size=(len(HELD), 2, 3))  # the first one is the load
PART = np.where(HELD[:, None] > 0, CAUSES[:, :, 0], 0.0)


def evidence() -> Evidence:
    columns = np.concatenate([CAUSES, INNOVATION[:, :, None]], axis=2)
    rows = np.einsum("nj,njc->nc", INNOVATION, columns), np.einsum("njc,njc->nc", columns, columns)
    along, power = (np.vstack([np.zeros((1, each.shape[1])), np.cumsum(each, axis=0)]) for each in rows)
    starts = starts_of(HELD)
    return Evidence(("load", "a", "b"), along, power, columns, PART, starts, Shared.of(PART, columns, starts))


def least_squares(first: int, last: int, cause: int) -> tuple[float, float]:
    """Likelihood ratio and size of a cause over some samples, beside loads that all samples up to there tell of."""
    loads = np.stack(
        [np.where(np.equal(number, HELD)[:, None], PART, 0.0)[:last].ravel() for number in (1, 2, 3)], axis=1
    )
    told = np.flatnonzero(np.abs(loads).sum(axis=0))
    base = np.linalg.qr(loads[:, told])[0]
    column: Array = np.zeros((last, 2))
    column[first:] = CAUSES[first:last, :, cause]
    beside, left = (each - base @ (base.T @ each) for each in (column.ravel(), INNOVATION[:last].ravel()))
    along, power = float(beside @ left), float(beside @ beside)
    return along**2 / power, along / power


def test_what_a_cause_and_unknown_loads_leave_is_what_least_squares_leave() -> None:
    told = evidence()
    for first, begin, end, last in ((0, 4, 30, 30), (12, 14, 28, 28), (18, 20, 25, 40), (3, 3, 48, 48)):
        loads = [np.where(np.equal(number, HELD)[:, None], PART, 0.0)[:last].ravel() for number in (1, 2, 3)]
        column: Array = np.zeros((last, 2))
        column[begin:end] = CAUSES[begin:end, :, 1]
        rest = (INNOVATION[:last] - 0.7 * column).ravel()
        rows = np.stack([each for each in loads if each.any()], axis=1)
        rest = (rest - rows @ np.linalg.lstsq(rows, rest, rcond=None)[0]).reshape(-1, 2)
        expected = float(np.sum(rest[first:] ** 2))
        np.testing.assert_allclose(told.left(1, 0.7, (begin, end), (first, last)), expected, rtol=1e-9)


def test_causes_beside_unknown_loads_are_those_of_least_squares() -> None:
    told = evidence()
    for first in range(0, len(HELD) - 2, 3):
        for last in range(first + 2, len(HELD) + 1):
            ratio, size = told.between(first, last)
            for cause in (1, 2):
                np.testing.assert_allclose((ratio[cause], size[cause]), least_squares(first, last, cause), rtol=1e-9)


def test_a_load_that_is_held_all_the_time_is_told_of_by_nothing() -> None:
    told = evidence()
    assert told.between(8, 16)[0][0] == 0.0
    assert told.seen(8, 16)[0] == 0.0
    assert told.between(0, 8)[0][0] > 0.0


def test_evidence_does_not_depend_on_samples_that_come_later() -> None:
    ratios = evidence().over(6)[0]
    rows = slice(0, 20)
    columns = np.concatenate([CAUSES, INNOVATION[:, :, None]], axis=2)[rows]
    sums = np.einsum("nj,njc->nc", INNOVATION[rows], columns), np.einsum("njc,njc->nc", columns, columns)
    along, power = (np.vstack([np.zeros((1, 4)), np.cumsum(each, axis=0)]) for each in sums)
    starts = starts_of(HELD[rows])
    early = Evidence(
        ("load", "a", "b"), along, power, columns, PART[rows], starts, Shared.of(PART[rows], columns, starts)
    )
    np.testing.assert_allclose(early.over(6)[0], ratios[rows], rtol=1e-9, atol=1e-12)
