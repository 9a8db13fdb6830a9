"""Remembers the motion of an identification, so that the models can be shown against it."""

from __future__ import annotations

from collections import deque
from typing import Final

from dtwin.bus.messages import Acted
from dtwin.bus.twin_messages import IdentificationState
from dtwin.console.calculations.tasks import Excited
from dtwin.parameters import Triple
from dtwin.signals import Sensors, Voltages

LONGEST: Final = 6000
"""Number of samples that are remembered, a minute: a service that is behind tells late that the signal is over."""


class ExcitedMotion:
    """The samples and voltages of the last minute before an identification began to estimate.

    Attributes:
        last: that minute, with what was estimated; None before the first identification.
    """

    def __init__(self) -> None:
        self.last: Excited | None = None
        self._angles: deque[tuple[int, Triple]] = deque(maxlen=LONGEST)
        self._volts: deque[tuple[int, Triple]] = deque(maxlen=LONGEST)
        self._phase = ""

    def take_sensors(self, sensors: Sensors) -> None:
        """Takes a sample."""
        self._angles.append((sensors.sequence, sensors.theta))

    def take_acted(self, acted: Voltages | Acted) -> None:
        """Takes what acted after a sample."""
        first, second, third, _ = acted.volts
        self._volts.append((acted.sequence, (first, second, third)))

    def take_state(self, state: IdentificationState) -> None:
        """Takes the state of an identification, which says when the excitation has ended."""
        if state.phase == "estimating" and self._phase == "measuring":
            self._keep()
        elif state.phase == "proposed" and self.last is not None:
            proposed = {name: found.value for name, found in state.parameters.items()}
            self.last = Excited(self.last.theta, self.last.volts, proposed)
        self._phase = state.phase

    def _keep(self) -> None:
        volts = dict(self._volts)
        pairs = [(theta, volts[k]) for k, theta in self._angles.copy() if k in volts]
        self.last = Excited(tuple(theta for theta, _ in pairs), tuple(volts for _, volts in pairs), {})
