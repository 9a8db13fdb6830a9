"""Loads that nobody has weighed explain what least squares with all of them beside a cause would say."""

import numpy as np
import pytest

from dtwin.arm.chain import Array
from dtwin.monitoring.chain.drives import named
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


def test_a_cause_whose_ends_are_free_explains_beside_unknown_loads_what_least_squares_do() -> None:
    told = evidence()
    for first, begin, end, last in ((0, 4, 30, 30), (12, 14, 28, 40), (3, 3, 48, 48)):
        loads = [np.where(np.equal(number, HELD)[:, None], PART, 0.0)[:last].ravel() for number in (1, 2, 3)]
        base = np.linalg.qr(np.stack([each for each in loads if each.any()], axis=1))[0]

        def part(*rows: int, base: Array = base, last: int = last) -> Array:
            column: Array = np.zeros((last, 2))
            column[list(rows)] = CAUSES[list(rows), :, 1]
            return column.ravel() - base @ (base.T @ column.ravel())

        ends = [row for row in (begin - 1, begin, end - 1, end) if first <= row < last]
        free = np.stack([part(*range(begin + 1, end - 1)), *map(part, ends)], axis=1)
        left = INNOVATION[:last].ravel() - base @ (base.T @ INNOVATION[:last].ravel())
        left, free, whole = left[2 * first :], free[2 * first :], part(*range(begin, end))[2 * first :]
        sizes = np.linalg.lstsq(free, left, rcond=None)[0]
        gain = float(np.sum((left - whole * (whole @ left) / (whole @ whole)) ** 2 - (left - free @ sizes) ** 2))
        np.testing.assert_allclose(told.edged(1, (begin, end), (first, last)), (gain, sizes[0]), rtol=1e-9)


def test_a_push_that_begins_and_ends_within_a_filtered_sample_is_no_weaker_drive() -> None:
    push = np.full(60, -90.0)
    drive = np.concatenate([np.linspace(20.0, 40.0, 4), [100.0], np.linspace(220.0, 180.0, 9), [130.0], np.zeros(45)])
    acts = np.zeros(60)
    acts[5:14], acts[4], acts[14] = 1.0, 0.5, 0.7
    causes = np.stack([drive, push, -1.9 * push * acts], axis=1)[:, None, :]
    rows = np.einsum("nj,njc->nc", causes[:, :, 2], causes), np.einsum("njc,njc->nc", causes, causes)
    along, power = (np.vstack([np.zeros((1, 3)), np.cumsum(each, axis=0)]) for each in rows)
    told = Evidence(
        ("K1", "push1"), along, power, causes, np.zeros((60, 1)), starts_of(np.zeros(60, dtype=int)), None
    )
    assert told.between(4, 60)[0][0] > max(told.between(5, 14)[0][1], told.between(4, 15)[0][1])
    found = named(told, 0, 6, 60, 1.0, 0.0)
    assert (found.cause, found.others) == ("push1", ())
    assert found.size == pytest.approx(-1.9)


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
