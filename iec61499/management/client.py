"""Asks a device (4diac FORTE or `dtwin fb run`) to create, connect, write, read, start and stop."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Sequence
from itertools import takewhile
from typing import Final

from iec61499.errors import CommunicationError
from iec61499.management.protocol import (
    ANY,
    EVENT,
    REQUEST_LIMIT,
    REQUESTS,
    RESPONSES,
    WINDOW,
    ManagedBlock,
    ManagedConnection,
    ManagedType,
    ManagementError,
    Reason,
    Request,
    RequestAction,
    Response,
    Subject,
    Watch,
    Window,
    parse_response,
)
from iec61499.net.address import StreamAddress
from iec61499.net.client import BlockingClient
from iec61499.net.sockets import Closing
from iec61499.net.wire import Message

_RESET: Final[tuple[RequestAction, ...]] = ("KILL", "RESET", "START")
TIMEOUT: Final = 5.0
"""Longest time for a response, s."""
ATTEMPT: Final = 2.0
"""Longest time for the first response of a session, s; then another session is begun, as long as there is time."""
PAUSE: Final = 0.02
"""Time between two sessions, s: a device that is kept busy with new ones does not get on with what it has."""

Step = tuple[str, RequestAction, Subject | None]
"""A resource, or "" for the device, what is asked of it, and for what."""


class ManagementClient(Closing):
    """One management session.

    Every method but `request` and `request_all` raises ManagementError when the device refuses, and
    CommunicationError when it does not answer in time, is not there, or the request is longer than a FORTE takes.

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
        self._taken: int | None = None

    def close(self) -> None:
        self._client.close()

    @property
    def lost(self) -> bool:
        """Whether the session has ended, by `close` or after an error."""
        return self._client.lost

    def reconnect(self) -> None:
        """Ends the session and begins another one."""
        self._client.close()
        self.attended()

    def attended(self) -> ManagementClient:
        """This client once the device has answered it, in this session or in one that is begun anew.

        A FORTE has one client at a time, and ends the session of another one at once until it has noticed that the
        last has gone. It may lose the first request of one that comes while the last one goes, since its threads
        count what has come without a lock.
        """
        deadline = time.monotonic() + self._timeout
        while True:
            try:
                if self._client.lost:
                    self._client = self._connected()
                    self._taken = None
                self._client.timeout = min(ATTEMPT, self._timeout)
                self.blocks("")
                self._client.timeout = self._timeout
                return self
            except CommunicationError:
                if time.monotonic() > deadline:
                    self._client.close()
                    raise
                time.sleep(PAUSE)

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
        request = self._numbered(action, subject)
        return self._response(request, self._client.exchange(_encoded(resource, request)))

    def request_all(self, steps: Sequence[Step]) -> list[Response]:
        """The device's responses to requests, each of which is carried out whatever becomes of the others.

        The device gets several at once if it takes them. Raises CommunicationError as `request`.
        """
        requests = [self._numbered(action, subject) for _, action, subject in steps]
        messages = [_encoded(step[0], request) for step, request in zip(steps, requests, strict=True)]
        answers = self._client.exchange_all(messages, self._window() if len(steps) > 1 else 1)
        return [self._response(request, answer) for request, answer in zip(requests, answers, strict=True)]

    def demand(self, resource: str, action: RequestAction, subject: Subject | None = None) -> Response:
        """The response to a request that the device must fulfil. Raises ManagementError when it refuses."""
        response = self.request(resource, action, subject)
        if response.reason is not None:
            raise self._refusal((resource, action, subject), response.reason, response.detail)
        return response

    def demand_all(self, steps: Sequence[Step]) -> Iterator[Response]:
        """The responses to requests that the device must fulfil, one after another, as they come.

        The device gets several at once if it takes them, yet carries out none after one that it refuses. All
        responses must be taken, else the session ends.

        Raises:
            ManagementError: the device refuses a request: the first for which there is no response here.
            CommunicationError: as `request`. Requests beyond those with a response here may have been carried out.
        """
        window = self._window() if len(steps) > 1 else 1
        requests: list[Request] = []
        for _, action, subject in steps:
            after = requests[-1].id if window > 1 and requests else ""
            requests.append(self._numbered(action, subject, after))
        messages = [_encoded(step[0], request) for step, request in zip(steps, requests, strict=True)]
        refusal: ManagementError | None = None
        answers = self._client.exchange_all(takewhile(lambda _: refusal is None, messages), window)
        for step, request, answer in zip(steps, requests, answers, strict=False):
            response = self._response(request, answer)
            if refusal is None and response.reason is not None:
                refusal = self._refusal(step, response.reason, response.detail)
            elif refusal is None:
                yield response
        if refusal is not None:
            raise refusal

    def _window(self) -> int:
        """How many requests may be under way at once."""
        if self._taken is None:
            self._taken = min(max(1, self.request("", "QUERY", Window()).window or 1), WINDOW)
        return self._taken

    def _numbered(self, action: RequestAction, subject: Subject | None, after: str = "") -> Request:
        self._number = self._number % 999_999 + 1
        return Request(str(self._number), action, subject, after)

    def _response(self, request: Request, answer: Message) -> Response:
        response = parse_response(str(answer[0]).encode("latin-1").decode("utf-8", "replace"))
        if response.id != request.id:
            raise CommunicationError(f"{self.address}: response to request {response.id!r}, expected {request.id}")
        return response

    def _refusal(self, step: Step, reason: Reason, detail: str = "") -> ManagementError:
        resource, action, subject = step
        where = f"resource {resource}" if resource else "device"
        text = f"{self.address}: {where} refused {Request('', action, subject)}: {reason}"
        return ManagementError(reason, f"{text}, {detail}" if detail else text)

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
        return self.read_all([(resource, source)])[0]

    def read_all(self, ports: Iterable[tuple[str, str]]) -> list[str]:
        """The values of ports, each with its resource, as the device prints them."""
        steps: list[Step] = [(resource, "READ", ManagedConnection(source, ANY)) for resource, source in ports]
        return [self._value(step, response) for step, response in zip(steps, self.request_all(steps), strict=True)]

    def _value(self, step: Step, response: Response) -> str:
        if response.reason is None:
            # a FORTE leaves out an empty text
            return response.value or ""
        # the FORTE of September 2024 reads what it prints with eight characters or more by watches only
        resource, _, port = step
        assert isinstance(port, ManagedConnection)
        found = self._read_by_watch(resource, port.source) if response.reason == "INVALID_OBJECT" else None
        if found is None:
            raise self._refusal(step, response.reason, response.detail)
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


def _encoded(resource: str, request: Request) -> list[str]:
    """What is sent for a request. Raises CommunicationError when it is longer than a FORTE takes."""
    name, text = resource.encode(), request.xml().encode()
    size = len(name) + len(text) + 6
    if size > REQUEST_LIMIT:
        raise CommunicationError(f"{request}: {size} bytes, expected at most {REQUEST_LIMIT}")
    # a STRING carries bytes: UTF-8 here
    return [name.decode("latin-1"), text.decode("latin-1")]
