"""Remembers the motion of an identification, so that the models can be shown against it."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterable
from typing import Final

from dtwin.bus.ticks import Tick
from dtwin.bus.twin_messages import IdentificationState
from dtwin.console.calculations.tasks import Excited

LONGEST: Final = 6000
"""Number of samples that are remembered, a minute: a service that is behind tells late that the signal is over."""


class ExcitedMotion:
    """The samples of the last minute before an identification began to estimate, and the voltages that acted.

    Attributes:
        last: that minute, with what was estimated; None before the first identification.
    """

    def __init__(self) -> None:
        self.last: Excited | None = None
        self._taking = threading.Lock()
        self._ticks: deque[Tick] = deque(maxlen=LONGEST)
        self._phase = ""

    def extend(self, ticks: Iterable[Tick]) -> None:
        """Takes ticks, oldest first."""
        with self._taking:  # Zenoh may call for two topics at once.
            self._ticks.extend(ticks)

    def update_state(self, state: IdentificationState) -> None:
        """Takes the state of an identification, which says when the excitation has ended."""
        if state.phase == "estimating" and self._phase == "measuring":
            self._keep()
        elif state.phase == "proposed" and self.last is not None:
            proposed = {name: found.value for name, found in state.parameters.items()}
            self.last = Excited(self.last.numbers, self.last.theta, self.last.volts, proposed)
        self._phase = state.phase

    def _keep(self) -> None:
        with self._taking:
            ticks = self._ticks.copy()
        self.last = Excited(
            tuple(sensors.sequence for sensors, _ in ticks),
            tuple(sensors.theta for sensors, _ in ticks),
            tuple(acted.volts[:3] for _, acted in ticks),
            {},
        )
