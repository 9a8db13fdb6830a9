"""A controller behind a TCP port, stepped in lockstep: a 4diac FORTE, or the embedded runtime as a device."""

from __future__ import annotations

from typing import Final, Protocol

from dtwin.controller.ports import EMULATOR, received_voltages, sensor_values
from dtwin.errors import CommunicationError
from dtwin.parameters import JointVector
from dtwin.signals import Event, Sensors, Voltages
from iec61499.net.address import StreamAddress
from iec61499.net.client import BlockingClient
from iec61499.net.sockets import Closing

TIMEOUT: Final = 1.0
"""Longest wait for every answer, s."""


class Shadow(Protocol):
    """The same control application in this process, stepped with the same samples."""

    def step(self, sensors: Sensors) -> Voltages:
        """The command that answers a sample."""

    def target(self) -> JointVector:
        """Desired angles of the path at the last step, rad."""

    def drain_events(self) -> list[Event]:
        """What the sequence has told since the last call."""


class RemoteController(Closing):
    """A controller behind a port, and its shadow in this process.

    The desired angles of the path are not sent over TCP; they are taken from the shadow.

    Args:
        address: address of the port, whose number is usually 61500.
        shadow: the same application in this process, which nothing else steps.
        timeout: longest wait for the connection and for every answer, s.

    Attributes:
        largest_difference: largest difference between the voltages of the two so far, V.

    Raises:
        CommunicationError: no connection to the address is accepted in time.
    """

    def __init__(self, address: StreamAddress, shadow: Shadow, timeout: float = TIMEOUT) -> None:
        self.largest_difference = 0.0
        self._shadow = shadow
        self._client = BlockingClient(address, EMULATOR.receives, EMULATOR.sends, timeout)

    def close(self) -> None:
        """Closes the connection."""
        self._client.close()

    def step(self, sensors: Sensors) -> Voltages:
        """The controller's answer to a sample.

        Raises:
            CommunicationError: the answer is late, lost or not finite; the message names tick, peer and timeout.
        """
        try:
            command = received_voltages(sensors, self._client.exchange(sensor_values(sensors)), self._client.address)
        except CommunicationError as error:
            raise CommunicationError(f"{_tick(sensors)}: {error}") from None
        expected = self._shadow.step(sensors)
        apart = max(abs(one - other) for one, other in zip(command.volts, expected.volts, strict=True))
        self.largest_difference = max(self.largest_difference, apart)
        return command

    def target(self) -> JointVector:
        """Desired angles of the path at the last step, rad."""
        return self._shadow.target()

    def drain_events(self) -> list[Event]:
        """What the sequence of the shadow has told since the last call."""
        return self._shadow.drain_events()


def _tick(sensors: Sensors) -> str:
    return f"tick {sensors.sequence} (t = {sensors.time:.2f} s)"
