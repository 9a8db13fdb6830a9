"""Collects an experiment from the samples and commands of a running cell that plays the identification signal."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from dtwin.bus.messages import Acted
from dtwin.errors import IdentificationError
from dtwin.identification.data import Experiment
from dtwin.identification.excitation.plan import Excitation
from dtwin.parameters import PERIOD, Triple
from dtwin.signals import Sensors, Voltages

LAG: Final = 20
"""Number of ticks to wait for late messages: samples and commands have different senders and may be out of order."""
_MOST_HELD: Final = 0.1
"""Largest share of samples without a command of their own."""


@dataclass
class SignalCollector:
    """Pairs samples with the commands that answer them, from the first command of the signal to its last.

    Attributes:
        signal: signal that the function blocks play.
        samples: length of the signal, ticks.
        box_mass: mass assumed for a box that is held meanwhile, kg.
        done: number of ticks of the signal collected so far.
    """

    signal: Excitation
    samples: int
    box_mass: float
    done: int = 0
    _expected: list[list[float]] = field(init=False, repr=False)
    _sensors: dict[int, Sensors] = field(default_factory=dict, init=False, repr=False)
    _commands: dict[int, Voltages] = field(default_factory=dict, init=False, repr=False)
    _acted: dict[int, Acted] = field(default_factory=dict, init=False, repr=False)
    _next: int = field(default=-1, init=False, repr=False)
    _measured: list[Triple] = field(default_factory=list, init=False, repr=False)
    _volts: list[list[float]] = field(default_factory=list, init=False, repr=False)
    _payload: list[float] = field(default_factory=list, init=False, repr=False)

    def __post_init__(self) -> None:
        self._expected = self.signal.volts(self.samples).tolist()

    @property
    def complete(self) -> bool:
        """Whether the whole signal has been collected."""
        return self.done == self.samples

    def sample(self, sensors: Sensors) -> None:
        """Takes a sample.

        Raises:
            IdentificationError: samples or too many commands are missing, or a command is not that of the signal.
        """
        self._sensors[sensors.sequence] = sensors
        if self._next < 0:
            self._next = sensors.sequence
        while self._next <= sensors.sequence - LAG and not self.complete:
            number = self._next
            self._tick(
                self._sensors.pop(number, None), self._commands.pop(number, None), self._acted.pop(number, None)
            )
            self._next += 1

    def command(self, voltages: Voltages) -> None:
        """Takes the command that answers a sample."""
        if voltages.sequence >= self._next:
            self._commands.setdefault(voltages.sequence, voltages)

    def acted(self, message: Acted) -> None:
        """Takes what acted in a tick instead of the command that answers its sample."""
        if message.sequence >= self._next:
            self._acted[message.sequence] = message

    def _tick(self, sensors: Sensors | None, command: Voltages | None, acted: Acted | None) -> None:
        """Takes one tick; of which nobody tells anything, the arm was under the same voltages as before."""
        if command is not None and sensors is not None and list(command.volts[:3]) == self._expected[self.done]:
            self._take(sensors.theta, acted or command)
            self.done += 1
        elif self.done:
            held = len(self._measured) + 1 - self.done
            if sensors is None or command is not None or held > _MOST_HELD * self.samples:
                raise IdentificationError(
                    f"the signal broke off after {self.done} of {self.samples} ticks, at {self._next * PERIOD:.2f} s:"
                    " ticks are missing or something else commands the arm; ask again"
                )
            self._take(sensors.theta, acted)

    def _take(self, theta: Triple, acted: Voltages | Acted | None) -> None:
        self._measured.append(theta)
        self._volts.append(self._volts[-1] if acted is None else list(acted.volts[:3]))
        self._payload.append(self._payload[-1] if acted is None else self.box_mass * acted.box_gripped)

    def experiment(self) -> Experiment:
        """The measured experiment, whose initial state is unknown.

        Raises:
            IdentificationError: the signal is not complete.
        """
        if not self.complete:
            raise IdentificationError(f"the signal was seen for only {self.done} of {self.samples} ticks")
        return Experiment(self._measured, self._volts, self._payload)


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
