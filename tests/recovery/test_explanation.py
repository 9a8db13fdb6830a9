"""What was found of an arm that the blocks have stopped, and whether it had to be stopped."""

import pytest

from dtwin.bus.twin_messages import MonitoredUnit, PredictedMotion
from dtwin.parameters import PERIOD, ROOT, ArmParameters
from dtwin.recovery.explanation import CUT_OFF, FOLLOWING, changed, stopping
from dtwin.signals import MONITOR, Event, EventKind
from dtwin.simulation.checks import TAIL
from iec61499.library import Library
from tests.recovery.fake_cell import FakeCell, measures_of, watched

ARM = ArmParameters()


def test_the_limits_are_those_of_the_block() -> None:
    inputs = {port.name: port.initial for port in Library([ROOT / "fb"]).find("SAFE_STOP").interface.inputs}
    assert float(inputs["FOLLOWING_LIMIT"]) == FOLLOWING
    assert float(inputs["SATURATION_LIMIT"]) * PERIOD == pytest.approx(CUT_OFF)


@pytest.mark.parametrize(
    ("name", "size", "parameter", "value"),
    [
        ("K2", -0.3, "K2", 0.7 * ARM.get("K2")),
        ("D3", 0.02, "D3", ARM.get("D3") + 0.02),
        ("mu1", -0.02, "mu1", 0.0),
        ("supply", -0.1, "K1", 0.9 * ARM.get("K1")),
        ("bias2", 0.1, "K2", ARM.get("K2")),
    ],
)
def test_findings_change_the_arm_as_the_monitor_tells_their_sizes(
    name: str, size: float, parameter: str, value: float
) -> None:
    found = MonitoredUnit("failed", parameter=name, size=size)
    assert changed(ARM, ARM, [found]).get(parameter) == pytest.approx(value)


@pytest.mark.parametrize(("off", "seconds", "stops"), [(0.49, 0.24, False), (0.51, 0.0, True), (0.0, 0.26, True)])
def test_a_motion_off_its_path_or_at_the_voltage_limit_is_one_that_is_stopped(
    off: float, seconds: float, stops: bool
) -> None:
    zero = (0.0, 0.0, 0.0)
    motion = PredictedMotion("home", "red", False, zero, (0.0, off, 0.0), zero, seconds / (2.0 + TAIL))
    assert stopping([motion], 2.0) == ([motion] if stops else [])


@pytest.mark.parametrize(
    ("pushed", "stopped", "told"),
    [
        (20.4, 20.1, "push of joint 2 explains it: see that nothing is in the way of the arm, then `dtwin release`"),
        (20.4, 23.0, "push of joint 2 explains it"),
        (20.4, 40.0, "nothing explains it: find out what is wrong"),
    ],
)
def test_a_push_explains_a_stop_that_it_led_to(pushed: float, stopped: float, told: str) -> None:
    """It is over, and no finding stands: a person was told that nothing explains the stop. The arm stays stopped."""
    cell = FakeCell()
    cell.events = [
        Event(pushed, f"{MONITOR}push", "push of joint 2, confidence 100 %, since 20.00 s"),
        Event(stopped, EventKind.STOP, "safe stop: braking (it left its path)"),
    ]
    cell.events.sort(key=lambda event: event.time)
    assert measures_of(watched(cell)) == [("go on", ("push",)), ("stop", ())]
    assert told in cell.told[-1]
    assert len(cell.stops) == 1
