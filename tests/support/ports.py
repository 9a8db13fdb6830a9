"""Ports of the loopback interface on which nobody listens."""

import socket

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
