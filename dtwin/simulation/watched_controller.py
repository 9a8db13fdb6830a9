"""A controller in this process whose uploaded settings are on trial while it runs."""

from __future__ import annotations

from collections.abc import Callable

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import JointVector
from dtwin.signals import Event, Sensors, Voltages
from dtwin.simulation.history import Entry
from dtwin.simulation.upload import Uploader


class WatchedController:
    """Steps a controller and lets the uploader judge every sample, so that trials end without further calls.

    Args:
        controller: controller to which the port of the uploader leads.
        uploader: uploader of its settings.
        told: called with the history entry that ends a trial.
    """

    def __init__(
        self,
        controller: EmbeddedController,
        uploader: Uploader[ControlSettings, Entry],
        told: Callable[[Entry], None] = lambda entry: None,
    ) -> None:
        self.uploader = uploader
        self._controller = controller
        self._told = told

    def step(self, sensors: Sensors) -> Voltages:
        """The controller's answer to a sample, whose distance from the path is judged while a trial runs."""
        voltages = self._controller.step(sensors)
        if self.uploader.trial is not None:
            theta = self.uploader.settings.angles(sensors.theta)
            entry = self.uploader.observe(sensors.time, self._controller.target(), theta)
            if entry is not None:
                self._told(entry)
        return voltages

    def target(self) -> JointVector:
        """Desired angles of the path at the last step, rad."""
        return self._controller.target()

    def drain_events(self) -> list[Event]:
        """What the sequence has told since the last call."""
        return self._controller.drain_events()
