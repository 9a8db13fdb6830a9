"""Hours of the blocks alone: which machines are stopped, and what is told of it."""

from __future__ import annotations

import numpy as np
import pytest

from evidence.monitoring.healthy_stops import (
    HealthyStops,
    HealthyWork,
    _seen,
    healthy_stops_report,
    unstopped,
    work_alone,
)
from tests.support.iec61499.c_harness import needs_compiler


@needs_compiler
def test_a_machine_that_can_hold_its_boxes_is_not_stopped() -> None:
    found = work_alone(HealthyWork(901, 1, 0.1))
    assert found.able
    assert found.stops == []
    assert found.hours == pytest.approx(0.1)
    assert found.delivered > 5


@needs_compiler
def test_a_machine_that_a_box_brings_to_the_voltage_limit_is_stopped_with_the_box_held() -> None:
    """Of 5004 motor 2 needs all of its voltage at the red place."""
    found = work_alone(HealthyWork(5004, 1, 0.1))
    assert not found.able
    assert found.stops
    assert "motor 2" in found.stops[0]


def test_only_machines_that_can_do_the_work_have_to_go_on() -> None:
    weak = HealthyStops(1, 1.0, 10, 0.99, ["12 s"])
    strong = HealthyStops(2, 1.0, 10, 0.8, [])
    assert unstopped([weak, strong])
    assert not unstopped([weak, HealthyStops(3, 1.0, 10, 0.8, ["9 s"])])
    text = healthy_stops_report([weak, strong]).text
    assert "0 stops of the 1 machines" in text
    assert "1 of the 1 others" in text


def test_what_was_seen_tells_the_motor_at_its_limit() -> None:
    volts = np.zeros((100, 3))
    volts[:40, 1] = -8.0
    assert _seen(10.0, volts, np.array([1.0, -2.0, 0.5])) == (
        "10 s at (1.00, -2.00, 0.50) rad, at the voltage limit before: motor 2 0.40 s"
    )
    assert _seen(10.0, 0 * volts, np.zeros(3)).endswith("no motor")
