"""Where the boxes are, read from a log."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from dtwin.logs.log import COLUMNS, Log
from dtwin.parameters import PLACES, Colour
from dtwin.view.boxes import Grasp, Waiting, grasps, placements, waiting


def log_of(ticks: int, present: dict[range, str], gripped: range, loaded: range) -> Log:
    """A log in which boxes wait, the grip is commanded and a payload hangs on the arm in the given ticks."""
    columns: dict[str, npt.NDArray[Any]] = {name: np.zeros(ticks) for name in COLUMNS}
    columns["t"] = 0.01 * np.arange(ticks)
    colours = np.full(ticks, "", dtype="<U9")
    for span, colour in present.items():
        colours[list(span)] = colour
    columns["box_colour"] = colours
    columns["box_present"] = colours != ""
    columns["box_gripped"] = np.isin(np.arange(ticks), gripped)
    columns["payload_mass"] = 0.2 * np.isin(np.arange(ticks), loaded)
    return Log(columns)


def test_a_box_waits_until_it_is_picked() -> None:
    log = log_of(20, {range(3, 8): "red", range(12, 20): "blue"}, range(7, 15), range(8, 15))
    assert waiting(log) == [Waiting(0, ""), Waiting(3, "red"), Waiting(8, ""), Waiting(12, "blue")]


def test_a_transport_has_the_colour_of_the_box_that_waited() -> None:
    """The next box may arrive in the very tick in which the first is lifted."""
    log = log_of(20, {range(3, 8): "red", range(8, 20): "blue"}, range(7, 15), range(8, 15))
    assert grasps(log) == [Grasp(8, 15, "red")]


def test_a_box_still_held_at_the_end_is_not_placed() -> None:
    log = log_of(10, {range(2): "green"}, range(2, 10), range(3, 10))
    assert grasps(log) == [Grasp(3, None, "green")]
    assert placements(grasps(log), np.zeros((0, 3)), PLACES) == []


def test_neither_grip_nor_payload_alone_is_a_box() -> None:
    assert grasps(log_of(10, {}, range(2, 5), range(6, 9))) == []


@pytest.mark.parametrize("name", PLACES)
def test_a_box_is_at_the_place_it_was_released_over(name: Colour) -> None:
    place = PLACES[name]
    spots = np.array([[place.x + 0.004, 0.0, place.y], [place.x, 0.0, place.y + 0.06]])
    near, far = placements([Grasp(2, 5, "red"), Grasp(8, 9, "blue")], spots, PLACES)
    assert (near.tick, near.colour, near.place) == (5, "red", name)
    assert (far.tick, far.colour, far.place) == (9, "blue", None)
