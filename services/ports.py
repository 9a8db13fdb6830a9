"""TCP ports of the loopback interface, for servers that others are told of before they listen."""

from __future__ import annotations

import random
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

from dtwin.errors import CommunicationError

_PORTS: Final = range(20_000, 32_000)
"""Below those that systems give to outgoing connections, one of which might take a port before it is used."""
_TRIES: Final = 100


def free_port() -> int:
    """A TCP port of the loopback interface that nobody has now.

    Raises:
        CommunicationError: there is none.
    """
    with _bound() as probe:
        return _number(probe)


@contextmanager
def held_port() -> Iterator[int]:
    """A TCP port of the loopback interface that stays this process's own until the end.

    Only a server that binds it with SO_REUSEADDR can listen at it meanwhile (socket(7)): nobody who looks for a free
    port finds it, neither before that server listens nor while it is started again.

    Raises:
        CommunicationError: there is none.
    """
    with _bound() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        yield _number(holder)


def _bound() -> socket.socket:
    for port in random.SystemRandom().sample(_PORTS, _TRIES):
        probe = socket.socket()
        with suppress(OSError):  # somebody has it
            probe.bind(("127.0.0.1", port))
            return probe
        probe.close()
    raise CommunicationError(f"no free TCP port among {_TRIES} from {_PORTS[0]} to {_PORTS[-1]}")


def _number(bound: socket.socket) -> int:
    number: int = bound.getsockname()[1]
    return number
