"""The port through which settings reach a running controller: the block SYSTEM_SIMULATION.

A message carries all gains and the target time, or all model parameters. It arrives as one event between two ticks,
so that the controller has either all of its values or none. The mass of a box, and offsets of the encoders, which the
blocks follow by small steps, are written to the inputs that hold them.
"""

from __future__ import annotations

from typing import Protocol

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import ARM_MODEL, GAINS, MODEL, OFFSETS, PAYLOAD, TUNING
from dtwin.controller.settings import ControlSettings
from dtwin.parameters import ArmParameters, Gains, JointVector


class SettingsPort(Protocol):
    """A running controller whose settings can be changed and read back; each method returns those in force then."""

    def send_gains(self, gains: Gains, target_time: float) -> ControlSettings:
        """Puts gains into force from the next tick, the target time (s) from the next motion."""

    def send_model(self, model: ArmParameters) -> ControlSettings:
        """Puts an arm model into force from the next tick."""

    def write_payload(self, mass: float) -> ControlSettings:
        """Puts an assumed mass of a box (kg) into force from the next tick."""

    def write_offsets(self, offsets: JointVector) -> ControlSettings:
        """Puts known offsets of the encoders (rad) into force; what is taken off follows them by small steps."""

    def read_back(self) -> ControlSettings:
        """The settings in the blocks of the controller."""


class EmbeddedPort:
    """The settings port of a controller in this process; used between the steps of the controller.

    Args:
        controller: controller whose application has the block SYSTEM_SIMULATION.

    Raises:
        FunctionBlockError: the application has no such block.
    """

    def __init__(self, controller: EmbeddedController) -> None:
        self._resource = controller.resource
        self._gains = self._resource.server(GAINS.block)
        self._model = self._resource.server(ARM_MODEL.block)

    def send_gains(self, gains: Gains, target_time: float) -> ControlSettings:
        """Puts gains into force from the next tick, the target time (s) from the next motion."""
        values = ControlSettings(target_time, gains).inputs()
        self._gains.exchange([values[name] for name in TUNING])
        return self.read_back()

    def send_model(self, model: ArmParameters) -> ControlSettings:
        """Puts an arm model into force from the next tick."""
        values = ControlSettings(model=model).inputs()
        self._model.exchange([values[name] for name in MODEL])
        return self.read_back()

    def write_payload(self, mass: float) -> ControlSettings:
        """Puts an assumed mass of a box (kg) into force from the next tick."""
        self._resource.write(PAYLOAD, mass)
        return self.read_back()

    def write_offsets(self, offsets: JointVector) -> ControlSettings:
        """Puts known offsets of the encoders (rad) into force; what is taken off follows them by small steps."""
        for name, offset in zip(OFFSETS, offsets, strict=True):
            self._resource.write(name, offset)
        return self.read_back()

    def read_back(self) -> ControlSettings:
        """The settings in the blocks of the controller."""
        read = self._resource.read
        return ControlSettings.from_inputs({name: read(name) for name in ControlSettings().inputs()})
