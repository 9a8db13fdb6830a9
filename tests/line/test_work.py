"""How long an arm takes, measured in what its ticks tell."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.bus.line.situation import StationNow
from dtwin.line.station import HOLDING, TimedStation, WorkTimes
from dtwin.line.twins.work import MeasuredWork
from dtwin.signals import EventKind

PLACES = ("blue", "red")
REHEARSED = WorkTimes(1.0, {"blue": 2.0, "red": 2.5}, {"blue": 1.5, "red": 1.0})
PERIOD = 0.01
Box = tuple[int, int, int, int, int]


def ticks(boxes: list[Box]) -> list[tuple[int, bool]]:
    """The ticks of boxes: number of the place, and how many ticks nobody offers it after the box before, the arm
    grips, carries and goes back, which it does while nobody offers the next one, and after that."""
    found, returning = [], 0
    for place, waits, grip, carry, back in boxes:
        found += [(0, False)] * waits + [(place, False)] * (max(returning - waits, 0) + grip) + [(0, True)] * carry
        returning = back
    return found + [(0, False)] * returning


LENGTH = st.integers(1, 90)


@given(st.integers(1, 2), st.integers(3, 40), LENGTH, LENGTH, st.integers(20, 90), st.data())
def test_what_was_done_often_enough_is_told_as_it_was(
    place: int, count: int, grip: int, carry: int, back: int, data: st.DataObject
) -> None:
    """Of an arm that boxes always wait for, way back and grip are known together alone."""
    work = MeasuredWork(PLACES, PERIOD)
    waits = data.draw(st.integers(0, max(0, back + grip - round(REHEARSED.grip / PERIOD) - 6)))
    all_ticks = ticks([(place, waits, grip, carry, back)] * count + [(place, 0, 1, 1, 1)])
    cut = data.draw(st.integers(0, len(all_ticks)))
    work.follow(all_ticks[:cut])
    work.follow(all_ticks[cut:])
    name, other = PLACES[place - 1], PLACES[2 - place]
    found = work.times(REHEARSED)
    assert found.carry[name] == pytest.approx(PERIOD * carry, abs=1e-9 if count > 3 else PERIOD * carry)
    assert found.carry[other] / REHEARSED.carry[other] == pytest.approx(found.carry[name] / REHEARSED.carry[name])
    if max(back - waits, 0) + grip > round(REHEARSED.grip / PERIOD) + 5:
        assert found.grip == REHEARSED.grip
        assert found.grip + found.back[name] == pytest.approx(PERIOD * (max(back, waits) + grip))
        assert found.back[other] / REHEARSED.back[other] == pytest.approx(found.back[name] / REHEARSED.back[name])


@given(st.lists(st.integers(0, 900), min_size=12, max_size=40), LENGTH, st.integers(100, 150))
def test_a_simulated_arm_takes_as_long_as_the_measured_one(waits: list[int], grip: int, back: int) -> None:
    """Whatever boxes come when: it grips each when the arm did whose times it has."""
    boxes = [(1, wait, grip, 200, back) for wait in (900, 900, 900, *waits, 0, 0, 0)]
    work = MeasuredWork(PLACES, PERIOD)
    work.follow(ticks(boxes))
    found = work.times(REHEARSED)
    for wait in waits:
        real, told = max(wait, back) + grip, max(PERIOD * wait, found.back["blue"]) + found.grip
        assert told == pytest.approx(PERIOD * real, abs=0.05 + 1e-9)


def test_an_arm_that_waited_for_a_box_tells_nothing_of_its_way_back() -> None:
    work = MeasuredWork(PLACES, PERIOD)
    work.follow(ticks([(1, 900, 100, 200, 150)] * 5))
    assert work.times(REHEARSED).back == REHEARSED.back


def test_boxes_that_come_while_the_arm_is_on_its_way_back_tell_no_longer_grip() -> None:
    """Else an arm that boxes wait for now and then would be taken to grip as late when it has waited."""
    work = MeasuredWork(PLACES, PERIOD)
    work.follow(ticks([(1, 900, 50, 200, 430), (1, 230, 50, 200, 430)] * 5))
    found = work.times(WorkTimes(0.5, {"blue": 2.0}, {"blue": 4.3}))
    assert (found.grip, found.back["blue"]) == pytest.approx((0.5, 4.3))


def test_a_box_that_is_taken_away_and_one_held_at_a_stop_tell_nothing() -> None:
    work = MeasuredWork(PLACES, PERIOD)
    work.follow([(1, False)] * 50 + [(0, False)] * 300)
    work.follow([(2, False)] * 100 + [(0, True)] * 50)
    work.interrupt()
    work.follow([(0, True)] * 500 + [(0, False)] * 100)
    assert work.times(REHEARSED) == WorkTimes(1.0, REHEARSED.carry, REHEARSED.back)


def test_an_arm_that_becomes_slower_is_reckoned_with_as_it_is_now() -> None:
    work = MeasuredWork(PLACES, PERIOD)
    usual, slow = (1, 0, 100, 200, 150), (1, 0, 120, 260, 180)
    work.follow(ticks([usual] * 12))
    assert work.slowness == pytest.approx(1.0)
    assert work.times(REHEARSED).carry["blue"] == pytest.approx(2.0)
    work.follow(ticks([slow] * 6))
    assert work.slowness == pytest.approx(1.3)
    found = work.times(REHEARSED)
    assert (found.grip + found.back["blue"], found.carry["blue"]) == pytest.approx((1.2 + 1.8, 2.6))
    work.follow(ticks([usual] * 6))
    assert work.slowness == pytest.approx(1.0)


def test_lighter_boxes_may_take_longer_without_the_arm_being_slower() -> None:
    work = MeasuredWork(PLACES, PERIOD)
    heavy, light = (1, 0, 100, 200, 150), (1, 0, 100, 240, 150)
    for box, kind in [(heavy, 0)] * 8 + [(light, 1)] * 8:
        all_ticks = ticks([box])
        work.follow(all_ticks[:250], kind)  # what the arm has is looked at while it has it
        work.follow(all_ticks[250:], 0)
    assert work.slowness == pytest.approx(1.0)
    found = work.times(REHEARSED)
    assert found.carry["blue"] == pytest.approx(2.2)
    assert [found.carried("blue", kind) for kind in (0, 1, 2)] == pytest.approx([2.0, 2.4, 2.2])
    assert found.carried("red", 1) == pytest.approx(found.carry["red"])
    for _ in range(5):
        all_ticks = ticks([(1, 0, 100, 300, 150)])
        work.follow(all_ticks[:250], 1)
        work.follow(all_ticks[250:], 0)
    assert work.slowness == pytest.approx(1.25)


def test_classes_that_nobody_has_seen_yet_take_as_much_longer_as_the_others() -> None:
    work = MeasuredWork(PLACES, PERIOD)
    rehearsed = replace(REHEARSED, classes={("blue", 0): 1.6, ("blue", 1): 1.8, ("red", 0): 2.0, ("red", 1): 2.2})
    assert work.times(rehearsed).classes == rehearsed.classes
    work.follow(ticks([(1, 0, 100, 200, 150)] * 3))
    told = work.times(rehearsed).classes
    assert told == pytest.approx({("blue", 0): 2.0, ("blue", 1): 2.25, ("red", 0): 2.5, ("red", 1): 2.75})


@pytest.mark.parametrize(("mass", "carry"), [(0.2, 2.0), (0.1, 2.4)])
def test_a_simulated_arm_takes_as_long_as_it_does_for_boxes_of_a_class(mass: float, carry: float) -> None:
    times = WorkTimes(1.0, {"blue": 2.2}, {"blue": 1.5}, {("blue", 0): 2.0, ("blue", 1): 2.4})
    begun, going_on = (TimedStation(times, lambda mass: int(mass < 0.15)) for _ in range(2))
    begun.advance(1000)
    begun.give("bring", mass, "blue")
    going_on.resume(StationNow("a1", 0, 1, 0, HOLDING, "blue", 11.0, "", 0.0), 11.0, False, int(mass < 0.15))
    for station, ticks in ((begun, 500), (going_on, 400)):
        (delivered,) = [e.time for e in station.advance(ticks).events if e.kind == EventKind.DELIVERED]
        assert delivered == pytest.approx(11.0 + carry)


def test_nobody_is_slower_than_at_first_before_enough_boxes_were_brought() -> None:
    work = MeasuredWork(PLACES, PERIOD)
    work.follow(ticks([(1, 0, 100, 200, 150), (2, 0, 100, 400, 150)] * 2))
    assert work.slowness is None
