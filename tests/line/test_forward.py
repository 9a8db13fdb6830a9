"""Simulations that go on from the line as it is, and operations that move back a zone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dtwin.line.control import Control, OneResource
from dtwin.line.file import line_of
from dtwin.line.line import BoxClass, Line
from dtwin.line.plant import Plant
from dtwin.line.station import Station, TimedStation, WorkTimes
from dtwin.line.twins.forward import Change, Forward
from dtwin.line.twins.zone import AHEAD, HOUR, LASTING, SETTLING, in_an_hour, lasting
from evidence.line.answer import soonest_taken

FULL = replace(line_of("default"), source=replace(line_of("default").source, every=12.0))
TIMES = {
    each.name: WorkTimes(
        0.5, dict.fromkeys(("blue", "red", "green"), 2.8), dict.fromkeys(("blue", "red", "green"), 2.3)
    )
    for each in FULL.stations
}
BACK = {"deburr": "a1", "mark": "a2", "test": "a2", "pack": "b2"}


def running(line: Line, cycles: int) -> tuple[Plant, Control]:
    stations: dict[str, Station] = {name: TimedStation(times) for name, times in TIMES.items()}
    plant, control = Plant(line, stations), Control(line, OneResource(line))
    assert control.set_up(line.assignment)
    go_on(plant, control, cycles)
    return plant, control


def go_on(plant: Plant, control: Control, cycles: int) -> None:
    for _ in range(cycles):
        plant.advance()
        control.step(plant)


def test_a_simulation_goes_on_as_the_line_does() -> None:
    plant, control = running(FULL, 1500)
    now, before = control.now(plant), len(plant.left)
    assert now is not None
    blocks = OneResource(FULL)
    assert isinstance(control.blocks, OneResource)
    memory = control.blocks.memory()
    if memory is not None:  # as it is told over the bus
        now = replace(now, blocks=blocks.recall(memory))
    told = Forward(FULL).left(now, Change(FULL.assignment, TIMES), 120.0)
    go_on(plant, control, 1200)
    assert told is not None
    assert [round(time + 150.0, 6) for time, _ in told] == [time for _, time in plant.left[before:]]
    assert told


def test_no_box_leaves_unfinished_when_an_operation_moves_back_a_zone() -> None:
    line = replace(FULL, assignment={"deburr": "a1", "mark": "b1", "test": "b1", "pack": "b2"})
    plant, control = running(line, 1500)
    assert control.set_up(BACK)
    go_on(plant, control, 1200)
    assert len(plant.left) > 5
    assert plant.unfinished == 0


def test_a_vehicle_that_waits_for_its_box_is_not_sent_away_for_one_that_comes_just_now() -> None:
    """What a vehicle fetches next is decided in the very cycle in which it has put its box down, too."""
    classes = (BoxClass("heavy", 0.21), BoxClass("light", 0.1))
    source = replace(FULL.source, every=1000.0, lightest=0.1, masses=(0.1, 0.21), classes=classes)
    stations = {"deburr.heavy": "a2", "mark.heavy": "a2", "test.heavy": "b1", "pack.heavy": "b2"}
    stations |= {"deburr.light": "a1", "mark.light": "a2", "test.light": "b1", "pack.light": "b2"}
    plant, control = running(replace(FULL, source=source, assignment=stations), 0)
    while not any(event.kind == "unloaded" for event in plant.events):
        control.step(plant)
        plant.advance()
    plant.source = plant.new_box()
    go_on(plant, control, 80)
    assert plant.vehicles["a_agv1"].path == ["a1_dock"]
    assert [(event.who, event.text) for event in plant.events if event.kind == "loaded"][1:] == [("a_agv2", "source")]


def test_what_driving_takes_is_how_soon_a_moved_box_is_taken_up_with_the_set_up_in_force_at_once() -> None:
    plant, control = running(FULL, 1500)
    now = control.now(plant)
    assert now is not None
    other = {**FULL.assignment, "mark": "a1"}
    soonest = soonest_taken(FULL, now, Change(other, TIMES, ("a2",)))
    assert control.set_up(other)
    control.stopped = {"a2"}
    failed = plant.stations["a2"].station
    assert isinstance(failed, TimedStation)
    failed.resume(now.plant.stations[1], plant.time, True)
    before = len(plant.events)
    go_on(plant, control, 600)
    taken = [
        each.time for each in plant.events[before:] if (each.kind, each.text, each.who) == ("work", "mark", "a1")
    ]
    assert soonest == taken[0]
    assert soonest_taken(FULL, now, Change(dict(FULL.assignment), TIMES)) is None, "nothing has moved"


def test_an_hour_is_what_was_simulated_and_its_rate_after_the_first_minute() -> None:
    late = tuple((SETTLING + 20.0 * k, 0) for k in range(1, 11))
    assert in_an_hour(late) == pytest.approx(10 + 180.0 * (3600.0 - SETTLING - 200.0) / 3600.0)
    early = tuple((10.0 * k, 0) for k in range(1, 4))
    assert in_an_hour((*early, *late)) == pytest.approx(in_an_hour(late) + 3)
    assert in_an_hour(early) == pytest.approx(3.0 * 3600.0 / AHEAD), "a line that stands is not taken for a fast one"
    assert in_an_hour(()) == 0.0


def test_a_second_look_counts_boxes_by_how_probable_it_is_that_the_set_up_still_lasts() -> None:
    even = tuple((10.0 * k, 0) for k in range(1, 361))
    assert lasting(even, HOUR) == pytest.approx(360.0, rel=0.01)
    soon, late = even[:180], even[180:]
    assert lasting(soon, HOUR) + lasting(late, HOUR) == pytest.approx(lasting(even, HOUR))
    assert lasting(soon, HOUR) / lasting(late, HOUR) == pytest.approx(math.exp(HOUR / 2.0 / LASTING))
    assert lasting((), HOUR) == 0.0


def test_boxes_come_from_the_zone_before_only_while_there_is_room_and_the_later_ones_later() -> None:
    plant, control = running(FULL, 1500)
    now = control.now(plant)
    assert now is not None
    forward, share = Forward(FULL), {"test": "b1", "pack": "b2"}
    change = Change(share, TIMES)
    early = tuple((float(second), 0) for second in range(60))
    crowd = forward.left_zone(1, now, change, 400.0, early)
    paused = forward.left_zone(1, now, change, 400.0, (*early[:10], *((time + 90.0, 0) for time, _ in early[10:])))
    assert crowd is not None
    assert paused is not None
    assert len(paused) < len(crowd) < len(early)
    assert max(np.diff([time for time, _ in paused])) > 20.0 + max(np.diff([time for time, _ in crowd]))
