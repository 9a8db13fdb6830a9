"""A management session with the control application on a device, and connections to its blocks.

The ports at which its blocks listen are read over device management from their ID inputs. A device that does not
answer this has them at the ports of the library.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Mapping, Sequence
from typing import Final

from dtwin.controller.ports import APPLICATION, EMULATOR, Port
from dtwin.errors import CommunicationError
from iec61499.literals import format_string, format_typed
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import ANY, ManagedConnection, ManagementError
from iec61499.mapping import literal_of
from iec61499.net.address import LocalAddress, StreamAddress, parse_block_id
from iec61499.net.client import BlockingClient
from iec61499.types import ElementaryType

TIMEOUT: Final = 1.0
"""Longest wait for every answer where time presses, s."""


class Application:
    """A management session with the device, and the addresses of its blocks.

    Threads share one session, because a FORTE serves one management client at a time.

    Args:
        address: address of device management.
        application: name of the application, with which the names of its blocks on the device begin.
        first: block that an application of this kind has, by which it is found.
        patience: longest wait for every answer, s.

    Raises:
        CommunicationError: the device does not answer, or the application is not there.
    """

    def __init__(
        self,
        address: StreamAddress,
        application: str = APPLICATION,
        first: str = EMULATOR.block,
        patience: float = TIMEOUT,
    ) -> None:
        self._address = address
        self._patience = patience
        self._name = application
        self._first = first
        self._lock = threading.Lock()
        self._management = ManagementClient(address, patience)
        try:
            self._resource = self._find_resource()
        except CommunicationError:
            self._management.close()
            raise

    def close(self) -> None:
        self._management.close()

    def _on_device(self, name: str) -> str:
        """What a block or port of the application is called on a device, as 4diac IDE calls it."""
        return f"{self._name}.{name}"

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
                texts[name] = self._management.read(self._resource, self._on_device(name))
        return self._numbers(names, texts)

    def read_like(self, values: Mapping[str, float | str]) -> dict[str, float | str]:
        """Values of the same ports and of the same kinds, numbers or texts, as those that are given.

        Raises:
            CommunicationError: the device does not answer, or a value is not of its kind.
        """
        numbers = [name for name, value in values.items() if not isinstance(value, str)]
        found: dict[str, float | str] = dict(zip(numbers, self.read(numbers), strict=True))
        for name in values.keys() - set(numbers):
            with self._lock:
                found[name] = self._management.read(self._resource, self._on_device(name)).strip("'")
        return found

    def write(self, name: str, value: float | str) -> None:
        """Gives a numeric, BOOL or STRING input that nothing is connected to a value.

        Raises:
            CommunicationError: the device does not answer, or refuses.
        """
        with self._lock:
            self._management.write(self._resource, self._on_device(name), literal_of(value))

    def watch(self, names: Sequence[str]) -> None:
        """Adds ports to those that `watched` reads in one request."""
        with self._lock:
            for name in names:
                self._management.watch(self._resource, self._on_device(name))

    def watched(self, names: Sequence[str]) -> list[float]:
        """Values of watched ports in one request.

        Raises:
            CommunicationError: the device does not answer, or a value is no number.
        """
        with self._lock:
            watched = self._management.watched(self._resource)
        return self._numbers(names, {name: watched.get(self._on_device(name), "") for name in names})

    def _numbers(self, names: Sequence[str], texts: Mapping[str, str]) -> list[float]:
        try:
            return [_number(texts[name]) for name in names]
        except (KeyError, ValueError):
            raise CommunicationError(f"{self._address}: expected numbers at {names}, got {texts}") from None

    def connect(self, port: Port) -> BlockingClient:
        """Connects to a SERVER block.

        Raises:
            CommunicationError: the block does not listen, or does not accept the connection.
        """
        number, listens = port.number, "TRUE"
        with self._lock, contextlib.suppress(ManagementError):
            number = parse_block_id(self._management.read(self._resource, self._on_device(f"{port.block}.ID"))).port
            listens = self._management.read(self._resource, self._on_device(f"{port.block}.QO"))
        if listens != "TRUE":
            raise self._closed(port, number)
        return BlockingClient(self._address._replace(port=number), port.receives, port.sends, self._patience)

    def reopen(self, port: Port) -> None:
        """On a FORTE, closes the port of a SERVER block and opens it again; no sample may be on its way meanwhile.

        A FORTE takes half a message that a client left behind for the beginning of the next message, whoever sends
        that. The embedded device keeps clients apart; it is told from a FORTE by its Unix sockets, which a FORTE does
        not have, or by having no states of blocks inside others. A FORTE that closes a port while another one is in
        use crashes now and then.

        Raises:
            CommunicationError: the port does not open again.
        """
        if isinstance(self._address, LocalAddress):
            return
        name = self._on_device(port.block)
        with self._lock:
            identity = self._management.read(self._resource, f"{name}.ID")
            try:
                self._management.reset_block(self._resource, name)
            except ManagementError as error:
                if error.reason != "NO_SUCH_OBJECT":
                    raise
                return
            if self._management.read(self._resource, f"{name}.QI") != "TRUE":
                # a FORTE of 2024 takes all values and the types of generic ports back, older ones keep them
                self._management.write(self._resource, f"{name}.ID", format_string(identity, '"'))
                self._management.write(self._resource, f"{name}.QI", "TRUE")
                for number, kind in enumerate(port.receives.types, 1):
                    assert isinstance(kind, ElementaryType)
                    literal = format_typed(kind.default, kind)
                    self._management.write(self._resource, f"{name}.RD_{number}", literal)
            self._management.write(self._resource, f"{name}.QO", "FALSE")
            self._management.trigger(self._resource, f"{name}.INIT")
        deadline = time.monotonic() + TIMEOUT
        while not self.read([f"{port.block}.QO"])[0]:
            if time.monotonic() > deadline:
                raise self._closed(port, parse_block_id(identity).port)

    def _closed(self, port: Port, number: int) -> CommunicationError:
        return CommunicationError(
            f"{self._address}: {port.block} does not listen: expected port {number} to be free, another process may "
            "have it; end that one and deploy the application again"
        )

    def _find_resource(self) -> str:
        """The resource that has the application, by its answer: a FORTE 2 does not list blocks of applications."""
        block = self._on_device(self._first)
        for resource in self._management.blocks(""):
            if self._management.request(resource.name, "READ", ManagedConnection(f"{block}.QO", ANY)).reason is None:
                return resource.name
        raise CommunicationError(f"{self._address}: no resource has a block {block}: deploy the application first")


def _number(text: str) -> float:
    return float(text == "TRUE") if text in ("TRUE", "FALSE") else float(text)
