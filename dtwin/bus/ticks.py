"""Tells under which voltages the arm was from each sample to the next, whatever the order in which messages come.

Samples and what acted come from the emulator in the order in which they are published: what acted in a tick, if that
was not the command that answers its sample, comes before the next sample. Commands come from another sender.
"""

from __future__ import annotations

from typing import Final

from dtwin.bus.messages import Acted
from dtwin.signals import Sensors, Voltages

LAG: Final = 20
"""Number of samples that may follow one whose command is still waited for."""
EARLY: Final = 1000
"""Number of ticks that a command may be ahead of the samples, and of commands that wait before the first sample."""

Tick = tuple[Sensors, Voltages | Acted]
"""A sample and what acted on the arm from it to the next one."""


class Ticks:
    """Puts a sample and what acted after it together, in the order of the samples.

    A sample is complete once the next one is there. One of which nobody ever tells what acted is left out. Numbers
    that go back are those of another run: what waits is forgotten.
    """

    def __init__(self) -> None:
        self._samples: dict[int, Sensors] = {}
        self._commands: dict[int, Voltages] = {}
        self._acted: dict[int, Acted] = {}
        self._newest = -1

    def take(self, message: Sensors | Voltages | Acted) -> list[Tick]:
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
            return len(self._commands) < EARLY
        return next(iter(self._samples)) <= number <= self._newest + EARLY

    def _complete(self) -> list[Tick]:
        complete: list[Tick] = []
        for number in list(self._samples):
            acted = self._acted.get(number) or self._commands.get(number)
            if number == self._newest or (acted is None and number > self._newest - LAG):
                break
            if acted is not None:
                complete.append((self._samples[number], acted))
            for waiting in (self._samples, self._commands, self._acted):
                waiting.pop(number, None)
        return complete
