"""Peers that mean no good, and requests that are none."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from iec61499.management.protocol import REQUESTS
from iec61499.net.address import StreamAddress
from iec61499.net.sockets import connected_socket
from tests.support.iec61499.served_device import BOOT, PATIENCE


@contextmanager
def hostile(address: StreamAddress, count: int) -> Iterator[list[socket.socket]]:
    """Connections that are closed in the end; writing to one that the device has dropped is no error."""
    sockets = [connected_socket(address, PATIENCE) for _ in range(count)]
    try:
        yield sockets
    finally:
        for sock in sockets:
            sock.close()


def drain(sock: socket.socket) -> None:
    """Reads until the peer closes."""
    sock.settimeout(PATIENCE)
    with suppress(ConnectionResetError):
        while sock.recv(65536):
            pass


def send(sock: socket.socket, data: bytes) -> None:
    with suppress(ConnectionResetError, BrokenPipeError):
        sock.sendall(data)


def message(resource: bytes, request: bytes) -> bytes:
    return REQUESTS.encode([resource.decode("latin-1"), request.decode("latin-1")])


def mutants(rng: random.Random, count: int) -> Iterator[bytes]:
    """Valid requests with bytes changed, cut out, doubled or put in, and plain noise."""
    lines = [line.partition(";") for line in BOOT.splitlines()]
    valid = [message(resource.encode(), request.encode()) for resource, _, request in lines]
    for _ in range(count):
        data = bytearray(rng.choice(valid))
        for _ in range(rng.randrange(1, 6)):
            at = rng.randrange(len(data) + 1)
            piece = rng.randbytes(rng.randrange(0, 4))
            data[at : at + rng.randrange(0, 8)] = piece
        yield rng.choice([bytes(data), rng.randbytes(rng.randrange(1, 100))])
