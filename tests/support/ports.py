"""Ports of the loopback interface on which nobody listens, and those where a process does."""

import os
import secrets
import socket
from contextlib import suppress
from pathlib import Path
from typing import Final

from dtwin.iec61499.net.address import LOOPBACK

_FOR_CLIENTS: Final = Path("/proc/sys/net/ipv4/ip_local_port_range")
_FIRST: Final = 10_000


def free_ports(count: int) -> list[int]:
    """Several free ports, which differ because all probes are open at once.

    They lie below those that the system gives to clients: one of these could be taken before its server listens.
    """
    probes: list[socket.socket] = []
    try:
        while len(probes) < count:
            probes.append(socket.socket())
            with suppress(OSError):  # somebody has it
                probes[-1].bind((LOOPBACK, _candidate()))
                continue
            probes.pop().close()
        return [probe.getsockname()[1] for probe in probes]
    finally:
        for probe in probes:
            probe.close()


def _candidate() -> int:
    """Any port from 10000 on that is not for clients; 0 for one that the system gives."""
    below = int(_FOR_CLIENTS.read_text().split()[0]) - _FIRST if _FOR_CLIENTS.exists() else 0
    return _FIRST + secrets.randbelow(below) if below > 0 else 0


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
