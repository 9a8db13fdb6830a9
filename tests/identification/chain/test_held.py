"""Motion in which something is held that nobody has weighed: its mass changes nothing, and the rest counts."""

from dataclasses import replace

import numpy as np

from dtwin.identification.chain.design import Rows, beside_loads, numbered

RANDOM = np.random.default_rng(3)
HELD = np.repeat([0, 1, 0, 2], 25)
POINT = RANDOM.normal(size=(100, 2))
ROWS = Rows(
    "",
    0.1,
    RANDOM.normal(size=(100, 2, 20)),
    (RANDOM.normal(size=(100, 3)), RANDOM.normal(size=(100, 3))),
    RANDOM.normal(size=(100, 2)),
    "",
)


def test_the_mass_of_what_is_held_changes_nothing() -> None:
    masses = np.array([0.0, 1.3, 0.4])[HELD]
    heavier = replace(ROWS, effort=ROWS.effort + masses[:, None] * POINT)
    made, other = (beside_loads(rows, [POINT], HELD, lambda columns: columns) for rows in (ROWS, heavier))
    np.testing.assert_allclose(made.effort, other.effort, atol=1e-12)
    np.testing.assert_allclose(made.rigid, other.rigid, atol=1e-12)


def test_rows_without_a_load_stay_and_others_keep_what_it_does_not_explain() -> None:
    made = beside_loads(ROWS, [POINT], HELD, lambda columns: columns)
    np.testing.assert_allclose(made.effort[HELD == 0], ROWS.effort[HELD == 0], atol=1e-12)
    for number in (1, 2):
        part = np.where(np.equal(number, HELD)[:, None], POINT, 0.0)
        np.testing.assert_allclose(np.sum(part * made.effort, axis=0), 0.0, atol=1e-12)
        assert np.sum(made.effort[number == HELD] ** 2) > 0.8 * np.sum(ROWS.effort[number == HELD] ** 2)


def test_a_box_counts_from_when_it_is_lifted_until_the_gripper_opens() -> None:
    laden = np.zeros(200, dtype=bool)
    laden[50:100] = laden[150:] = True
    numbers, counts = numbered(laden, 0.01)
    assert set(numbers[50:100]) == {1}
    assert set(numbers[150:]) == {2}
    assert np.array_equal(numbers > 0, laden)
    assert np.array_equal(np.flatnonzero(counts), [*range(80, 98), *range(180, 198)])
