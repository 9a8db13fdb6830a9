"""The level settles where it is wanted, and nothing is spilt."""

import pytest

from iec61499.testing import block, system


@pytest.mark.parametrize("wanted", [0.2, 0.5])
def test_the_level_settles(wanted: float) -> None:
    plant = system("two_tanks.sys")
    plant["CONTROL.WANTED"] = wanted
    plant.advance("T#30m")
    assert plant["TANKS.LOWER"] == pytest.approx(wanted, abs=0.005)
    assert plant["TANKS.SPILT"] == 0.0
    assert plant["CONTROL.ALARM"] is False


def test_a_level_that_the_upper_tank_cannot_bear_is_an_alarm_and_no_flood() -> None:
    plant = system("two_tanks.sys")
    plant["CONTROL.WANTED"] = 1.0
    plant.advance("T#30m")
    assert plant["CONTROL.ALARM"] is True
    assert plant["CONTROL.PUMP"] == 0.0
    assert plant["TANKS.SPILT"] == 0.0


def test_tanks_without_a_pump_run_empty() -> None:
    tanks = block("TANKS")
    tanks.UPPER = 0.5
    for _ in range(3000):
        tanks.REQ(PUMP=0.0)
    assert pytest.approx(0.0, abs=0.001) == tanks.UPPER


def test_a_closed_outlet_fills_the_lower_tank_until_it_spills() -> None:
    tanks = block("TANKS", OPEN=False)
    for _ in range(6000):
        tanks.REQ(PUMP=0.0005)
    assert tanks.LOWER == 1.0
    assert tanks.SPILT > 0.0


def test_an_alarm_is_reset() -> None:
    control = block("LEVEL_CONTROL")
    control.REQ(UPPER=0.1, LOWER=0.1)
    assert control.PUMP > 0.0
    control.REQ(UPPER=0.95)
    assert (control.PUMP, control.ALARM) == (0.0, True)
    assert control.REQ(UPPER=0.1) == ()
    control.RESET()
    assert control.ALARM is False
