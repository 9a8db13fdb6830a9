"""Whether others than the cell's user reach the ports of a device, which ask nobody for a certificate."""

from __future__ import annotations

import ipaddress
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

from iec61499.net.address import Address

_LISTENS: Final = "0A"
_TABLES: Final = (Path("/proc/net/tcp"), Path("/proc/net/tcp6"))
_ADVICE: Final = "whoever reaches them commands the arm; docs/zenoh.md says how to fence them"


def fence_warning(device: Address, secured: bool) -> str:
    """One line about open ports of a device, "" when there is nothing to warn of.

    No connection is made, since a FORTE refuses the next client for a while. So firewall rules that fence the ports
    are not noticed.

    Args:
        device: address of the device's management.
        secured: whether everybody else in the cell needs a certificate.
    """
    beyond = _beyond_loopback(device)
    if beyond:
        return f"the ports of {device} are open on {beyond}, not on loopback alone: {_ADVICE}"
    if secured:
        return f"the ports of {device} ask for no certificate, unlike the rest of this cell: {_ADVICE}"
    return ""


def _beyond_loopback(device: Address) -> str:
    """An address other than loopback at which the device's management listens, "" for none."""
    try:
        if not ipaddress.IPv4Address(device.host).is_loopback:
            return device.host
    except ValueError:
        return device.host  # a name, which stands for another machine
    return next((str(host) for host, port in _listening() if port == device.port and not host.is_loopback), "")


def _listening() -> Iterator[tuple[ipaddress.IPv4Address | ipaddress.IPv6Address, int]]:
    """Hosts and ports at which this machine listens for TCP (proc_pid_net(5)); none where no such table is."""
    for table in _TABLES:
        with suppress(OSError):
            for line in table.read_text().splitlines()[1:]:
                _, local, _, state, *_ = line.split()
                if state == _LISTENS:
                    digits, _, port = local.partition(":")
                    words = (int(digits[i : i + 8], 16) for i in range(0, len(digits), 8))
                    packed = b"".join(word.to_bytes(4, sys.byteorder) for word in words)
                    yield ipaddress.ip_address(packed), int(port, 16)
