"""Stopping the arm: the function blocks are asked, what the cell publishes must show it, and there is a second way.

The bridge answers for the blocks. Its word alone is not enough: the emulator must have latched the stop, and the
samples must show an arm at rest, or what acted must be no voltage. If the bridge does not answer, or refuses, the
emulator's latch is asked directly to take the torque off: whatever hangs from the arm then sinks with it.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Final, NamedTuple

from dtwin.bus.chain.messages import JointSensors, JointTicks
from dtwin.bus.messages import (
    ACTED,
    JOINT_SENSORS,
    JOINT_TICKS,
    LATCH,
    SENSORS,
    STOP,
    Acted,
    LatchRequest,
    LatchState,
    StopRequest,
    StopState,
)
from dtwin.bus.session import Bus
from dtwin.errors import CommunicationError
from dtwin.signals import Sensors

ANSWER: Final = 3.0
"""Longest wait for the answer of the bridge or of the latch, s."""
SHOWN: Final = 5.0
"""Longest wait until what the cell publishes shows a stop that is latched, s."""
WINDOW: Final = 20
"""Number of samples over which an arm at rest has to stay where it is."""
REST: Final = 0.03
"""Largest difference between readings of an encoder of an arm at rest, rad; noise of 3 mrad makes half of it."""
_LOOK: Final = 0.05
"""Time between two looks at the latch, s."""
PATIENCE: Final = 5.0
"""Time after which a service that must stop the arm takes the second way, s; a bridge that died is back by then."""


class Stopped(NamedTuple):
    """A stop that the cell has shown.

    Attributes:
        state: the stop.
        trouble: why the first way did not do, "" if it did.
    """

    state: StopState
    trouble: str = ""


class _Witness:
    """Sees what the cell publishes of a stop."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._samples: deque[Sensors | JointSensors] = deque(maxlen=WINDOW)
        self._without = -1.0
        self._subscriptions = [
            bus.subscribe(SENSORS, Sensors, self._samples.append),
            bus.subscribe(ACTED, Acted, self._note),
            bus.subscribe(JOINT_SENSORS, JointSensors, self._samples.append),
            bus.subscribe(JOINT_TICKS, JointTicks, self._note_ticks),
        ]

    def end(self) -> None:
        for subscription in self._subscriptions:
            subscription.end()

    def _note(self, acted: Acted) -> None:
        if not any(acted.volts[:3]):
            self._without = acted.time

    def _note_ticks(self, passed: JointTicks) -> None:
        for tick in passed.ticks:
            if not any(tick.acted.commands):
                self._without = tick.sensors.time

    def confirm(self) -> StopState:
        """The stop in force, once it is shown.

        Raises:
            CommunicationError: it is not.
        """
        until = time.monotonic() + SHOWN
        pause = threading.Event()
        latch = since = self._bus.ask(LATCH, None, LatchState, ANSWER)
        while time.monotonic() < until:
            if latch.stop == "torque off" and self._without >= since.time:
                return StopState(self._without, latch.stop)
            if latch.stop == "standstill" and self._rests(since.time):
                return StopState(self._samples[-1].time, latch.stop)
            pause.wait(_LOOK)
            latch = self._bus.ask(LATCH, None, LatchState, ANSWER)
        if latch.stop == "none":
            raise CommunicationError("the emulator keeps no stop")
        raise CommunicationError(
            f"{latch.stop} is latched, but no samples show it within {SHOWN:g} s: look at the arm"
        )

    def _rests(self, since: float) -> bool:
        """Whether the samples show an arm at rest, up to now."""
        samples = list(self._samples)
        if len(samples) < WINDOW or samples[-1].time < since:
            return False
        return all(max(angles) - min(angles) <= REST for angles in zip(*(s.theta for s in samples), strict=True))


def stop(bus: Bus, request: StopRequest) -> Stopped:
    """Stops the arm, and sees to it that it has stopped.

    Args:
        bus: session of somebody who may ask for a stop, and the latch.
        request: who wants it, and why.

    Raises:
        CommunicationError: the arm may not be stopped: no way has worked, or the cell does not show it.
    """
    witness = _Witness(bus)
    try:
        try:
            if bus.ask(STOP, request, StopState, ANSWER).stop == "none":
                raise CommunicationError("the function blocks do not stop the arm")
        except CommunicationError as error:
            return Stopped(_take_off_torque(bus, witness, error), str(error))
        return Stopped(witness.confirm())
    finally:
        witness.end()


def take_off_torque(bus: Bus) -> LatchState:
    """Has the emulator's latch take the torque off, past bridge and blocks.

    Raises:
        CommunicationError: the emulator does not answer.
    """
    return bus.ask(LATCH, LatchRequest("torque off"), LatchState, ANSWER)


def _take_off_torque(bus: Bus, witness: _Witness, reason: CommunicationError) -> StopState:
    """The second way, past bridge and blocks."""
    try:
        take_off_torque(bus)
        return witness.confirm()
    except CommunicationError as error:
        raise CommunicationError(f"the arm may not be stopped: {reason}; nor by the emulator: {error}") from None
