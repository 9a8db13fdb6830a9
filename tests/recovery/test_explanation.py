"""What was found of an arm that the blocks have stopped, and whether it had to be stopped."""

import pytest

from dtwin.bus.twin_messages import MonitoredUnit, PredictedMotion
from dtwin.parameters import PERIOD, ROOT, ArmParameters
from dtwin.recovery.explanation import CUT_OFF, FOLLOWING, changed, stopping
from dtwin.signals import MONITOR, Event, EventKind
from dtwin.simulation.checks import TAIL
from iec61499.library import Library
from tests.recovery.fake_cell import FakeCell, attended, measures_of, watched

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
    ("pushed", "stopped", "confidence", "told"),
    [
        (
            20.4,
            20.1,
            100,
            "push of joint 2 explains it: see that nothing is in the way of the arm, then `dtwin release`",
        ),
        (20.4, 23.0, 95, "push of joint 2 explains it"),
        (20.4, 40.0, 100, "nothing explains it: find out what is wrong"),
        (20.4, 19.0, 100, "nothing explains it: find out what is wrong"),
        (20.4, 20.1, 33, "push of joint 2 may explain it, with a confidence of 33 %: find out what is wrong"),
    ],
)
def test_a_push_explains_a_stop_that_it_led_to(pushed: float, stopped: float, confidence: int, told: str) -> None:
    """It is over, and no finding stands: a person was told that nothing explains the stop. The arm stays stopped."""
    cell = pushed_cell(pushed, stopped, confidence)
    answers = measures_of(watched(cell))
    assert ("stop", ()) in answers
    assert set(answers) <= {("go on", ("push",)), ("stop", ())}
    assert told in cell.told[-1]
    assert len(cell.stops) == 1


def pushed_cell(pushed: float, stopped: float, confidence: int) -> FakeCell:
    """A cell in which a push that began at 20 s was told, and the blocks stopped the arm, at plant times (s)."""
    cell = FakeCell()
    cell.events = [
        Event(pushed, f"{MONITOR}push", f"push of joint 2, confidence {confidence} %, since 20.00 s"),
        Event(stopped, EventKind.STOP, "safe stop: braking (it left its path)"),
    ]
    cell.events.sort(key=lambda event: event.time)
    return cell


def test_a_push_explains_no_stop_once_something_else_was_found() -> None:
    """A locked joint was taken for a push at first, and the push stayed the cause that a person was told."""
    cell = pushed_cell(20.4, 20.1, 100)
    cell.found = {"bias3": (21.0, 0.01, 0.001)}
    watched(cell)
    assert "bias3 does not explain it: find out what is wrong" in cell.told[-1]


def test_what_is_found_of_a_stopped_arm_is_told_with_its_stop() -> None:
    """A push that was told 3 s after the operator had, and something else found still later."""
    cell = pushed_cell(24.0, 20.1, 100)
    cell.events.append(Event(25.0, f"{MONITOR}failed", "locked joint of joint 2, confidence 60 %, since 20.0 s"))
    operator, desk = attended(cell)
    assert "nothing explains it" in cell.told[-1]
    desk.pass_time(6.0)
    assert cell.told[-1].startswith("the stop: push of joint 2 explains it: see that nothing is in the way")
    assert operator.cause.name == "push of joint 2"
    cell.events.append(Event(cell.time, f"{MONITOR}failed", "locked joint of joint 2, confidence 97 %, since 20.0 s"))
    desk.pass_time(4.0)
    assert cell.told[-1] == "locked joint of joint 2 was found since, and push of joint 2 may not explain the stop"
    assert not operator.cause.name
