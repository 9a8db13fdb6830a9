"""The control application on a device (4diac FORTE or the embedded runtime), through its TCP ports.

Where its blocks listen is read over device management from their ID inputs; a device that does not tell has them
where the library puts them.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Final, TypeVar

from dtwin.errors import CommunicationError
from dtwin.iec61499.address import Address, parse_block_id
from dtwin.iec61499.client import BlockingClient
from dtwin.iec61499.management import ManagementError
from dtwin.iec61499.management_client import ManagementClient
from dtwin.iec61499.types import BOOL, DINT, LREAL
from dtwin.iec61499.wire import Signature
from dtwin.messages import ARM_STATES, STOPS, ArmState, Stop
from dtwin.parameters import ArmParameters, Gains, Triple
from dtwin.remote import SENSORS, VOLTAGES
from dtwin.signals import Sensors, Voltages

V = TypeVar("V", float, Gains, ArmParameters)

TIMEOUT: Final = 1.0
"""s, for every answer"""
CELL: Final = ("EMULATOR", 61500)
REQUEST: Final = ("TWIN.IDENTIFICATION.REQUEST", 61501)
GAINS: Final = ("TWIN.SIMULATION.GAIN_PORT", 61504)
MODEL: Final = ("TWIN.SIMULATION.MODEL_PORT", 61505)
VERDICT: Final = ("TWIN.MONITORING.VERDICT", 61506)
"""Blocks that listen, and where the library puts them."""

_NOTHING: Final = Signature([])
_PATH: Final = tuple(f"PLANNER.THETA_D{joint}" for joint in (1, 2, 3))
_GAINS: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in ("KP", "KI", "KD") for joint in (1, 2, 3))
_MODEL: Final = tuple(f"CONTROLLER.{kind}{joint}" for kind in ("K", "M", "I", "L", "C", "D") for joint in (1, 2, 3))
_TARGET_TIME: Final = "PLANNER.T"
DIGITS: Final = 1e-14
"""relative difference of a number and what a FORTE writes of it"""
_READ_BACK: Final = 0.2
"""s after which a setting that was acknowledged must show"""


class Application:
    """A management session with the device, and the addresses of its blocks.

    Threads may share it, and should: a FORTE serves one management client at a time.

    Args:
        address: of device management.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """

    def __init__(self, address: Address) -> None:
        self._address = address
        self._lock = threading.Lock()
        self._management = ManagementClient(address, TIMEOUT)
        try:
            self._resource = self._find_resource()
        except CommunicationError:
            self._management.close()
            raise

    def close(self) -> None:
        self._management.close()

    def read(self, names: Sequence[str]) -> list[float]:
        """Values of LREAL ports.

        Raises:
            CommunicationError: no answer, or no number.
        """
        with self._lock:
            texts = [self._management.read(self._resource, name) for name in names]
        try:
            return [float(text) for text in texts]
        except ValueError:
            raise CommunicationError(f"{self._address}: expected numbers at {names}, got {texts}") from None

    def connect(self, block: tuple[str, int], sends: Signature, receives: Signature) -> BlockingClient:
        """A connection to a block that listens."""
        name, usual = block
        try:
            with self._lock:
                port = parse_block_id(self._management.read(self._resource, f"{name}.ID")).port
        except ManagementError:
            port = usual
        return BlockingClient(Address(self._address.host, port), sends, receives, TIMEOUT)

    def _find_resource(self) -> str:
        for resource in self._management.blocks(""):
            if any(block.name == CELL[0] for block in self._management.blocks(resource.name)):
                return resource.name
        raise CommunicationError(f"{self._address}: no resource has a block {CELL[0]}: deploy the application first")


class ControlLoop:
    """The application as a controller: a sample in, a command out.

    Args:
        address: of device management.

    Attributes:
        settings: of the same application, over the same management session; for another thread if need be.
        safe_stop: of the same application, in the same way.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """

    def __init__(self, address: Address) -> None:
        self._application = Application(address)
        self.settings = Settings(self._application)
        self.safe_stop = SafeStop(self._application)
        try:
            self._cell = self._application.connect(CELL, SENSORS, VOLTAGES)
        except CommunicationError:
            self._application.close()
            raise

    def close(self) -> None:
        self._cell.close()
        self.safe_stop.close()
        self._application.close()

    def answer(self, sensors: Sensors) -> Voltages:
        """The application's answer to a sample.

        Raises:
            CommunicationError: it is late, lost, or not finite.
        """
        sample = (*sensors.theta, sensors.gripper, sensors.box_present, sensors.box_colour)
        v_1, v_2, v_3, v_gripper, gripped = self._cell.exchange(sample)
        volts = (v_1, v_2, v_3, v_gripper)
        if not all(map(math.isfinite, volts)):
            raise CommunicationError(f"{self._cell.address}: expected finite volts, got {volts}")
        return Voltages(sensors.sequence, sensors.time, volts, gripped)

    def restart(self, sensors: Sensors) -> None:
        """Lets the application plan its path from a sample, at rest and without integrals of the past.

        An identification request that is taken back at once hands the arm over and back: the path planner starts
        from the measured state. The repeated sample is that of an arm at rest. The next `answer` to the same sample
        is the controller's again.
        """
        request = self._application.connect(REQUEST, Signature([BOOL]), _NOTHING)
        try:
            request.exchange([True])
            for _ in range(3):
                self.answer(sensors)
            request.exchange([False])
        finally:
            request.close()

    def path(self) -> Triple:
        """The path's angles (rad) in the last answer."""
        theta_1, theta_2, theta_3 = self._application.read(_PATH)
        return theta_1, theta_2, theta_3


class Settings:
    """Gains, model and target time of the running application; used from one thread at a time.

    All methods raise CommunicationError when the device does not answer, or does not take over a value.
    """

    def __init__(self, application: Application) -> None:
        self._application = application

    def gains(self) -> Gains:
        """Those in effect."""
        k = self._application.read(_GAINS)
        return Gains(_triple(k[0:3]), _triple(k[3:6]), _triple(k[6:9]))

    def target_time(self) -> float:
        """Of the next motion, s."""
        return self._application.read([_TARGET_TIME])[0]

    def model(self) -> ArmParameters:
        """The one in effect; the controller knows no Coulomb friction."""
        values = self._application.read(_MODEL)
        return ArmParameters.from_vector((*values, 0.0, 0.0, 0.0))

    def set_gains(self, gains: Gains) -> Gains:
        """Changes the gains between two ticks; returns what is in effect then."""
        self._send(GAINS, (*gains.kp, *gains.ki, *gains.kd, self.target_time()))
        return self._confirmed(gains, self.gains)

    def set_target_time(self, seconds: float) -> float:
        """Changes the time that motions take from the next one on; returns what is in effect then."""
        gains = self.gains()
        self._send(GAINS, (*gains.kp, *gains.ki, *gains.kd, seconds))
        return self._confirmed(seconds, self.target_time)

    def set_tuning(self, gains: Gains, seconds: float) -> None:
        """Changes gains and target time together, in one message between two ticks."""
        self._send(GAINS, (*gains.kp, *gains.ki, *gains.kd, seconds))
        self._confirmed(gains, self.gains)

    def set_model(self, model: ArmParameters) -> ArmParameters:
        """Changes the model between two ticks; returns what is in effect then."""
        values = model.vector()[: len(_MODEL)]
        self._send(MODEL, values)
        return self._confirmed(ArmParameters.from_vector((*values, 0.0, 0.0, 0.0)), self.model)

    def _send(self, block: tuple[str, int], values: Sequence[float]) -> None:
        client = self._application.connect(block, Signature([LREAL] * len(values)), _NOTHING)
        try:
            client.exchange(values)
        finally:
            client.close()

    def _confirmed(self, wanted: V, read: Callable[[], V]) -> V:
        """What is in effect, once it is what was wanted: the acknowledgement may come before the blocks have run."""
        deadline = time.monotonic() + _READ_BACK
        while not _alike(found := read(), wanted):
            if time.monotonic() > deadline:
                raise CommunicationError(f"the controller has {found}, expected {wanted}")
        return found


class SafeStop:
    """The stop that the blocks decide on; used from one thread at a time.

    It stays connected from its first use on: a FORTE refuses a client that comes when another has just gone.

    All methods return the stop that is in force then, and raise CommunicationError when the device does not answer.
    """

    def __init__(self, application: Application) -> None:
        self._application = application
        self._client: BlockingClient | None = None
        self._closed = False
        self._lock = threading.Lock()

    def close(self) -> None:
        """Ends the connection, also from another thread than the one that uses it."""
        with self._lock:
            self._closed = True
            if self._client is not None:
                self._client.close()

    def now(self) -> Stop:
        """The one in force."""
        return self.judge("nominal", 0.0)

    def judge(self, state: ArmState, confidence: float) -> Stop:
        """Tells a verdict on the arm and its probability; what is not a sure failure changes nothing."""
        return self._tell(state, confidence, False)

    def release(self) -> Stop:
        """An operator's release; it counts unless the arm still brakes."""
        return self._tell("nominal", 0.0, True)

    def _tell(self, state: ArmState, confidence: float, release: bool) -> Stop:
        client = self._client or self._connected()
        try:
            (stop,) = client.exchange((ARM_STATES.index(state), confidence, release))
        except CommunicationError:
            self._client = None  # the exchange has closed it
            raise
        return STOPS[int(stop)]

    def _connected(self) -> BlockingClient:
        client = self._application.connect(VERDICT, Signature([DINT, LREAL, BOOL]), Signature([DINT]))
        with self._lock:
            if self._closed:
                client.close()
                raise CommunicationError(f"{client.address}: the connection is given up")
            self._client = client
        return client


@contextmanager
def settings_at(address: Address) -> Iterator[Settings]:
    """The settings of the application on a device, over a management session of their own.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """
    application = Application(address)
    try:
        yield Settings(application)
    finally:
        application.close()


def _alike(one: float | Gains | ArmParameters, other: float | Gains | ArmParameters) -> bool:
    """Whether two settings are the same to what FORTE writes of a LREAL: 15 digits."""
    return all(math.isclose(a, b, rel_tol=DIGITS) for a, b in zip(_numbers(one), _numbers(other), strict=True))


def _numbers(setting: float | Gains | ArmParameters) -> tuple[float, ...]:
    if isinstance(setting, Gains):
        return (*setting.kp, *setting.ki, *setting.kd)
    return setting.vector() if isinstance(setting, ArmParameters) else (setting,)


def _triple(values: Sequence[float]) -> Triple:
    first, second, third = values
    return first, second, third
