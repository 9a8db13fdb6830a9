"""A session with a device that has one client at a time, as a 4diac FORTE, and is not ready for this one at once."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

from iec61499.errors import CommunicationError
from iec61499.management import client as module
from iec61499.management.client import ManagementClient
from iec61499.management.protocol import REQUESTS, RESPONSES, ManagedBlock, Response, parse_request
from iec61499.net.address import LOOPBACK, Address
from iec61499.net.wire import MessageReader

PATIENCE = 30.0


def attend(listening: socket.socket, manners: Sequence[str], asked: list[str]) -> None:
    """Has one client after another: ends its session at once, loses its request, or answers until it goes."""
    for manner in manners:
        sock, _ = listening.accept()
        reader = MessageReader(REQUESTS)
        with sock:
            while manner != "ends" and (data := sock.recv(65536)):
                for _, text in reader.feed(data):
                    request = parse_request(str(text))
                    asked.append(manner)
                    if manner == "answers":
                        answer = Response(request.id, blocks=(ManagedBlock("R", "EMB_RES"),))
                        sock.sendall(RESPONSES.encode([answer.xml()]))


@contextmanager
def device(*manners: str) -> Iterator[tuple[Address, list[str]]]:
    """Address of a device that has clients in these manners, and in which it was asked."""
    asked: list[str] = []
    with socket.create_server((LOOPBACK, 0)) as listening:
        thread = threading.Thread(target=attend, args=(listening, manners, asked))
        thread.start()
        yield Address(*listening.getsockname()), asked
        thread.join(PATIENCE)
        assert not thread.is_alive()


@pytest.mark.parametrize("manners", [(), ("ends",), ("loses",), ("ends", "loses", "ends")])
def test_a_session_is_begun_again_until_the_device_answers(
    manners: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "ATTEMPT", 0.1)
    with (
        device(*manners, "answers") as (address, asked),
        ManagementClient(address, PATIENCE).attended() as client,
    ):
        assert client.blocks("") == (ManagedBlock("R", "EMB_RES"),)
    assert asked == [manner for manner in manners if manner == "loses"] + ["answers"] * 2


def test_a_device_that_never_answers_is_told() -> None:
    with device("loses") as (address, asked):
        client = ManagementClient(address, 0.1)
        with pytest.raises(CommunicationError, match=r"no answer within 0\.1 s"):
            client.attended()
        assert client.lost
    assert asked == ["loses"]
