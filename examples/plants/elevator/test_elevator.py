"""Every call is served, in the order of the direction, and the cabin never moves with an open door."""

import pytest

from iec61499.testing import block, system


def called(plant, *floors: int) -> None:
    for floor in floors:
        plant["ELEVATOR.CALLED"] = floor
        plant.trigger("ELEVATOR.CALL")


def served(plant, seconds: int) -> list[int]:
    """The floors at which the door opens, in their order."""
    stops: list[int] = []
    for _ in range(20 * seconds):
        before = plant["CABIN.IS_OPEN"], plant["CABIN.HEIGHT"], plant["CABIN.IS_CLOSED"]
        plant.advance("T#50ms")
        if plant["CABIN.IS_OPEN"] and not before[0]:
            stops.append(plant["CABIN.FLOOR"])
        assert before[2] or plant["CABIN.HEIGHT"] == before[1], "moves with an open door"
    return stops


@pytest.mark.parametrize(("floors", "stops"), [((2,), [2]), ((3, 1), [1, 3]), ((0,), [0]), ((3, 0, 2), [0, 2, 3])])
def test_calls_are_served_on_the_way(floors: tuple[int, ...], stops: list[int]) -> None:
    plant = system("elevator.sys")
    called(plant, *floors)
    assert served(plant, 40) == stops
    assert plant["ELEVATOR.CALLS"] == 0


def test_a_call_from_below_waits_for_the_way_back() -> None:
    plant = system("elevator.sys")
    called(plant, 3)
    assert served(plant, 3) == []
    called(plant, 0, 2)
    assert served(plant, 30) == [2, 3, 0]
    called(plant, 1)
    assert served(plant, 8) == [1]


def test_calls_are_heard_while_the_door_is_open_and_while_it_closes() -> None:
    plant = system("elevator.sys")
    called(plant, 1)
    assert served(plant, 4) == [1]
    called(plant, 3)
    plant.advance("T#1500ms")
    assert (plant["ELEVATOR.DOOR"], plant["CABIN.IS_CLOSED"]) == (False, False)
    called(plant, 0)
    assert served(plant, 30) == [3, 0]


def test_a_floor_that_is_not_there_is_no_call() -> None:
    elevator = block("ELEVATOR")
    elevator.CALL(CALLED=4)
    assert elevator.CALLS == 0
