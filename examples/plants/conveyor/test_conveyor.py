"""Low boxes arrive at the end, tall ones do not, and a stopped belt stands."""

import pytest

from iec61499.testing import block, system


def loaded(tall: bool):
    plant = system("conveyor.sys")
    plant.trigger("SORTER.RUN")
    plant["BELT.TALL"] = tall
    plant.trigger("BELT.LOAD")
    return plant


@pytest.mark.parametrize(("tall", "delivered", "rejected"), [(False, 1, 0), (True, 0, 1)])
def test_a_box_goes_where_it_belongs(tall: bool, delivered: int, rejected: int) -> None:
    plant = loaded(tall)
    plant.advance("T#5s")
    assert (plant["BELT.DELIVERED"], plant["BELT.REJECTED"], plant["BELT.BOXES"]) == (delivered, rejected, 0)
    assert plant["SORTER.MOTOR"] is True


def test_the_belt_stands_while_a_box_is_pushed() -> None:
    plant = loaded(True)
    plant.advance("T#2100ms")
    assert (plant["SORTER.MOTOR"], plant["SORTER.PUSH"]) == (False, True)


def test_a_stopped_belt_keeps_its_box() -> None:
    plant = loaded(False)
    plant.advance("T#1s")
    plant.trigger("SORTER.STOP")
    place = plant["BELT.POSITION"]
    plant.advance("T#10s")
    assert plant["BELT.POSITION"] == pytest.approx(place, abs=0.01)


def test_the_sorter_alone() -> None:
    sorter = block("SORTER")
    assert sorter.REQ(BARRIER=True, HIGH=True) == ()
    sorter.RUN()
    assert sorter.REQ(BARRIER=True, HIGH=True) == ("CNF",)
    assert sorter.state == "PUSHING"
    assert sorter.STOP() == ("CNF",)
    assert (sorter.MOTOR, sorter.PUSH) == (False, False)
    assert sorter.RUN() == ("CNF",)
    assert (sorter.MOTOR, sorter.PUSH) == (True, False)
