"""The blocks of a line on devices elsewhere, such as processes of their own or FORTEs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from dtwin.errors import CommunicationError
from dtwin.line.line import MOST_OPERATIONS, Line
from dtwin.line.system import plant_of, setup_of
from iec61499.model import System
from iec61499.net.address import parse_block_id
from iec61499.net.client import BlockingClient
from iec61499.net.sockets import Closing
from iec61499.net.wire import Signature
from iec61499.types import BOOL, DINT, DataType

_TIMEOUT: Final = 5.0
"""Longest wait for an answer of a device elsewhere, s."""
_RETRY: Final = 50
"""Number of samples that a device which does not answer is spared before it is tried again."""


class Served(Closing):
    """The blocks of a line on devices elsewhere, such as those of `dtwin fb run --all`; a context manager.

    A device that has ended, or does not answer in time, is connected to again later.

    Args:
        line: the line.
        whole: its system, whose SERVER blocks say at which ports they listen.
        timeout: longest wait for an answer, s.

    Raises:
        CommunicationError: a block does not listen.
    """

    def __init__(self, line: Line, whole: System, timeout: float = _TIMEOUT) -> None:
        self._timeout = timeout
        self._clients: dict[str, BlockingClient] = {}
        self._spared: dict[str, int] = {}
        identities = {
            block.name: parameter.value.strip("'")
            for application in whole.applications
            for block in application.network.blocks
            for parameter in block.parameters
            if parameter.name == "ID"
        }
        self._ends = {
            name: (parse_block_id(identities[name]), Signature(receives), Signature(sends))
            for name, (receives, sends) in _signatures(line).items()
        }
        try:
            for name in self._ends:
                self._connect(name)
        except CommunicationError:
            self.close()
            raise

    def close(self) -> None:
        """Ends the connections."""
        for client in self._clients.values():
            client.close()

    def _connect(self, block: str) -> None:
        self._clients[block] = BlockingClient(*self._ends[block], self._timeout)

    def exchange(self, block: str, values: Sequence[Any]) -> tuple[Any, ...]:
        if self._spared.get(block):
            self._spared[block] -= 1
            raise CommunicationError(f"{block} does not answer")
        try:
            if self._clients[block].lost:
                self._connect(block)
            return tuple(self._clients[block].exchange(values))
        except CommunicationError:
            self._spared[block] = _RETRY
            raise

    def now(self) -> Any:
        """None: blocks elsewhere are asked for nothing but their answers."""

    def resume(self, now: Any) -> None:
        """Does nothing."""


def _signatures(line: Line) -> dict[str, tuple[list[DataType], list[DataType]]]:
    """What each SERVER block of a line receives and sends."""
    found: dict[str, tuple[list[DataType], list[DataType]]] = {}
    for zone in line.zones:
        found[plant_of(zone.name)] = [DINT] * 3, [DINT] * 2
        found[setup_of(zone.name)] = [DINT] * MOST_OPERATIONS, [DINT] * 2
        found |= {plant_of(vehicle.name): ([DINT, BOOL, *[DINT] * 4], [DINT] * 4) for vehicle in zone.vehicles}
        found |= {plant_of(station.name): ([DINT] * 6, [DINT]) for station in zone.stations}
    return found
