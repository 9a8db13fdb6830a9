"""From the traffic of a running cell to an experiment: finds the identification signal among its commands."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from dtwin.errors import IdentificationError
from dtwin.identification.data import Experiment
from dtwin.identification.excitation import Excitation
from dtwin.parameters import Triple
from dtwin.signals import Sensors, Voltages

_KEPT: Final = 100
"""samples that wait for their commands"""
_MOST_HELD: Final = 0.1
"""share of the samples that may have had no command of their own"""


@dataclass
class Collector:
    """Pairs samples with the commands that answer them, from the first command of the signal to its last.

    Attributes:
        signal: that the function blocks play.
        samples: number of ticks it lasts.
        box_mass: kg, of a box held meanwhile.
        done: ticks of the signal collected so far.
    """

    signal: Excitation
    samples: int
    box_mass: float
    done: int = 0
    _expected: list[list[float]] = field(init=False, repr=False)
    _waiting: dict[int, Triple] = field(default_factory=dict, init=False, repr=False)
    _measured: list[Triple] = field(default_factory=list, init=False, repr=False)
    _volts: list[list[float]] = field(default_factory=list, init=False, repr=False)
    _payload: list[float] = field(default_factory=list, init=False, repr=False)
    _last: int = field(default=-1, init=False, repr=False)

    def __post_init__(self) -> None:
        self._expected = self.signal.volts(self.samples).tolist()

    @property
    def complete(self) -> bool:
        """Whether the whole signal has been seen."""
        return self.done == self.samples

    def sample(self, sensors: Sensors) -> None:
        """Takes a sample."""
        self._waiting[sensors.sequence] = sensors.theta
        if len(self._waiting) > _KEPT:
            del self._waiting[next(iter(self._waiting))]

    def command(self, voltages: Voltages) -> None:
        """Takes the command that answers a sample. Samples without one were run under the command before.

        Raises:
            IdentificationError: samples are missing, or too many commands are, or others come.
        """
        theta = self._waiting.pop(voltages.sequence, None)
        if self.complete or theta is None or voltages.sequence <= self._last:
            return
        volts = list(voltages.volts[:3])
        plays = volts == self._expected[self.done]
        if self.done:
            missed = [self._waiting.pop(k, None) for k in range(self._last + 1, voltages.sequence)]
            held = len(self._measured) + len(missed) - self.done
            if not plays or None in missed or held > _MOST_HELD * self.samples:
                raise IdentificationError(
                    f"the signal broke off after {self.done} of {self.samples} ticks, at {voltages.time:.2f} s: "
                    "ticks are missing or something else commands the arm; ask again"
                )
            for earlier in missed:
                self._take(earlier, self._volts[-1], self._payload[-1])
        if plays:
            self._take(theta, volts, self.box_mass if voltages.box_gripped else 0.0)
            self._last = voltages.sequence
            self.done += 1

    def _take(self, theta: Triple | None, volts: list[float], payload: float) -> None:
        assert theta is not None
        self._measured.append(theta)
        self._volts.append(volts)
        self._payload.append(payload)

    def experiment(self) -> Experiment:
        """What was measured, from an unknown initial state.

        Raises:
            IdentificationError: the signal is not complete.
        """
        if not self.complete:
            raise IdentificationError(f"the signal was seen for {self.done} of {self.samples} ticks only")
        return Experiment(self._measured, self._volts, self._payload)


def divided(experiment: Experiment, share: float = 0.8) -> tuple[Experiment, Experiment]:
    """The first part of an experiment, to estimate from, and the rest, from an unknown state, to judge the model."""
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
