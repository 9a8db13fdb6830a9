"""Several requests under way at once: with devices that take them, and with those that do not."""

from __future__ import annotations

import socket
import threading
import tracemalloc
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import pytest

from dtwin.errors import CommunicationError
from iec61499.management.client import ManagementClient, Step
from iec61499.management.protocol import (
    REQUEST_LIMIT,
    REQUESTS,
    RESPONSES,
    WINDOW,
    ManagedBlock,
    ManagedConnection,
    ManagementError,
    Request,
    Response,
    Window,
    parse_request,
    parse_response,
)
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.stream import UNSENT_LIMIT
from iec61499.net.wire import MessageReader
from tests.support.iec61499.hostile import hostile, message
from tests.support.iec61499.served_device import PATIENCE, ServedDevice, build


class Device:
    """A device that answers when as many requests have come as are to be under way, or the last one has.

    Args:
        window: how many requests it says that it takes; None does not say.
        held: how many of them are to be under way.
        expected: how many requests come.

    Attributes:
        requests: those that it has received, but for that of the window.
        most: how many of them were under way at once.
    """

    def __init__(self, window: int | None, held: int, expected: int) -> None:
        self.requests: list[Request] = []
        self.most = 0
        self._window = window
        self._held = held
        self._expected = expected
        self._listening = socket.create_server((LOOPBACK, 0))
        self._thread = threading.Thread(target=self._serve)

    @contextmanager
    def client(self) -> Iterator[ManagementClient]:
        self._thread.start()
        with self._listening, ManagementClient(Address(*self._listening.getsockname()), PATIENCE) as client:
            yield client
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()

    def _serve(self) -> None:
        sock, _ = self._listening.accept()
        reader = MessageReader(REQUESTS)
        waiting: list[Request] = []
        with sock, suppress(ConnectionResetError, BrokenPipeError):
            while data := sock.recv(65536):
                for _, text in reader.feed(data):
                    request = parse_request(str(text))
                    if request.subject == Window():
                        unknown = Response(request.id, "INVALID_OBJECT")
                        known = Response(request.id, window=self._window)
                        send(sock, [unknown if self._window is None else known])
                    else:
                        self.requests.append(request)
                        waiting.append(request)
                self.most = max(self.most, len(waiting))
                if len(waiting) >= self._held or len(self.requests) == self._expected:
                    send(sock, [Response(request.id) for request in waiting])
                    waiting.clear()


def send(sock: socket.socket, responses: list[Response]) -> None:
    sock.sendall(b"".join(RESPONSES.encode([response.xml()]) for response in responses))


def steps(count: int) -> list[Step]:
    return [("R", "CREATE", ManagedBlock(f"B{number}", "E_CTU")) for number in range(count)]


@pytest.mark.parametrize(("window", "held"), [(None, 1), (0, 1), (1, 1), (4, 4), (1000, WINDOW)])
def test_as_many_requests_are_under_way_as_the_device_takes(window: int | None, held: int) -> None:
    device = Device(window, held, 100)
    with device.client() as client:
        responses = list(client.demand_all(steps(100)))
    numbers = [request.id for request in device.requests]
    assert [response.id for response in responses] == numbers
    assert device.most == held
    assert [request.after for request in device.requests] == ["", *(numbers[:-1] if held > 1 else [""] * 99)]


def test_a_single_request_does_not_ask_for_the_window() -> None:
    device = Device(None, 1, 1)
    with device.client() as client:
        assert len(client.request_all(steps(1))) == 1
    assert [request.id for request in device.requests] == ["1"]


def test_a_session_ends_when_not_all_responses_are_taken() -> None:
    device = Device(WINDOW, WINDOW, 100)
    with device.client() as client:
        assert next(client.demand_all(steps(100))).reason is None
        assert client.lost


def test_what_is_too_long_is_found_before_anything_is_sent() -> None:
    device = Device(WINDOW, WINDOW, 0)
    too_long: Step = ("R", "WRITE", ManagedConnection("'" + "x" * REQUEST_LIMIT + "'", "A.X"))
    with device.client() as client, pytest.raises(CommunicationError, match=f"expected at most {REQUEST_LIMIT}"):
        list(client.demand_all([*steps(100), too_long]))
    assert device.requests == []


@pytest.mark.parametrize("count", [0, 200])
def test_nothing_is_carried_out_after_a_refused_request(
    served: ServedDevice, caplog: pytest.LogCaptureFixture, count: int
) -> None:
    change: list[Step] = [
        ("", "CREATE", ManagedBlock("R", "EMB_RES")),
        *steps(count),
        ("R", "CREATE", ManagedBlock("WRONG", "NONE")),
        ("R", "CREATE", ManagedBlock("LATE", "E_CTU")),
        *[("R", "DELETE", step[2]) for step in steps(count)],
    ]
    responses: list[Response] = []
    with served.client() as client:
        said = r"refused CREATE block WRONG of type NONE: UNSUPPORTED_TYPE, .*NONE"
        with pytest.raises(ManagementError, match=said):
            responses.extend(client.demand_all(change))
        assert len(responses) == count + 1
        assert [block.name for block in client.blocks("R")] == ["START", *(f"B{n}" for n in range(count))]
        following = client.request_all([change[0], ("R", "CREATE", ManagedBlock("WRONG", "E_CTU"))])
        assert [response.reason for response in following] == ["INVALID_STATE", None]
    assert len([record for record in caplog.records if "NONE" in record.getMessage()]) == 1


def test_every_request_of_several_may_be_refused_alone(served: ServedDevice) -> None:
    with served.client() as client:
        client.create_block("", "R", "EMB_RES")
        kinds = ("E_CTU", "NONE", "E_CTU")
        made: list[Step] = [("R", "CREATE", ManagedBlock(f"B{n}", kind)) for n, kind in enumerate(kinds)]
        assert [response.reason for response in client.request_all(made)] == [None, "UNSUPPORTED_TYPE", None]
        assert client.read_all([("R", "B0.PV"), ("R", "B2.CV")]) == ["0", "0"]
        with pytest.raises(ManagementError, match=r"refused READ B1\.PV: NO_SUCH_OBJECT"):
            client.read_all([("R", "B0.PV"), ("R", "B1.PV")])


def create(number: int, after: str, name: str) -> bytes:
    return message(b"", Request(str(number), "CREATE", ManagedBlock(name, "EMB_RES"), after).xml().encode())


def answers(sock: socket.socket, count: int) -> list[Response]:
    reader = MessageReader(RESPONSES)
    found: list[Response] = []
    while len(found) < count:
        found += [parse_response(str(text)) for (text,) in reader.feed(sock.recv(65536))]
    return found


@pytest.mark.parametrize("size", [1, 7, 10_000])
def test_a_request_that_follows_needs_the_one_before_it(served: ServedDevice, size: int) -> None:
    stream = b"".join(
        [
            create(1, "", "A"),
            create(2, "1", "B"),
            create(3, "1", "OTHER_BEFORE"),
            create(4, "3", "REFUSED_BEFORE"),
            create(5, "", "C"),
            create(6, "5", "C"),
            create(7, "6", "REFUSED_BEFORE"),
        ]
    )
    with hostile(served.management.address, 2) as (sock, other):
        for begin in range(0, len(stream), size):
            sock.sendall(stream[begin : begin + size])
        found = answers(sock, 7)
        other.sendall(create(8, "5", "ANOTHER_SESSION"))
        found += answers(other, 1)
    assert [response.id for response in found] == [str(number) for number in range(1, 9)]
    late = "NOT_READY"
    assert [response.reason for response in found] == [None, None, late, late, None, "INVALID_STATE", late, late]
    with served.client() as client:
        assert [block.name for block in client.blocks("")] == ["A", "B", "C"]


def flood(sock: socket.socket, data: bytes) -> None:
    while True:
        sock.sendall(data)


def test_a_client_that_reads_no_responses_costs_bounded_memory(
    served: ServedDevice, caplog: pytest.LogCaptureFixture
) -> None:
    query = message(b"R", b'<Request ID="1" Action="QUERY"><FB Name="*" Type="*" /></Request>')
    with served.client() as client, hostile(served.management.address, 1) as (sock,):
        build(client, "R", "\n".join(f"{'B' * 200}{number} E_CTU" for number in range(200)))
        tracemalloc.start()
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            flood(sock, 1000 * query)
        assert len(client.blocks("R")) == 201
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 3 * UNSENT_LIMIT
    assert ["bytes unread; connection closed" in record.getMessage() for record in caplog.records] == [True]
