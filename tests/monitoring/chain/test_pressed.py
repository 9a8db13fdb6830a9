"""Readings that repeat themselves while the feedback of an arm at rest presses on a joint."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.arm.chain import Array
from dtwin.monitoring.chain.pressed import HELD, LASTING, Mask, Pressed

PERIOD = 0.01


def watched(
    q: Array, target: Array, acting: Array, cuts: list[int], laden: Mask | None = None
) -> tuple[float, int] | None:
    """What is found first of samples that come in blocks, one joint that dry friction holds with 1 and no noise."""
    pressed = Pressed(np.ones(q.shape[1]), np.zeros(q.shape[1]))
    t: Array = PERIOD * np.arange(len(q), dtype=np.float64)
    edges = [0, *sorted(cuts), len(q)]
    blocks = [slice(a, b) for a, b in pairwise(edges) if b > a]
    held = np.zeros(len(q), bool) if laden is None else laden
    found = (pressed.first(t[part], q[part], target[part], acting[part], held[part]) for part in blocks)
    return next((each for each in found if each is not None), None)


def one_by_one(q: Array, target: Array, acting: Array) -> tuple[float, int] | None:
    """The same by its definition, sample by sample and joint by joint."""
    begins = np.zeros(q.shape[1], dtype=int)
    for k in range(1, len(q)):
        rests = bool((target[k] == target[k - 1]).all())
        begins[(q[k] != q[k - 1]) | (not rests)] = k
        for j, begin in enumerate(begins):
            part = acting[begin : k + 1 - LASTING, j]
            if len(part) and np.ptp(part) > HELD:
                return PERIOD * k, j
    return None


@pytest.mark.parametrize(("change", "found"), [(0.9 * HELD, False), (1.1 * HELD, True), (-1.1 * HELD, True)])
def test_a_command_that_changes_more_than_friction_can_hold_is_told(change: float, found: bool) -> None:
    still, growing = np.zeros((300, 2)), np.zeros((300, 2))
    growing[:, 1] = np.linspace(0.0, change, 300)
    told = watched(still, still, growing, [100, 200])
    assert (told is not None) is found
    if told is not None:
        assert told[1] == 1
        assert 2.5 < told[0] < 3.0


@pytest.mark.parametrize("moving", ["reading", "path"])
def test_nothing_is_told_where_the_joint_or_any_path_moves(moving: str) -> None:
    still, growing = np.zeros((300, 2)), np.repeat(np.linspace(0.0, 2.0 * HELD, 300)[:, None], 2, axis=1)
    goes = still + 1e-3 * (np.arange(300) // 50)[:, None]
    q, target = (goes, still) if moving == "reading" else (still, goes * [1.0, 0.0])
    assert watched(q, target, growing, []) is None


def test_a_box_that_is_taken_or_put_down_is_no_pressure() -> None:
    """The command changes with the box, and the joint stays, as the blocks count on it."""
    still, step = np.zeros((600, 1)), np.where(np.arange(600) < 200, 0.0, 2.0 * HELD)[:, None]
    assert watched(still, still, step, [], np.arange(600) >= 190) is None
    told = watched(still, still, step, [])
    assert told == pytest.approx((PERIOD * (200 + LASTING), 0))


def test_a_joint_that_gives_way_before_long_is_not_pressed() -> None:
    """What holds it may be taken away, and it falls."""
    still, step = np.zeros((600, 1)), np.where(np.arange(600) < 200, 0.0, 2.0 * HELD)[:, None]
    falls = still - 1e-3 * np.maximum(np.arange(600) - 210, 0)[:, None]
    assert watched(falls, still, step, []) is None


seldom = st.integers(0, 30).map(lambda number: number // 30)


@given(
    st.lists(st.tuples(seldom, seldom, st.integers(0, 9), st.integers(0, 9)), min_size=2, max_size=90),
    st.lists(st.integers(1, 89), max_size=4),
)
def test_blocks_and_many_samples_at_once_tell_what_single_ones_do(
    rows: list[tuple[int, int, int, int]], cuts: list[int]
) -> None:
    numbers = np.array(rows, dtype=np.float64)
    q, acting = numbers[:, [0, 0]] * [1.0, 0.0], numbers[:, 2:]
    target = np.repeat(np.cumsum(numbers[:, 1] * (numbers[:, 2] > 7.0))[:, None], 2, axis=1)
    assert watched(q, target, acting, [cut for cut in cuts if cut < len(rows)]) == one_by_one(q, target, acting)
