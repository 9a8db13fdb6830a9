"""Interference on the readings: it is told as what it is, and nothing of the arm is believed from it."""

import numpy as np
import pytest

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.emulation.emulation import Emulation
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import ArmParameters
from dtwin.run.loop import run
from dtwin.signals import EventKind, StepRecord
from tests.outside import readings
from tests.outside.around import Around
from tests.outside.effect import Effect

NOISE = 1e-3
"""rad"""


def watched(effect: Effect, seconds: float, seed: int = 7) -> Monitor:
    """The monitor of an arm that sorts boxes with an effect around it."""
    monitor = Monitor(assumed(ArmParameters(), (NOISE, NOISE, NOISE)))

    def watch(record: StepRecord) -> None:
        sensors, command = record.sensors, record.voltages
        told = np.array(sensors.theta), np.array(command.volts), command.box_gripped, sensors.gripper
        monitor.update(sensors.sequence, *told)

    plant = Around(Emulation(noise=NOISE, seed=seed), effect, seed)
    run(plant, EmbeddedController(ControlSettings(law="cascade")), round(100 * seconds), record=watch)
    return monitor


BURSTS: dict[str, Effect] = {
    "20 ms, all encoders": readings.burst(every=4.0, start=6.0),
    "60 ms, all encoders": readings.burst(every=4.0, start=6.0, length=0.06),
    "60 ms, encoder 2": readings.burst(every=4.0, start=6.0, length=0.06, joints=(2,)),
    "50 ms at another place": readings.jump(0.3, start=6.0, length=0.05),
}


@pytest.mark.parametrize("burst", BURSTS)
def test_bursts_are_told_with_their_number_and_nothing_is_believed_from_them(burst: str) -> None:
    """They were offsets and misfits with 100 %, and the estimate started anew."""
    monitor = watched(BURSTS[burst], 19.0)
    assert {event.kind for event in monitor.events} <= {EventKind.BURST, EventKind.SPIKE}
    told = [event.text for event in monitor.events if event.kind == EventKind.BURST]
    assert len(told) >= (1 if "another" in burst else 4)
    assert all("where no joint can be" in text and "a minute" in text for text in told)
    assert (monitor.restarts, monitor.history, monitor.standing()) == (0, [], [])


def test_an_encoder_that_jumps_and_stays_there_is_found() -> None:
    """No leap is believed at once, but one that stays is no burst: it speaks against the model of a new arm."""
    monitor = watched(readings.jump(0.3, start=12.0), 14.0)
    assert EventKind.BURST not in {event.kind for event in monitor.events}
    assert [event.kind for event in monitor.events] == ["misfit"]
    assert "joint 1 is up to 29" in monitor.events[0].text
