"""Gathers the ticks that have passed into messages for those who need not know each at once."""

from __future__ import annotations

from collections.abc import Callable

from dtwin.bus.messages import TOGETHER, Acted, PassedTick, PassedTicks
from dtwin.signals import Sensors, Voltages


class Passed:
    """Ticks that wait to be told.

    Args:
        publish: Function that receives the messages.
    """

    def __init__(self, publish: Callable[[PassedTicks], None]) -> None:
        self._publish = publish
        self._waiting: list[PassedTick] = []

    def add(self, sensors: Sensors, command: Voltages) -> None:
        """Takes a tick: the sample with which it began, and the command that acted in it."""
        acted = Acted(sensors.sequence, sensors.time, command.volts, command.box_gripped)
        self._waiting.append(PassedTick(sensors, acted))
        if sensors.sequence % TOGETHER == 0:
            self.tell()

    def tell(self) -> None:
        """Publishes what waits: a message never holds ticks of two runs."""
        if self._waiting:
            waiting, self._waiting = tuple(self._waiting), []
            self._publish(PassedTicks(waiting))
