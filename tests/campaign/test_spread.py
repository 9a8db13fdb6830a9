"""Campaigns on this machine: order, lost workers, and tasks that fail."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from dtwin.campaign.spread import Workers, Workforce, spread
from dtwin.errors import ParameterError, TaskError
from tests.support.tasks import die, invert, killing, work

ALONE, TWO = Workforce(1), Workforce(2)
SEEDS = (1, 2, 3, 4)
both = pytest.mark.parametrize("workforce", [ALONE, TWO], ids=["alone", "two"])


@both
def test_results_come_in_the_order_of_the_items(workforce: Workforce) -> None:
    told: list[tuple[int, int]] = []
    assert spread(math.sqrt, [16.0, 4.0, 9.0], workforce, lambda *now: told.append(now)) == [4.0, 2.0, 3.0]
    assert told == [(1, 3), (2, 3), (3, 3)]
    assert spread(math.sqrt, [], workforce) == []


@both
def test_a_task_that_fails_is_named_and_the_first_one_counts(workforce: Workforce) -> None:
    with Workers(workforce) as workers:
        assert workers.map(invert, [1]) == [1.0]
        with pytest.raises(TaskError, match=r"^task 2 of 4, number 0: ZeroDivisionError: division by zero") as caught:
            workers.map(invert, [1, 0, -1, 0], name="number {}".format)
        assert "return 1 / number" in "".join(caught.value.__notes__)
        with pytest.raises(TaskError, match=r"^task 2 of 3, -2: the task diverged at t = 1.0000 s"):
            workers.map(invert, [1, -2, 0])
        assert workers.map(invert, [2, 4]) == [0.5, 0.25]


def test_the_task_of_a_killed_worker_is_done_again(tmp_path: Path) -> None:
    with killing(tmp_path, work, SEEDS[1]) as task:
        logs = spread(task, SEEDS, TWO)
    assert logs == [work(seed) for seed in SEEDS]
    assert len(set(logs)) == len(SEEDS)


def test_a_task_that_takes_every_worker_with_it_is_named() -> None:
    with Workers(TWO) as workers:
        with pytest.raises(TaskError, match=r"^task 2 of 4, 3: 3 processes that began it were lost$"):
            workers.map(die, [2, 3, 4, 6])
        assert workers.map(die, [2, 4]) == [2, 4]


def test_a_wrong_workforce_is_refused() -> None:
    with pytest.raises(ParameterError, match="--workers: expected at least 1, got 0"):
        Workforce(0)
    with pytest.raises(ParameterError, match="--workers, --scheduler: expected one of them"):
        Workforce(2, "tcp://127.0.0.1:8786")
