"""Collects an experiment from the samples and commands of a running cell that plays the identification signal."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from dtwin.bus.messages import Acted
from dtwin.bus.ticks import APART, Tick, Ticks
from dtwin.errors import IdentificationError
from dtwin.identification.data import Experiment
from dtwin.identification.excitation.plan import Excitation
from dtwin.parameters import PERIOD
from dtwin.signals import Sensors, Voltages

_MOST_HELD: Final = 0.1
"""Largest share of samples without a command of their own."""


@dataclass
class SignalCollector:
    """Keeps the ticks from the first command of the signal to its last.

    Commands come in the order in which the blocks gave them. A sample that they gave none for is kept, but is no tick
    of the signal.

    Attributes:
        signal: signal that the function blocks play.
        samples: length of the signal, ticks.
        box_mass: mass assumed for a box that is held meanwhile, kg.
        done: number of commands of the signal that have come so far.
    """

    signal: Excitation
    samples: int
    box_mass: float
    done: int = 0
    _expected: list[list[float]] = field(init=False, repr=False)
    _incoming: Ticks = field(default_factory=Ticks, init=False, repr=False)
    _ticks: deque[Tick] = field(init=False, repr=False)
    _first: int = field(default=-1, init=False, repr=False)
    _last: int = field(default=-1, init=False, repr=False)

    def __post_init__(self) -> None:
        self._expected = self.signal.volts(self.samples).tolist()
        self._ticks = deque(maxlen=APART + 2 * self.samples)

    @property
    def complete(self) -> bool:
        """Whether the whole signal has been collected."""
        return self.done == self.samples and bool(self._ticks) and self._ticks[-1][0].sequence >= self._last

    def add(self, message: Sensors | Voltages | Acted) -> None:
        """Takes a message, as long as the signal is not complete.

        Raises:
            IdentificationError: samples or too many commands are missing, or a command is not that of the signal.
        """
        if isinstance(message, Voltages) and self.done < self.samples:
            self._command(message)
        for tick in self._incoming.add(message):
            self._tick(tick)

    def _command(self, command: Voltages) -> None:
        if list(command.volts[:3]) == self._expected[self.done]:
            self._first = self._first if self.done else command.sequence
            self._last = command.sequence
            self.done += 1
        elif self.done:
            self._break_off(command.sequence)
        if self._last - self._first >= self.done + _MOST_HELD * self.samples:
            self._break_off(command.sequence)

    def _tick(self, tick: Tick) -> None:
        """Takes a tick, which comes before its command if something else acted."""
        number = tick[0].sequence
        expected = self._ticks[-1][0].sequence + 1 if self._ticks else number
        if number != expected:
            if self.done:
                self._break_off(expected)
            self._ticks.clear()
        self._ticks.append(tick)

    def _break_off(self, number: int) -> None:
        raise IdentificationError(
            f"the signal broke off after {self.done} of {self.samples} ticks, at {number * PERIOD:.2f} s:"
            " ticks are missing or something else commands the arm; ask again"
        )

    def experiment(self) -> Experiment:
        """The measured experiment, whose initial state is unknown.

        Raises:
            IdentificationError: the signal is not complete.
        """
        if not self.complete:
            raise IdentificationError(f"the signal was seen for only {self.done} of {self.samples} ticks")
        ticks = [tick for tick in self._ticks if self._first <= tick[0].sequence <= self._last]
        return Experiment(
            [sensors.theta for sensors, _ in ticks],
            [acted.volts[:3] for _, acted in ticks],
            [self.box_mass * acted.box_gripped for _, acted in ticks],
        )


def divided(experiment: Experiment, share: float = 0.8) -> tuple[Experiment, Experiment]:
    """Divides an experiment into a first part to estimate from and a rest to judge the model by.

    The initial state of the rest is unknown; share is the fraction of the samples in the first part.
    """
    cut = round(share * len(experiment))
    rest = Experiment(
        experiment.measured[cut:],
        experiment.volts[cut:],
        experiment.payload[cut:],
        None,
        experiment.period,
        experiment.payload_model,
    )
    return experiment.head(cut), rest
