"""The management server beside hostile peers: it stays up, bounded and in order."""

from __future__ import annotations

import random
import socket
import tracemalloc
from contextlib import suppress

import pytest

from dtwin.controller.ports import EMULATOR
from iec61499.management.server import CLIENTS
from iec61499.net.address import StreamAddress
from iec61499.net.client import BlockingClient
from tests.support.iec61499.hostile import drain, hostile, message, mutants, send
from tests.support.iec61499.served_device import PATIENCE, ServedDevice, samples


@pytest.fixture
def management(stream_address: StreamAddress) -> StreamAddress:
    return stream_address


def test_fuzzed_management_does_no_harm(cell: ServedDevice) -> None:
    rng = random.Random(17)
    for data in mutants(rng, 300):
        with hostile(cell.management.address, 1) as (sock,):
            for begin in range(0, len(data), 50):
                send(sock, data[begin : begin + 50])
            with suppress(OSError):
                sock.shutdown(socket.SHUT_WR)
            drain(sock)
    with cell.client() as client:
        assert client.read("EMB_RES", "CELL.EMULATOR.STATUS") == "OK"


XML_BOMB = (
    b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + i, b"&%c;" % (97 + i) * 10) for i in range(20))
    + b']><Request ID="1" Action="START"><FB Name="&u;" Type=""/></Request>'
)


@pytest.mark.parametrize(
    "request_",
    [
        XML_BOMB,
        b'<!DOCTYPE r [<!ENTITY a SYSTEM "file:///etc/passwd">]><Request ID="1" Action="START">&a;</Request>',
        b"<a>" * 20_000,
        b'<Request ID="1" Action="START">' + b"\xff\xfe\x00" * 100,
        b"",
    ],
)
def test_hostile_xml_is_refused(served: ServedDevice, request_: bytes, caplog: pytest.LogCaptureFixture) -> None:
    with hostile(served.management.address, 1) as (sock,):
        send(sock, message(b"", request_))
        answer = sock.recv(1000)
    assert b'Reason="INVALID_OBJECT"' in answer
    assert len(caplog.records) == 1
    with served.client() as client:
        assert client.blocks("") == ()


def test_a_hundred_silent_clients_on_every_port_keep_nobody_out(
    cell: ServedDevice, caplog: pytest.LogCaptureFixture
) -> None:
    emulator = cell.device.addresses()["CELL.EMULATOR"]
    with hostile(cell.management.address, 100) as managers, hostile(emulator, 100) as clients:
        for sock in managers[:50] + clients[:50]:
            send(sock, b"\x50")
        with cell.client() as client, BlockingClient(emulator, EMULATOR.receives, EMULATOR.sends, PATIENCE) as peer:
            for sample in samples(50):
                assert len(peer.exchange(sample)) == 5
            assert client.read("EMB_RES", "CELL.EMULATOR.STATUS") == "OK"
        for sock in clients:
            drain(sock)
        for sock in managers[: 100 - CLIENTS]:
            drain(sock)
    # a wrong first byte, or silence while too many wait: one line each
    assert len(caplog.records) <= 100 + 101 - CLIENTS
    assert len({record.getMessage() for record in caplog.records}) == len(caplog.records)


def test_memory_stays_bounded_under_unfinished_requests(served: ServedDevice) -> None:
    unfinished = message(b"", b"x" * 65000)[:-1]
    with served.client() as client:
        client.blocks("")
        tracemalloc.start()
        for _ in range(3):
            with hostile(served.management.address, 2 * CLIENTS) as sockets:
                for sock in sockets:
                    send(sock, unfinished)
                assert client.blocks("") == ()
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert peak < 4 * CLIENTS * len(unfinished)


def test_requests_may_come_split_and_joined(served: ServedDevice) -> None:
    create = message(b"", b'<Request ID="1" Action="CREATE"><FB Name="R" Type="EMB_RES" /></Request>')
    query = message(b"", b'<Request ID="2" Action="QUERY"><FB Name="*" Type="*" /></Request>')
    with hostile(served.management.address, 1) as (sock,):
        stream = create + query
        for begin in range(0, len(stream), 7):
            send(sock, stream[begin : begin + 7])
        answers = b""
        while b"FBList>" not in answers[-20:] and b'name="R"' not in answers:
            answers += sock.recv(1000)
    assert answers.startswith(b'\x50\x00\x13<Response ID="1" />')
