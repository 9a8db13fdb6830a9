"""Ports of the loopback interface on which nobody listens, and those where a process does."""

import os
import socket
from pathlib import Path

from dtwin.iec61499.net.address import LOOPBACK


def free_ports(count: int) -> list[int]:
    """Several free ports; all probes are open at once, so that the ports differ."""
    probes = [socket.socket() for _ in range(count)]
    try:
        for probe in probes:
            probe.bind((LOOPBACK, 0))
        return [probe.getsockname()[1] for probe in probes]
    finally:
        for probe in probes:
            probe.close()


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
