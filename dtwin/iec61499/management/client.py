"""Asks a device (4diac FORTE or `dtwin fb run`) to create, connect, write, read, start and stop."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Final

from dtwin.errors import CommunicationError
from dtwin.iec61499.management.protocol import (
    ANY,
    EVENT,
    REQUEST_LIMIT,
    REQUESTS,
    RESPONSES,
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Request,
    RequestAction,
    Response,
    Subject,
    Watch,
    parse_response,
)
from dtwin.iec61499.net.address import StreamAddress
from dtwin.iec61499.net.client import BlockingClient

_RESET: Final[tuple[RequestAction, ...]] = ("KILL", "RESET", "START")
TIMEOUT: Final = 5.0
"""Longest time for a response, s."""


class ManagementClient:
    """One management session.

    Every method but `request` raises ManagementError when the device refuses, and CommunicationError when it does
    not answer in time, is not there, or the request is longer than a FORTE takes.

    Args:
        address: the address of device management; its port is usually 61499.
        timeout: longest time for a response, s.

    Raises:
        CommunicationError: nobody answers at the address.
    """

    def __init__(self, address: StreamAddress, timeout: float = TIMEOUT) -> None:
        self.address = address
        self._timeout = timeout
        self._client = self._connected()
        self._number = 0

    def __enter__(self) -> ManagementClient:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        self._client.close()

    @property
    def lost(self) -> bool:
        """Whether the session has ended, by `close` or after an error."""
        return self._client.lost

    def reconnect(self) -> None:
        """Ends the session and begins another one; a FORTE refuses until it has noticed the end."""
        self._client.close()
        deadline = time.monotonic() + self._timeout
        while True:
            try:
                self._client = self._connected()
                self.blocks("")
                return
            except CommunicationError:
                if time.monotonic() > deadline:
                    raise

    def _connected(self) -> BlockingClient:
        return BlockingClient(self.address, REQUESTS, RESPONSES, self._timeout)

    def request(self, resource: str, action: RequestAction, subject: Subject | None = None) -> Response:
        """The device's response, refusals included.

        Args:
            resource: the name of the resource that is asked; "" for the device.
            action: what is asked for.
            subject: what the action is done to; None for the resource or device itself.

        Raises:
            CommunicationError: no response, a malformed one, or the request is too long.
        """
        self._number = self._number % 999_999 + 1
        request = Request(str(self._number), action, subject)
        text = request.xml().encode()
        name = resource.encode()
        size = len(name) + len(text) + 6
        if size > REQUEST_LIMIT:
            raise CommunicationError(f"{request}: {size} bytes, expected at most {REQUEST_LIMIT}")
        # a STRING carries bytes: UTF-8 here
        answer = self._client.exchange([name.decode("latin-1"), text.decode("latin-1")])[0]
        response = parse_response(answer.encode("latin-1").decode("utf-8", "replace"))
        if response.id != request.id:
            raise CommunicationError(f"{self.address}: response to request {response.id!r}, expected {request.id}")
        return response

    def demand(self, resource: str, action: RequestAction, subject: Subject | None = None) -> Response:
        """The response to a request that the device must fulfil. Raises ManagementError when it refuses."""
        response = self.request(resource, action, subject)
        if response.reason is not None:
            what = Request("", action, subject)
            where = f"resource {resource}" if resource else "device"
            raise ManagementError(response.reason, f"{self.address}: {where} refused {what}: {response.reason}")
        return response

    def create_block(self, resource: str, name: str, type_name: str) -> None:
        """Creates a block, or with resource "" a resource."""
        self.demand(resource, "CREATE", ManagedBlock(name, type_name))

    def create_type(self, resource: str, name: str, lua: str) -> None:
        """Gives the device a block type in Lua."""
        self.demand(resource, "CREATE", ManagedType(name, lua))

    def connect(self, resource: str, source: str, destination: str) -> None:
        """Connects two ports, each `BLOCK.PORT`."""
        self.demand(resource, "CREATE", ManagedConnection(source, destination))

    def delete_block(self, resource: str, name: str) -> None:
        """Deletes a block, or with resource "" a resource; it must not be running."""
        self.demand(resource, "DELETE", ManagedBlock(name, ""))

    def write(self, resource: str, destination: str, literal: str) -> None:
        """Gives a port, `BLOCK.PORT`, the value of a literal."""
        self.demand(resource, "WRITE", ManagedConnection(literal, destination))

    def read(self, resource: str, source: str) -> str:
        """The value of a port, as the device prints it."""
        try:
            # a FORTE leaves out an empty text
            return self.demand(resource, "READ", ManagedConnection(source, ANY)).value or ""
        except ManagementError as error:
            # the FORTE of September 2024 reads what it prints with eight characters or more by watches only
            found = self._read_by_watch(resource, source) if error.reason == "INVALID_OBJECT" else None
            if found is None:
                raise
            return found

    def _read_by_watch(self, resource: str, source: str) -> str | None:
        """The value of a port that may be watched; None for another one. Leaves the watches as they were."""
        before = self.request(resource, "READ", Watch()).watches
        if before is not None and any(source in ports for ports in before.values()):
            return self.watched(resource)[source]
        if self.request(resource, "CREATE", Watch(source)).reason is not None:
            return None
        found = self.watched(resource).get(source)
        self.demand(resource, "DELETE", Watch(source))
        return found

    def trigger(self, resource: str, event: str) -> None:
        """Lets an event happen, `BLOCK.EVENT`; a FORTE must have been built with monitoring."""
        self.demand(resource, "WRITE", ManagedConnection(EVENT, event))

    def reset_block(self, resource: str, name: str) -> None:
        """Ends a block and starts it anew: a port of a FORTE closes, and opens with the next event INIT."""
        for action in _RESET:
            self.demand(resource, action, ManagedBlock(name, ""))

    def watch(self, resource: str, source: str) -> None:
        """Adds a port to those that `watched` reads, for all clients."""
        self.demand(resource, "CREATE", Watch(source))

    def watched(self, resource: str) -> dict[str, str]:
        """The values of all watched ports of a resource by `BLOCK.PORT`, in one request; of events how many came."""
        watches = self.demand(resource, "READ", Watch()).watches or {}
        return {port: found.value for ports in watches.values() for port, found in ports.items()}

    def start(self, resource: str) -> None:
        self.demand(resource, "START")

    def stop(self, resource: str) -> None:
        self.demand(resource, "STOP")

    def kill(self, resource: str) -> None:
        self.demand(resource, "KILL")

    def blocks(self, resource: str) -> tuple[ManagedBlock, ...]:
        """The blocks of a resource, or with "" the resources of the device."""
        return self.demand(resource, "QUERY", ManagedBlock(ANY, ANY)).blocks or ()

    def types(self) -> tuple[str, ...]:
        """The names of the block types of the device; none if it does not tell them."""
        return self.request("", "QUERY", ManagedType(ANY)).names or ()
