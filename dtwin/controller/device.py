"""The control application on a device (4diac FORTE or the embedded runtime), through its ports."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from typing import Final, NamedTuple

from dtwin.controller.application import TIMEOUT, Application
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
    STOPPED,
    TUNING,
    VERDICT,
    received_voltages,
    sensor_values,
)
from dtwin.controller.sequence import CALLS, HELP, SequenceSettings
from dtwin.controller.settings import ControlSettings
from dtwin.errors import CommunicationError
from dtwin.parameters import JOINTS, JointVector
from dtwin.signals import ARM_STATES, STOPS, ArmState, Sensors, Stop, Voltages
from iec61499.net.address import StreamAddress
from iec61499.net.client import BlockingClient

SETTLING: Final = 16
"""Number of samples after which an observer with its usual bandwidth of 100 rad/s has forgotten another motion."""
_OUTCOME: Final = (*PATH, HELP, STOPPED)
"""What an answer comes with, beside the command."""
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

    amplitude: JointVector
    unit: int
    delay: tuple[int, ...]
    samples: int


class Outcome(NamedTuple):
    """What an answer comes with, beside the command.

    Attributes:
        path: desired angles of the path, rad.
        help: number of what the sequence calls help for, in `CALLS`.
        stop: stop in force.
    """

    path: JointVector
    help: int
    stop: Stop


class ControlLoop:
    """The application as a controller: it answers samples with commands.

    Args:
        address: address of device management.
        patience: longest wait for every answer, s.

    Attributes:
        settings: settings of the same application over the same management session; another thread may use them.
        safe_stop: safe stop of the same application over the same management session; another thread may use it.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """

    def __init__(self, address: StreamAddress, patience: float = TIMEOUT) -> None:
        self._requesting = threading.Lock()
        with ExitStack() as opened:
            self._application = opened.enter_context(closing(Application(address, patience=patience)))
            self._application.watch(_OUTCOME)
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

    def restart(self, way: Sequence[Sensors], recent: Sequence[Sensors]) -> None:
        """Makes the application plan its path anew from the last sample and the velocity it has there.

        It requests the identification signal and takes the request back at once: meanwhile the path planner starts
        from the measured state, and an arm that is led away from its path trips nothing. The next `answer`, to the
        last sample, comes from the control law again.

        Args:
            way: samples that lead the application to the first of the recent ones.
            recent: at least one sample, each a tick after the one before, so that they show the velocity; where
                there are few, the arm is taken to have rested before them.
        """
        rest = [recent[0]] * (SETTLING + 1 - len(recent))
        with self._requests() as request:
            request.exchange([True])
            for sensors in (*way, *rest, *recent[:-1]):
                self.answer(sensors)
            request.exchange([False])

    def last_angles(self) -> JointVector | None:
        """Measured angles of the last sample that the application has answered, rad; None while there are no two."""
        time, *theta = self._application.read(LAST_SAMPLE)
        return tuple(theta) if time > 0.0 else None

    def signal(self) -> PlayedSignal:
        """The identification signal that the blocks play on request."""
        found = self._application.read(SIGNAL)
        unit, *delay, samples = map(round, found[JOINTS:])
        return PlayedSignal(tuple(found[:JOINTS]), unit, tuple(delay), samples)

    def request_signal(self, run: bool) -> None:
        """Makes the blocks play the identification signal from the next sample on, or stop playing it."""
        with self._requests() as request:
            request.exchange([run])

    @contextmanager
    def _requests(self) -> Iterator[BlockingClient]:
        """A connection to the request port, which a FORTE serves to one client at a time."""
        with self._requesting, self._application.connect(REQUEST) as request:
            yield request

    def outcome(self) -> Outcome:
        """What the last answer came with, beside the command."""
        *theta, help_, stop = self._application.watched(_OUTCOME)
        for name, number, of in ((HELP, help_, CALLS), (STOPPED, stop, STOPS)):
            if number not in range(len(of)):
                raise CommunicationError(f"{name}: expected a whole number from 0 to {len(of) - 1}, got {number:g}")
        return Outcome(tuple(theta), int(help_), STOPS[int(stop)])


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

    def put_sequence(self, sequence: SequenceSettings) -> set[str]:
        """Gives the application the sequence of the run before it answers a sample.

        Returns:
            The names of the inputs that had other values.
        """
        values = sequence.inputs()
        other = sequence.differing(self._application.read_like(values))
        for name in other:
            self._application.write(name, values[name])
        if left := sequence.differing(self._application.read_like(values)):
            raise CommunicationError(
                f"the controller does not take the sequence of this run: {', '.join(sorted(left))}"
            )
        return other

    def put(self, group: tuple[str, ...], settings: ControlSettings) -> ControlSettings:
        """Changes one of GROUPS to that of some settings; returns what is in force then.

        Gains and target time, and a model, come in one message between two ticks; the blocks follow offsets of the
        encoders by small steps. The blocks begin the integrals of the feedback anew with a model, so that one that is
        in force is not sent.
        """
        check_bounds(settings)
        if group == MODEL and not settings.differing(found := self.in_force()) & set(MODEL):
            return found
        sent = settings.inputs()
        if group in self._ports:
            self._ports[group].exchange([sent[name] for name in group])
        else:
            for name in group:
                self._application.write(name, sent[name])
        return self._await(group, settings)

    def _await(self, names: tuple[str, ...], wanted: ControlSettings) -> ControlSettings:
        """Reads inputs back until they are in force: the blocks may act after they acknowledge."""
        sent = wanted.inputs()
        deadline = time.monotonic() + _READ_BACK
        while True:
            began = time.monotonic()  # what is read takes its time and may be of before, however late it comes
            found = self.in_force()
            other = wanted.differing(found) & set(names)
            if not other:
                return found
            if began > deadline:
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
