"""A controller behind a TCP port, in lockstep: a 4diac FORTE, or the embedded runtime as a device."""

from __future__ import annotations

from types import TracebackType
from typing import Final, Protocol

from dtwin.controller.ports import EMULATOR, received_voltages, sensor_values
from dtwin.errors import CommunicationError
from dtwin.iec61499.net.address import Address
from dtwin.iec61499.net.client import BlockingClient
from dtwin.parameters import Triple
from dtwin.signals import Sensors, Voltages

TIMEOUT: Final = 1.0
"""s, for every answer"""


class Shadow(Protocol):
    """The same control program in process, stepped on the same samples."""

    def step(self, sensors: Sensors) -> Voltages: ...
    def target(self) -> Triple: ...


class RemoteController:
    """A controller behind a TCP port, and its shadow.

    The path's angles are not on the wire: they are those of the shadow, which is the same application in process.

    Args:
        address: of the port, usually 61500.
        shadow: not stepped by anybody else.
        timeout: s, to connect and for every answer.

    Attributes:
        largest_difference: V, between the voltages of the two so far.

    Raises:
        CommunicationError: nobody answers at the address.
    """

    def __init__(self, address: Address, shadow: Shadow, timeout: float = TIMEOUT) -> None:
        self.largest_difference = 0.0
        self._shadow = shadow
        self._client = BlockingClient(address, EMULATOR.receives, EMULATOR.sends, timeout)

    def __enter__(self) -> RemoteController:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._client.close()

    def step(self, sensors: Sensors) -> Voltages:
        """The port's answer to a sample.

        Raises:
            CommunicationError: the answer is late, lost or not finite; names tick, peer and timeout.
        """
        try:
            command = received_voltages(sensors, self._client.exchange(sensor_values(sensors)), self._client.address)
        except CommunicationError as error:
            raise CommunicationError(f"{_tick(sensors)}: {error}") from None
        expected = self._shadow.step(sensors)
        apart = max(abs(one - other) for one, other in zip(command.volts, expected.volts, strict=True))
        self.largest_difference = max(self.largest_difference, apart)
        return command

    def target(self) -> Triple:
        """The path's angles (rad) of the last step."""
        return self._shadow.target()


def _tick(sensors: Sensors) -> str:
    return f"tick {sensors.sequence} (t = {sensors.time:.2f} s)"
