"""The control application on a device (4diac FORTE or the embedded runtime), through its ports.

The ports at which its blocks listen are read over device management from their ID inputs. A device that does not
answer this has them at the ports of the library.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Final, NamedTuple

from dtwin.controller.bounds import check_bounds
from dtwin.controller.ports import (
    ARM_MODEL,
    EMULATOR,
    GAINS,
    LAST_SAMPLE,
    MODEL,
    PATH,
    REQUEST,
    SIGNAL,
    TUNING,
    VERDICT,
    Port,
    received_voltages,
    sensor_values,
)
from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError
from dtwin.iec61499.management.client import ManagementClient
from dtwin.iec61499.management.protocol import ManagementError
from dtwin.iec61499.net.address import StreamAddress, parse_block_id
from dtwin.iec61499.net.client import BlockingClient
from dtwin.parameters import ArmParameters, Gains, Triple
from dtwin.signals import ARM_STATES, STOPS, ArmState, Sensors, Stop, Voltages

TIMEOUT: Final = 1.0
"""Longest wait for every answer, s."""
_SETTLING: Final = 15
"""Number of equal samples after which an observer with its usual bandwidth of 100 rad/s has forgotten a motion."""
_READ_BACK: Final = 0.2
"""Longest time from the acknowledgement of a setting until it can be read back, s."""


class PlayedSignal(NamedTuple):
    """The 3-2-1-1 signal that the blocks play.

    Attributes:
        amplitude: amplitudes of joints 1 to 3, V.
        unit: length of one unit of time, ticks.
        delay: ticks at 0 V before the signal of joints 1 to 3 starts.
        samples: length of the signal, ticks.
    """

    amplitude: Triple
    unit: int
    delay: tuple[int, int, int]
    samples: int


class Application:
    """A management session with the device, and the addresses of its blocks.

    Threads share one session, because a FORTE serves one management client at a time.

    Args:
        address: address of device management.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """

    def __init__(self, address: StreamAddress) -> None:
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

    @property
    def lost(self) -> bool:
        """Whether the management session has ended."""
        return self._management.lost

    def read(self, names: Sequence[str]) -> list[float]:
        """Values of numeric or BOOL ports of the blocks.

        Raises:
            CommunicationError: the device does not answer, or a value is no number.
        """
        # One request each, so that the path is not kept waiting by a long list. A watch for each would have to be
        # made and taken back, two requests instead of one, or would make every reading of the path longer for good.
        texts = {}
        for name in names:
            with self._lock:
                texts[name] = self._management.read(self._resource, name)
        return self._numbers(names, texts)

    def watch(self, names: Sequence[str]) -> None:
        """Adds ports to those that `watched` reads in one request."""
        with self._lock:
            for name in names:
                self._management.watch(self._resource, name)

    def watched(self, names: Sequence[str]) -> list[float]:
        """Values of watched ports in one request.

        Raises:
            CommunicationError: the device does not answer, or a value is no number.
        """
        with self._lock:
            texts = self._management.watched(self._resource)
        return self._numbers(names, texts)

    def _numbers(self, names: Sequence[str], texts: Mapping[str, str]) -> list[float]:
        try:
            return [_number(texts[name]) for name in names]
        except (KeyError, ValueError):
            raise CommunicationError(f"{self._address}: expected numbers at {names}, got {texts}") from None

    def connect(self, port: Port) -> BlockingClient:
        """Connects to a SERVER block.

        Raises:
            CommunicationError: the block does not accept the connection.
        """
        try:
            with self._lock:
                number = parse_block_id(self._management.read(self._resource, f"{port.block}.ID")).port
        except ManagementError:
            number = port.number
        return BlockingClient(self._address._replace(port=number), port.receives, port.sends, TIMEOUT)

    def reopen(self, port: Port) -> None:
        """On a FORTE, closes the port of a SERVER block and opens it again; no sample may be on its way meanwhile.

        A FORTE takes half a message that a client left behind for the beginning of the next message, whoever sends
        that. The embedded device keeps clients apart; it is told from a FORTE by refusing to trigger events. A FORTE
        that closes a port while another one is in use crashes now and then.

        Raises:
            CommunicationError: the port does not open again.
        """
        name = port.block
        with self._lock:
            try:
                self._management.trigger(self._resource, f"{name}.INIT")
            except ManagementError as error:
                if error.reason != "UNSUPPORTED_CMD":
                    raise
                return
            self._management.reset_block(self._resource, name)
            self._management.write(self._resource, f"{name}.QO", "FALSE")
            self._management.trigger(self._resource, f"{name}.INIT")
        deadline = time.monotonic() + TIMEOUT
        while not self.read([f"{name}.QO"])[0]:
            if time.monotonic() > deadline:
                raise CommunicationError(f"{self._address}: {name} did not open again within {TIMEOUT:g} s")

    def _find_resource(self) -> str:
        for resource in self._management.blocks(""):
            if any(block.name == EMULATOR.block for block in self._management.blocks(resource.name)):
                return resource.name
        raise CommunicationError(
            f"{self._address}: no resource has a block {EMULATOR.block}: deploy the application first"
        )


class ControlLoop:
    """The application as a controller: it answers samples with commands.

    Args:
        address: address of device management.

    Attributes:
        settings: settings of the same application over the same management session; another thread may use them.
        safe_stop: safe stop of the same application over the same management session; another thread may use it.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """

    def __init__(self, address: StreamAddress) -> None:
        self._requesting = threading.Lock()
        with ExitStack() as opened:
            self._application = opened.enter_context(closing(Application(address)))
            self._application.watch(PATH)
            self.settings = opened.enter_context(closing(Settings(self._application)))
            self.safe_stop = opened.enter_context(closing(SafeStop(self._application)))
            self._cell = opened.enter_context(self._application.connect(EMULATOR))
            self._opened = opened.pop_all()

    def close(self) -> None:
        self._opened.close()

    @property
    def lost(self) -> bool:
        """Whether a connection has ended, so that a new ControlLoop is needed."""
        return self._cell.lost or self._application.lost or self.settings.lost

    def answer(self, sensors: Sensors) -> Voltages:
        """The application's answer to a sample.

        Raises:
            CommunicationError: the answer is late, lost, or not finite.
        """
        return received_voltages(sensors, self._cell.exchange(sensor_values(sensors)), self._cell.address)

    def restart(self, samples: Sequence[Sensors]) -> None:
        """Makes the application plan its path anew from the last sample, for an arm at rest and with empty integrals.

        It requests the identification signal and takes the request back at once: meanwhile the path planner starts
        from the measured state, and an arm that is led away from its path trips nothing. The last sample is repeated
        until the blocks see an arm at rest. The next `answer` to it comes from the control law again.

        Args:
            samples: at least one sample; the earlier ones lead the application to the last.
        """
        with self._requests() as request:
            request.exchange([True])
            for sensors in (*samples, *[samples[-1]] * _SETTLING):
                self.answer(sensors)
            request.exchange([False])

    def last_angles(self) -> Triple | None:
        """Measured angles of the last sample that the application has answered, rad; None while there are no two."""
        time, theta_1, theta_2, theta_3 = self._application.read(LAST_SAMPLE)
        return (theta_1, theta_2, theta_3) if time > 0.0 else None

    def signal(self) -> PlayedSignal:
        """The identification signal that the blocks play on request."""
        first, second, third, *counts = self._application.read(SIGNAL)
        unit, delay_1, delay_2, delay_3, samples = map(round, counts)
        return PlayedSignal((first, second, third), unit, (delay_1, delay_2, delay_3), samples)

    def request_signal(self, run: bool) -> None:
        """Makes the blocks play the identification signal from the next sample on, or stop playing it."""
        with self._requests() as request:
            request.exchange([run])

    @contextmanager
    def _requests(self) -> Iterator[BlockingClient]:
        """A connection to the request port, which a FORTE serves to one client at a time."""
        with self._requesting, self._application.connect(REQUEST) as request:
            yield request

    def path(self) -> Triple:
        """Desired angles of the path in the last answer, rad."""
        theta_1, theta_2, theta_3 = self._application.watched(PATH)
        return theta_1, theta_2, theta_3


class Settings:
    """Reads and changes the settings of the running application; used from one thread at a time.

    Its connections to the ports are made at once and kept: a FORTE serves one client per port, so no other client can
    connect. All methods raise CommunicationError when the device does not answer or does not take over a value, and
    ParameterError when a value, sent or found, is out of range.
    """

    def __init__(self, application: Application) -> None:
        self._application = application
        with ExitStack() as opened:
            self._ports = {}
            for port, names in ((GAINS, TUNING), (ARM_MODEL, MODEL)):
                application.reopen(port)
                self._ports[names] = opened.enter_context(application.connect(port))
            self._opened = opened.pop_all()

    def close(self) -> None:
        self._opened.close()

    @property
    def lost(self) -> bool:
        """Whether a connection has ended."""
        return any(port.lost for port in self._ports.values())

    def in_force(self) -> ControlSettings:
        """All settings in force."""
        names = tuple(ControlSettings().inputs())
        return ControlSettings.from_inputs(dict(zip(names, self._application.read(names), strict=True)))

    def set_tuning(self, gains: Gains, target_time: float) -> ControlSettings:
        """Changes gains and target time (s) in one message between two ticks; returns what is in force then."""
        return self._change(TUNING, ControlSettings(target_time, gains))

    def set_model(self, model: ArmParameters) -> ControlSettings:
        """Changes the model in one message between two ticks; returns what is in force then."""
        return self._change(MODEL, ControlSettings(model=model))

    def _change(self, names: tuple[str, ...], wanted: ControlSettings) -> ControlSettings:
        """Sends inputs and reads them back until they are in force: the blocks may act after they acknowledge."""
        check_bounds(wanted)
        sent = wanted.inputs()
        self._ports[names].exchange([sent[name] for name in names])
        deadline = time.monotonic() + _READ_BACK
        while True:
            found = self.in_force()
            other = wanted.differing(found) & set(names)
            if not other:
                return found
            if time.monotonic() > deadline:
                has = {name: found.inputs()[name] for name in sorted(other)}
                expected = {name: sent[name] for name in sorted(other)}
                raise CommunicationError(f"the controller has {has} after an upload, expected {expected}")


class SafeStop:
    """The safe stop that the blocks decide on; used from one thread at a time.

    The connection stays open from its first use on, because a FORTE refuses a client that connects just after another
    one has left. All methods return the stop in force after the call. They raise CommunicationError when the device
    does not answer.
    """

    def __init__(self, application: Application) -> None:
        self._application = application
        self._client: BlockingClient | None = None
        self._closed = False
        self._lock = threading.Lock()

    def close(self) -> None:
        """Ends the connection; any thread may call it."""
        with self._lock:
            self._closed = True
            if self._client is not None:
                self._client.close()

    def now(self) -> Stop:
        """The stop in force."""
        return self.judge("nominal", 0.0)

    def judge(self, state: ArmState, confidence: float) -> Stop:
        """Sends a verdict on the arm and its probability; only a sure failure changes the stop in force."""
        return self._tell(state, confidence, False)

    def release(self) -> Stop:
        """Sends an operator's release; it takes effect unless the arm still brakes."""
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
        client = self._application.connect(VERDICT)
        with self._lock:
            if self._closed:
                client.close()
                raise CommunicationError(f"{client.address}: the connection is given up")
            self._client = client
        return client


def _number(text: str) -> float:
    return float(text == "TRUE") if text in ("TRUE", "FALSE") else float(text)
