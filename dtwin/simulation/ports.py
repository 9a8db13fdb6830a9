"""How settings reach a running controller: through the blocks of SYSTEM_SIMULATION.

A message carries all gains and the target time, or all model parameters, and arrives as one event between two ticks:
the controller has all of it or nothing.
"""

from __future__ import annotations

from typing import Final, Protocol

from dtwin.control import LAWS, ControlSettings, EmbeddedController
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, Gains
from dtwin.simulation.figures import triple

GAIN_PORT: Final = "TWIN.SIMULATION.GAIN_PORT"
MODEL_PORT: Final = "TWIN.SIMULATION.MODEL_PORT"
MODEL_SIZE: Final = 18
"""K, m, I, l, c and D of three joints; the controller does not compensate Coulomb friction"""
_GAINS: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in ("KP", "KI", "KD") for joint in (1, 2, 3))
_MODEL: Final = tuple(f"CONTROLLER.{name.upper()}" for name in PARAMETER_NAMES[:MODEL_SIZE])


class SettingsPort(Protocol):
    """A running controller as uploads see it."""

    def send_gains(self, gains: Gains, target_time: float) -> None: ...
    def send_model(self, model: ArmParameters) -> None: ...
    def read_back(self) -> ControlSettings: ...


def gain_values(gains: Gains, target_time: float) -> tuple[float, ...]:
    """The 10 values of the gain port."""
    return (*gains.kp, *gains.ki, *gains.kd, target_time)


def model_values(model: ArmParameters) -> tuple[float, ...]:
    """The 18 values of the model port."""
    return model.vector()[:MODEL_SIZE]


class EmbeddedPort:
    """A controller in this process; to be used between its steps.

    Args:
        controller: whose application has the block SYSTEM_SIMULATION.

    Raises:
        FunctionBlockError: it has not.
    """

    def __init__(self, controller: EmbeddedController) -> None:
        self._resource = controller.resource
        self._gains = self._resource.server(GAIN_PORT)
        self._model = self._resource.server(MODEL_PORT)

    def send_gains(self, gains: Gains, target_time: float) -> None:
        """Puts gains and target time into force from the next tick; the time from the next motion."""
        self._gains.exchange(gain_values(gains, target_time))

    def send_model(self, model: ArmParameters) -> None:
        """Puts a model into force from the next tick."""
        self._model.exchange(model_values(model))

    def read_back(self) -> ControlSettings:
        """The settings as the controller's blocks have them."""
        read = self._resource.read
        gains, model = [read(name) for name in _GAINS], [read(name) for name in _MODEL]
        return ControlSettings(
            read("PLANNER.T"),
            Gains(triple(gains[:3]), triple(gains[3:6]), triple(gains[6:])),
            LAWS[read("CONTROLLER.LAW")],
            ArmParameters.from_vector((*model, 0.0, 0.0, 0.0)),
            read("CONTROLLER.PAYLOAD_MASS"),
            "weight" if read("CONTROLLER.WEIGHT_ONLY") else "point",
        )
