"""A bridge that is late now and then: trouble with the timing is no fault of the arm."""

from collections.abc import Iterable, Iterator
from itertools import islice
from queue import Empty, SimpleQueue

import numpy as np
import pytest

from dtwin.bus.messages import ACTED, LATCH, SENSORS, VOLTAGES, Acted, LatchRequest, LatchState
from dtwin.bus.ticks import Ticks
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.emulation.machine.plant import plant_of
from dtwin.emulation.machine.sections import IDEAL
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import PERIOD, VOLTAGE_LIMIT, ArmParameters
from dtwin.services.bridge import LISTEN
from dtwin.services.monitoring import UNHEARD
from dtwin.signals import EventKind, Sensors, Voltages
from evidence.monitoring.trial import true_cause
from tests.support.by_hand import PATIENCE, ByHand
from tests.support.waiting import until

TICKS = 12_000
ONSET = 2_000
"""tick of a fault"""
EVERY = 100
"""ticks between two times at which the bridge is held for two"""


Traffic = Iterable[Sensors | Voltages | Acted]


def traffic(ticks: int, *faults: str) -> Iterator[Sensors | Voltages | Acted]:
    """Samples, commands and what acted instead of them: in turn two commands come late together, or never."""
    plant = Emulation(seed=3, faults=[parse_fault(fault) for fault in faults])
    controller = EmbeddedController()
    in_force = Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False)
    delayed: list[Voltages] = []
    for tick in range(ticks):
        sensors = plant.read()
        yield sensors
        if tick > EVERY and tick % EVERY < 2:
            if tick // EVERY % 2:
                delayed.append(controller.step(sensors))
            yield Acted(tick, sensors.time, in_force.volts, in_force.box_gripped)
        else:
            yield from delayed
            delayed.clear()
            in_force = controller.step(sensors)
            yield in_force
        plant.apply(in_force)
        plant.advance(PERIOD)


@pytest.fixture(scope="module")
def healthy() -> list[Sensors | Voltages | Acted]:
    return list(traffic(TICKS))


def monitored(messages: Traffic) -> Monitor:
    monitor, ticks = Monitor(assumed(ArmParameters(), UNHEARD)), Ticks()
    for message in messages:
        for sensors, acted in ticks.add(message):
            volts = np.array(acted.volts)
            monitor.update(sensors.sequence, np.array(sensors.theta), volts, acted.box_gripped)
    return monitor


def test_late_and_missing_commands_are_no_fault(healthy: Traffic) -> None:
    monitor = monitored(healthy)
    assert monitor.events == []
    assert monitor.missed == 0
    assert monitor.sample == TICKS - 2


def test_without_what_acted_they_would_be(healthy: Traffic) -> None:
    monitor = monitored(message for message in islice(healthy, 30 * EVERY) if not isinstance(message, Acted))
    assert monitor.events


@pytest.mark.parametrize("fault", ["K2*=0.5", "D1*=2"])
def test_a_fault_is_found_all_the_same(fault: str) -> None:
    onset = PERIOD * ONSET
    monitor = monitored(traffic(2 * ONSET, f"{fault}@{onset:g}"))
    assert {(finding.cause, finding.joint) for finding in monitor.history} == {true_cause(fault)}
    assert onset < monitor.history[0].detected < onset + 30.0


PICKUP = (-0.6699, -1.5931, 2.2630)
"""Angles at which the blocks take a box, rad."""
FALL = 0.95
"""Angle by which joint 2 falls, rad."""
THROWN = (PICKUP[0], PICKUP[1] + 0.6, PICKUP[2] - 0.6)
"""Angles that are another arm's if they come in the next sample, rad."""


class Driven:
    """A bridge and a controller whose samples the test makes up; an arm that stands at the pickup, and its box."""

    def __init__(self, by_hand: ByHand, sockets: str) -> None:
        self._by_hand = by_hand
        self._management = f"unix:{sockets}/61499"
        by_hand.start("controller", "--listen", self._management)
        self.start_bridge()
        self._commands: SimpleQueue[Voltages] = SimpleQueue()
        self._publish = by_hand.bus.publisher(SENSORS)
        by_hand.bus.subscribe(VOLTAGES, Voltages, self._commands.put)
        self.latched = LatchState(0.0, 0, "none")
        self.tell = by_hand.bus.publisher(ACTED)
        by_hand.bus.answer(LATCH, LatchRequest, self._latch, lambda: self.latched)

    def _latch(self, asked: LatchRequest) -> LatchState:
        self.latched = LatchState(0.0, 1, asked.stop)
        return self.latched

    def grip(self) -> int:
        """Answers samples until a box is gripped; returns the number of that sample."""
        return next(k for k in range(1000) if self.answer(k, PICKUP).box_gripped)

    def fall(self) -> None:
        """Answers samples of an arm that falls from the pickup though it is told to have a voltage, and which then
        stands there again."""
        for k in range(10):
            self.answer(k, PICKUP)
        for k in range(20):
            self.answer(10 + k, (PICKUP[0], PICKUP[1] + k / 19 * FALL, PICKUP[2]))
            self.tell(Acted(10 + k, PERIOD * (10 + k), (1.0,) * 4, True))
        for k in range(30, 31 + LISTEN):
            self.answer(k, PICKUP)

    def start_bridge(self) -> None:
        self._by_hand.start("bridge", "--controller", self._management)

    def answer(self, sequence: int, theta: tuple[float, float, float]) -> Voltages:
        """The command that answers a sample, which is published until it is answered."""
        for _ in range(600):
            self._publish(Sensors(sequence, PERIOD * sequence, theta, 0.4, True, "red"))
            try:
                while (command := self._commands.get(timeout=0.2)).sequence != sequence:
                    pass
            except Empty:
                continue
            return command
        raise AssertionError(f"nobody answers sample {sequence}")


def test_an_arm_that_is_thrown_about_between_late_commands_keeps_its_box(by_hand: ByHand, sockets: str) -> None:
    driven = Driven(by_hand, sockets)
    gripped = driven.grip()
    assert driven.answer(gripped + 4, THROWN).box_gripped, "two joints have moved by 0.6 rad in 40 ms"
    assert driven.answer(gripped + 5, THROWN).box_gripped
    assert driven.answer(gripped + 6, PICKUP).box_gripped, "within 30 ms it may be a burst of wild readings"
    assert driven.answer(gripped + 7, PICKUP).box_gripped
    assert not driven.answer(gripped + 8, PICKUP).box_gripped, "in 10 ms no arm gets there: it is another"


def test_a_bridge_that_begins_anew_lets_go_of_no_box(by_hand: ByHand, sockets: str) -> None:
    driven = Driven(by_hand, sockets)
    gripped = driven.grip()
    by_hand.kill("bridge")
    driven.start_bridge()
    first = driven.answer(gripped + 200, THROWN)
    assert first.box_gripped
    assert max(map(abs, first.volts[:3])) < VOLTAGE_LIMIT, "the path begins where the arm is"
    assert driven.answer(gripped + 201, THROWN).box_gripped


def test_an_arm_that_falls_because_its_commands_are_late_is_not_stopped(by_hand: ByHand, sockets: str) -> None:
    driven = Driven(by_hand, sockets)
    plant = plant_of(IDEAL)
    plant.reset(PICKUP)
    lowest = 0.0
    for k in range(31 + LISTEN):
        first, second, third, _ = plant.sampled
        lowest = max(lowest, abs(second - PICKUP[1]))
        volts = driven.answer(k, (first, second, third)).volts
        if 10 <= k < 30:
            volts = (0.0,) * 4
            driven.tell(Acted(k, PERIOD * k, volts, True))
        plant.apply(volts)
        plant.advance(PERIOD)
    assert lowest > 0.3
    assert driven.latched.stop == "none"


def test_a_stop_of_the_controllers_own_is_latched_and_told(by_hand: ByHand, sockets: str) -> None:
    driven = Driven(by_hand, sockets)
    driven.fall()
    until(lambda: driven.latched.stop != "none", "the stop is latched", PATIENCE)
    until(lambda: any(event.kind == EventKind.STOP for event in by_hand.events), "the stop is told", PATIENCE)
