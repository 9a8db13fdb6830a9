"""A bridge that is late now and then: trouble with the timing is no fault of the arm."""

from collections.abc import Iterator

import numpy as np
import pytest

from dtwin.bus.messages import Acted
from dtwin.bus.ticks import Ticks
from dtwin.controller.embedded import EmbeddedController
from dtwin.emulation.emulation import Emulation
from dtwin.emulation.faults import parse_fault
from dtwin.experiments.monitoring.trial import true_cause
from dtwin.monitoring.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.signals import Sensors, Voltages
from services.monitoring import UNHEARD

TICKS = 20_000
EVERY = 100
"""ticks between two times at which the bridge is held for two"""


def traffic(*faults: str) -> Iterator[Sensors | Voltages | Acted]:
    """Samples, commands and what acted instead of them: in turn two commands come late together, or never."""
    plant = Emulation(seed=3, faults=[parse_fault(fault) for fault in faults])
    controller = EmbeddedController()
    in_force = Voltages(0, 0.0, (0.0, 0.0, 0.0, 0.0), False)
    delayed: list[Voltages] = []
    for tick in range(TICKS):
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


def monitored(messages: Iterator[Sensors | Voltages | Acted]) -> Monitor:
    monitor, ticks = Monitor(assumed(ArmParameters(), UNHEARD)), Ticks()
    for message in messages:
        for sensors, acted in ticks.take(message):
            volts = np.array(acted.volts[:3])
            monitor.update(sensors.sequence, np.array(sensors.theta), volts, acted.box_gripped)
    return monitor


def test_late_and_missing_commands_are_no_fault() -> None:
    monitor = monitored(traffic())
    assert monitor.events == []
    assert monitor.missed == 0
    assert monitor.sample == TICKS - 2


def test_without_what_acted_they_would_be() -> None:
    monitor = monitored(message for message in traffic() if not isinstance(message, Acted))
    assert monitor.history


@pytest.mark.parametrize("fault", ["K2*=0.5", "D1*=2"])
def test_a_fault_is_found_all_the_same(fault: str) -> None:
    monitor = monitored(traffic(f"{fault}@100"))
    assert {(finding.cause, finding.joint) for finding in monitor.history} == {true_cause(fault)}
    assert 100.0 < monitor.history[0].detected < 130.0
