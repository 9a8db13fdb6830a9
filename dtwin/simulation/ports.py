"""How settings reach a running controller: through the blocks of SYSTEM_SIMULATION, in process or over TCP.

A message carries all gains and the target time, or all model parameters, and arrives as one event between two ticks:
the controller has all of it or nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Final, Protocol

from dtwin.control import LAWS, ControlSettings, EmbeddedController
from dtwin.errors import CommunicationError
from dtwin.iec61499.address import Address
from dtwin.iec61499.client import BlockingClient
from dtwin.iec61499.management_client import ManagementClient
from dtwin.iec61499.types import LREAL
from dtwin.iec61499.wire import Signature
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, Gains
from dtwin.simulation.objective import triple

GAIN_PORT: Final = "TWIN.SIMULATION.GAIN_PORT"
MODEL_PORT: Final = "TWIN.SIMULATION.MODEL_PORT"
GAIN_TCP: Final = 61504
MODEL_TCP: Final = 61505
MODEL_SIZE: Final = 18
"""K, m, I, l, c and D of three joints; the controller does not compensate Coulomb friction"""
TIMEOUT: Final = 1.0
"""s for an answer"""
_GAINS: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in ("KP", "KI", "KD") for joint in (1, 2, 3))
_MODEL: Final = tuple(f"CONTROLLER.{name.upper()}" for name in PARAMETER_NAMES[:MODEL_SIZE])
_REST: Final = ("PLANNER.T", "CONTROLLER.PAYLOAD_MASS", "CONTROLLER.LAW")


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
        return _read(lambda name: float(self._resource.read(name)))


class DevicePort:
    """A controller on a device, a 4diac FORTE or the embedded runtime, over its TCP ports.

    Args:
        management: address of device management, usually 61499.
        resource: that runs the application.
        gain_port, model_port: TCP ports of SYSTEM_SIMULATION.
        timeout: s, to connect and for every answer.

    Raises:
        CommunicationError: the device does not answer.
    """

    def __init__(
        self,
        management: Address,
        resource: str = "EMB_RES",
        gain_port: int = GAIN_TCP,
        model_port: int = MODEL_TCP,
        timeout: float = TIMEOUT,
    ) -> None:
        self._resource = resource
        self._management = ManagementClient(management, timeout)
        self._gain_address = Address(management.host, gain_port)
        self._model_address = Address(management.host, model_port)
        self._timeout = timeout

    def __enter__(self) -> DevicePort:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._management.close()

    def send_gains(self, gains: Gains, target_time: float) -> None:
        """As `EmbeddedPort.send_gains`. Raises CommunicationError when nobody acknowledges."""
        self._send(self._gain_address, gain_values(gains, target_time))

    def send_model(self, model: ArmParameters) -> None:
        """As `EmbeddedPort.send_model`. Raises CommunicationError when nobody acknowledges."""
        self._send(self._model_address, model_values(model))

    def read_back(self) -> ControlSettings:
        """The settings as the controller's blocks have them. Raises CommunicationError."""
        return _read(self._number)

    def _send(self, address: Address, values: Sequence[float]) -> None:
        with BlockingClient(address, Signature([LREAL] * len(values)), Signature([]), self._timeout) as client:
            client.exchange(values)

    def _number(self, name: str) -> float:
        text = self._management.read(self._resource, name)
        try:
            return float(text)
        except ValueError:
            raise CommunicationError(f"{self._management.address}: {name}: expected a number, got {text!r}") from None


def _read(number: Callable[[str], float]) -> ControlSettings:
    """The settings, value by value."""
    gains = [number(name) for name in _GAINS]
    model = [number(name) for name in _MODEL]
    target_time, payload, law = (number(name) for name in _REST)
    return ControlSettings(
        target_time,
        Gains(triple(gains[:3]), triple(gains[3:6]), triple(gains[6:])),
        LAWS[int(law)],
        ArmParameters.from_vector((*model, 0.0, 0.0, 0.0)),
        payload,
    )
