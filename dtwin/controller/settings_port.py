"""The port through which settings reach a running controller: the block SYSTEM_SIMULATION.

A message carries all gains and the target time, or all model parameters. It arrives as one event between two ticks,
so that the controller has either all of its values or none. The mass of a box, and offsets of the encoders, which the
blocks follow by small steps, are written to the inputs that hold them.
"""

from __future__ import annotations

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.ports import ARM_MODEL, GAINS, MODEL, TUNING
from dtwin.controller.settings import ControlSettings


class EmbeddedPort:
    """The settings port of a controller in this process; used between the steps of the controller.

    Args:
        controller: controller whose application has the block SYSTEM_SIMULATION.

    Raises:
        FunctionBlockError: the application has no such block.
    """

    def __init__(self, controller: EmbeddedController) -> None:
        self._resource = controller.resource
        ports = {TUNING: GAINS, MODEL: ARM_MODEL}
        self._together = {group: self._resource.server(port.block) for group, port in ports.items()}

    def put(self, group: tuple[str, ...], settings: ControlSettings, who: str = "", why: str = "") -> ControlSettings:
        """Puts one of GROUPS of some settings into force; returns all that are in force then.

        The target time counts from the next motion, everything else from the next tick; what is taken off the
        encoders follows their offsets by small steps. The blocks keep nothing of who wants it and why.
        """
        values = settings.inputs()
        if group in self._together:
            self._together[group].exchange([values[name] for name in group])
        else:
            for name in group:
                self._resource.write(name, values[name])
        return self.read_back()

    def read_back(self) -> ControlSettings:
        """The settings in the blocks of the controller."""
        read = self._resource.read
        return ControlSettings.from_inputs({name: read(name) for name in ControlSettings().inputs()})
