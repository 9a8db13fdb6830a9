"""Drawn machines at work: the figures of a run, the judgement, and the page."""

from dataclasses import dataclass

import msgspec
import numpy as np
import pytest

from dtwin.campaign.spread import Workforce
from dtwin.signals import BoxCounts
from evidence.sorting import MachineAtWork, longest, machines_at_work, settled, sorting_report


@pytest.mark.parametrize(
    ("flags", "expected"), [("", 0), ("000", 0), ("1", 1), ("0110111", 3), ("1111", 4), ("11011", 2)]
)
def test_the_longest_run_is_found(flags: str, expected: int) -> None:
    assert longest(np.array([flag == "1" for flag in flags], dtype=bool)) == expected


def test_a_drawn_machine_delivers_its_first_box() -> None:
    (found,) = machines_at_work(701, 1, 0, 40.0, Workforce(1), lambda done, of: None)
    assert found.number == 701
    assert found.boxes.delivered >= 1
    assert settled([found])
    assert "1 machines" in sorting_report([found], 40.0).text


def test_a_joint_that_sticks_and_repeats_its_code_stops_no_drawn_machine() -> None:
    (found,) = machines_at_work(7, 1, 5, 45.0, Workforce(1), lambda done, of: None)
    assert found.boxes.delivered >= 2


GOOD = MachineAtWork(1, BoxCounts(30, 2, 30, 29, 0, 1), 3.0, 0, 0, 0.02)


@dataclass(frozen=True)
class Flaw:
    name: str
    value: object


@pytest.mark.parametrize(
    "flaw",
    [
        Flaw("farthest", 5.1),
        Flaw("touched", 1),
        Flaw("slipped", 1),
        Flaw("saturated", 0.06),
        Flaw("boxes", BoxCounts(30, 2, 30, 28, 1, 1)),
    ],
    ids=lambda flaw: flaw.name,
)
def test_each_flaw_counts(flaw: Flaw) -> None:
    assert settled([GOOD])
    assert not settled([GOOD, msgspec.structs.replace(GOOD, **{flaw.name: flaw.value})])
