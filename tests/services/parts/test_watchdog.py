"""The watchdog of the bridge demands a stop when the monitor is silent while the arm is driven."""

from collections.abc import Iterator

import msgspec
import pytest

from dtwin.bus.messages import Status, StopRequest
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.bus.twin_messages import UNITS, MonitoredUnit, MonitoringVerdict
from dtwin.services.parts.stopping.watchdog import Watchdog
from tests.support.ports import free_port

PATIENCE = 5.0
NOMINAL = MonitoringVerdict(0.0, dict.fromkeys(UNITS, MonitoredUnit("nominal")), (), (), 0, 0)
OFF = Status("monitoring", "off", 1)


class Driven:
    """A bridge of which only the watchdog is there; a second passes in each step."""

    def __init__(self, bus: Bus) -> None:
        self.demands: list[StopRequest] = []
        self.dog = Watchdog(bus, PATIENCE, self.demands.append)
        self.now = 0.0
        self.time = 0.0
        self.answered = 0

    def pass_seconds(self, count: int, *, heard: bool = False, drives: bool = True, stopped: bool = False) -> None:
        for _ in range(count):
            self.now += 1.0
            if drives:
                self.answered += 100
                self.time += 1.0
            if heard:
                self.dog.update(msgspec.structs.replace(NOMINAL, time=self.time))
            self.dog.look(self.time, self.answered, stopped, self.now)


@pytest.fixture
def driven() -> Iterator[Driven]:
    with Bus(open_peer(f"tcp/127.0.0.1:{free_port()}")) as bus:
        yield Driven(bus)


def test_a_monitor_that_is_heard_needs_no_stop(driven: Driven) -> None:
    driven.pass_seconds(60, heard=True)
    assert not driven.demands


@pytest.mark.parametrize("heard", [0, 20])
def test_a_silent_monitor_stops_the_arm_once(driven: Driven, heard: int) -> None:
    driven.pass_seconds(heard, heard=True)
    driven.pass_seconds(4)
    assert not driven.demands
    driven.pass_seconds(4)
    assert [(each.who, each.state, each.confidence) for each in driven.demands] == [("bridge", "failed", 1.0)]
    assert "silent for more than 5 s" in driven.demands[0].why


def test_it_stops_again_after_a_release(driven: Driven) -> None:
    driven.pass_seconds(8)
    driven.pass_seconds(30, drives=False, stopped=True)
    assert len(driven.demands) == 1
    driven.pass_seconds(8)
    assert len(driven.demands) == 2


def test_a_cell_that_waits_accuses_nobody(driven: Driven) -> None:
    driven.pass_seconds(5, heard=True)
    driven.pass_seconds(100, drives=False)
    driven.pass_seconds(3)
    assert not driven.demands


def test_a_monitor_that_repeats_an_old_verdict_is_silent(driven: Driven) -> None:
    driven.pass_seconds(5, heard=True)
    for _ in range(8):
        driven.dog.update(msgspec.structs.replace(NOMINAL, time=5.0))
        driven.pass_seconds(1)
    assert len(driven.demands) == 1


def test_a_monitor_that_was_switched_off_is_excused_as_long_as_it_lives(driven: Driven) -> None:
    driven.pass_seconds(5, heard=True)
    for _ in range(30):
        driven.dog.note(OFF)
        driven.pass_seconds(1)
    assert not driven.demands
    driven.pass_seconds(8)
    assert len(driven.demands) == 1
