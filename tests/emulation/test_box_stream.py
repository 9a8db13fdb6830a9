"""Arrival statistics, the rules of gripping and placing, and the score."""

from collections.abc import Iterator
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.emulation.boxes import Boxes
from dtwin.parameters import PICKUP, PLACES, GripperParameters
from dtwin.signals import BoxCounts
from dtwin.task import DEFAULT_TASK, REACH

GRIPPER = GripperParameters()
AT_PICKUP = (PICKUP.x, PICKUP.y)


def boxes(seed: int = 0) -> Boxes:
    return Boxes(np.random.default_rng(seed), GRIPPER, DEFAULT_TASK)


def holding(seed: int = 0) -> Boxes:
    stream = boxes(seed)
    stream.arrive(0.0)
    stream.grip(1.0, AT_PICKUP, GRIPPER.closed)
    assert stream.held is not None
    return stream


def arrivals(stream: Boxes) -> Iterator[tuple[float, float, str]]:
    while True:
        time = stream.next_arrival
        stream.arrive(time)
        assert stream.waiting is not None
        yield time, stream.waiting.mass, stream.waiting.colour
        stream.waiting = None


def test_first_arrivals_are_uniform_between_a_half_and_fifteen_and_a_half_seconds() -> None:
    first = np.array([boxes(seed).next_arrival for seed in range(2000)])
    assert first.min() >= 0.5
    assert first.max() <= 15.5
    # Five standard errors of a uniform's mean: 5 * 15 / sqrt(12 * 2000).
    assert first.mean() == pytest.approx(8.0, abs=0.5)


def test_stream_statistics() -> None:
    n = 20_000
    times, masses, colours = zip(*islice(arrivals(boxes()), n), strict=True)
    hundredths = np.array(times) * 100
    assert np.abs(hundredths - hundredths.round()).max() < 1e-6
    intervals = np.diff(times)
    assert intervals.min() >= 0
    assert intervals.max() <= 30 + 1e-9
    assert intervals.mean() == pytest.approx(15.0, abs=5 * 30 / np.sqrt(12 * n))
    assert min(masses) >= 0.190
    assert max(masses) < 0.210
    assert np.mean(masses) == pytest.approx(0.200, abs=5 * 0.020 / np.sqrt(12 * n))
    for colour in PLACES:
        assert colours.count(colour) / n == pytest.approx(1 / 3, abs=5 * np.sqrt(2 / 9 / n))


def test_stream_does_not_depend_on_what_happens_to_the_boxes() -> None:
    served, ignored = boxes(3), boxes(3)
    for _ in range(50):
        assert served.next_arrival == ignored.next_arrival
        served.arrive(0.0)
        ignored.arrive(0.0)
        served.waiting = None
    assert served.counts.arrived == 50
    assert (ignored.counts.arrived, ignored.counts.turned_away) == (1, 49)


def test_gripping_and_delivering() -> None:
    stream = holding()
    box = stream.held
    assert box is not None
    place = PLACES[box.colour]
    event = stream.release(2.0, (place.x + 0.003, place.y - 0.004))
    assert event is not None
    assert (event.time, event.kind) == (2.0, "delivered")
    assert stream.counts == BoxCounts(arrived=1, picked=1, delivered=1)
    (error,) = stream.placement_errors_mm
    assert error == pytest.approx(5.0)
    assert stream.held is None


def test_letting_go_away_from_the_place_misplaces() -> None:
    stream = holding()
    assert stream.held is not None
    held = stream.held.colour
    wrong = next(place for colour, place in PLACES.items() if colour != held)
    event = stream.release(2.0, (wrong.x, wrong.y))
    assert event is not None
    assert event.kind == "misplaced"
    assert stream.counts == BoxCounts(arrived=1, picked=1, misplaced=1)


@pytest.mark.parametrize(
    ("arrived", "tip", "gripper", "reason"),
    [
        (False, AT_PICKUP, GRIPPER.closed, "no box is waiting"),
        (True, (PICKUP.x + 1.01 * REACH, PICKUP.y), GRIPPER.closed, "20.2 mm from the pickup point"),
        (True, AT_PICKUP, GRIPPER.opened, "open at 0.900 rad"),
    ],
)
def test_missed_grip_says_why(arrived: bool, tip: tuple[float, float], gripper: float, reason: str) -> None:
    stream = boxes()
    if arrived:
        stream.arrive(0.0)
    event = stream.grip(1.0, tip, gripper)
    assert event.kind == "grip_missed"
    assert reason in event.text
    assert stream.held is None
    assert (stream.waiting is not None) == arrived
    assert stream.counts.picked == 0


def test_a_slipped_box_is_misplaced() -> None:
    stream = holding()
    event = stream.slip(2.0)
    assert event is not None
    assert event.kind == "slipped"
    assert stream.release(3.0, AT_PICKUP) is None
    assert stream.slip(4.0) is None
    assert stream.counts == BoxCounts(arrived=1, picked=1, misplaced=1)


@given(st.lists(st.sampled_from(("arrive", "grip", "release", "slip")), max_size=40), st.integers(0, 5))
def test_every_box_is_accounted_for(actions: list[str], seed: int) -> None:
    stream = boxes(seed)
    place = PLACES["red"]
    for action in actions:
        match action:
            case "arrive":
                stream.arrive(0.0)
            case "grip" if stream.held is None:
                stream.grip(0.0, AT_PICKUP, GRIPPER.closed)
            case "release":
                stream.release(0.0, (place.x, place.y))
            case "slip":
                stream.slip(0.0)
    counts = stream.counts
    assert counts.held == (stream.held is not None)
    assert counts.arrived == counts.picked + (stream.waiting is not None)
    assert counts.picked == counts.delivered + counts.misplaced + counts.held
    assert counts.arrived + counts.turned_away == actions.count("arrive")
    assert len(stream.placement_errors_mm) == counts.delivered
