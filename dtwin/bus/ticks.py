"""Tells under which voltages the arm was from each sample to the next, whatever the order in which messages come.

Samples and what acted come from the emulator in the order in which they are published: what acted in a tick, if that
was not the command that answers its sample, comes before the next sample. Commands come from another sender, in order
too, but any number of ticks earlier or later: a busy machine may keep one of the two senders waiting for long.
"""

from __future__ import annotations

from typing import Final

from dtwin.bus.messages import Acted
from dtwin.signals import Sensors, Voltages

APART: Final = 1000
"""Number of ticks that samples and commands may be apart, and of commands that wait before the first sample."""

Tick = tuple[Sensors, Voltages | Acted]
"""A sample and what acted on the arm from it to the next one."""


class Ticks:
    """Puts a sample and what acted after it together, in the order of the samples.

    A sample is complete once the next one is there, and what acted is known. One of which nobody tells that is left
    out once a later command has come. Numbers that go back are those of another run: what waits is forgotten.
    """

    def __init__(self) -> None:
        self._samples: dict[int, Sensors] = {}
        self._commands: dict[int, Voltages] = {}
        self._acted: dict[int, Acted] = {}
        self._newest = -1

    def add(self, message: Sensors | Voltages | Acted) -> list[Tick]:
        """Takes a message; returns the ticks that are complete now, oldest first."""
        number = message.sequence
        match message:
            case Sensors():
                self._sample(message)
            case Voltages() if self._is_due(number):
                self._commands.setdefault(number, message)
            case Acted() if number in self._samples:
                self._acted[number] = message
        return self._complete()

    def _sample(self, sensors: Sensors) -> None:
        if sensors.sequence < self._newest:
            for waiting in (self._samples, self._commands, self._acted):
                waiting.clear()
        if sensors.sequence != self._newest:
            self._samples[sensors.sequence] = sensors
            self._newest = sensors.sequence

    def _is_due(self, number: int) -> bool:
        if self._newest < 0:
            return len(self._commands) < APART
        return next(iter(self._samples)) <= number <= self._newest + APART

    def _complete(self) -> list[Tick]:
        complete: list[Tick] = []
        answered = max((number for number in self._commands if number <= self._newest), default=-1)
        for number in list(self._samples):
            acted = self._acted.get(number) or self._commands.get(number)
            if number == self._newest or (acted is None and number > max(answered, self._newest - APART)):
                break
            if acted is not None:
                complete.append((self._samples[number], acted))
            for waiting in (self._samples, self._commands, self._acted):
                waiting.pop(number, None)
        return complete
