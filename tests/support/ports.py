"""Ports of the loopback interface on which nobody listens, and those where a process does."""

import os
import random
import socket
from contextlib import suppress
from pathlib import Path
from typing import Final

from iec61499.net.address import LOOPBACK

_FIRST: Final = 10_000
_BELOW: Final = 20_000
"""From here on cells look for ports of their own."""
_WORKERS: Final = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_WORKER: Final = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_given: set[int] = set()


def free_ports(count: int) -> list[int]:
    """Several free ports, each of which is given once.

    Every worker has a range of its own, below those of cells and of clients: nobody else takes one before its server
    listens.
    """
    share = (_BELOW - _FIRST) // _WORKERS
    mine = range(_FIRST + _WORKER * share, _FIRST + (_WORKER + 1) * share)
    found = []
    for port in random.SystemRandom().sample(mine, share):
        with socket.socket() as probe, suppress(OSError):  # somebody has it
            probe.bind((LOOPBACK, port))
            if port not in _given:
                found.append(port)
        if len(found) == count:
            _given.update(found)
            return found
    raise AssertionError(f"fewer than {count} free ports from {mine[0]} to {mine[-1]}")


def free_port() -> int:
    (port,) = free_ports(1)
    return port


def listening(pid: int) -> list[str]:
    """Where a process listens: `unix:PATH` and `tcp:PORT` (proc_pid_net(5))."""
    targets = []
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            targets.append(os.readlink(descriptor))
        except OSError:
            continue  # closed meanwhile
    found = []
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A" and f"socket:[{fields[9]}]" in targets:
                found.append(f"tcp:{int(fields[1].rpartition(':')[2], 16)}")
    for line in Path(f"/proc/{pid}/net/unix").read_text().splitlines()[1:]:
        # 8 fields at most, the last one the path; the flag 0x10000 marks a socket that listens
        fields = line.split(maxsplit=7)
        if int(fields[3], 16) & 0x10000 and f"socket:[{fields[6]}]" in targets:
            found.append(f"unix:{fields[7]}")
    return sorted(found)
