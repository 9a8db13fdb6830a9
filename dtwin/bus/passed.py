"""Gathers the ticks that have passed into messages for those who need not know each at once."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick, JointTicks
from dtwin.bus.messages import TOGETHER, Acted, PassedTick, PassedTicks
from dtwin.bus.ticks import Tick, Ticks
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


class PassedJoints:
    """Ticks of an arm of n joints that wait to be told.

    Args:
        publish: Function that receives the messages.
    """

    def __init__(self, publish: Callable[[JointTicks], None]) -> None:
        self._publish = publish
        self._waiting: list[JointTick] = []

    def add(self, sensors: JointSensors, command: JointCommands) -> None:
        """Takes a tick: the sample with which it began, and the command that acted in it."""
        self._waiting.append(JointTick(sensors, command))
        if sensors.sequence % TOGETHER == 0:
            self.tell()

    def tell(self) -> None:
        """Publishes what waits: a message never holds ticks of two runs."""
        if self._waiting:
            waiting, self._waiting = tuple(self._waiting), []
            self._publish(JointTicks(waiting))


class Prompt:
    """Puts samples and what acted together for those who may have to know each tick at once.

    Args:
        take: Function that is called with ticks, at least one, oldest first.

    Attributes:
        size: number of ticks that may wait for each other, those up to a number that it divides.
    """

    def __init__(self, take: Callable[[list[Tick]], Any]) -> None:
        self.size = 1
        self._take = take
        self._ticks = Ticks()
        self._waiting: list[Tick] = []
        self._taking = threading.Lock()

    def put(self, message: Sensors | Voltages | Acted) -> None:
        """Takes a message; Zenoh may call for two topics at once."""
        with self._taking:
            for tick in self._ticks.add(message):
                self._waiting.append(tick)
                if tick[0].sequence % self.size == 0 or len(self._waiting) >= self.size:
                    waiting, self._waiting = self._waiting, []
                    self._take(waiting)
