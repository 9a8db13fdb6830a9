"""Warnings of open ports: what is told of devices here, with this machine's own sockets, and elsewhere."""

import socket
from contextlib import closing

import pytest

from dtwin.services.parts.fence import fence_warning
from iec61499.net.address import LOOPBACK, Address


def listening(host: str) -> tuple[socket.socket, Address]:
    """A socket that listens at a free port, and its address on the loopback interface."""
    sock = socket.create_server((host, 0))
    return sock, Address(LOOPBACK, sock.getsockname()[1])


@pytest.mark.parametrize("host", [LOOPBACK, "127.0.0.2"])
def test_a_device_on_loopback_is_told_of_in_a_secured_cell_alone(host: str) -> None:
    sock, address = listening(host)
    with closing(sock):
        assert fence_warning(address, secured=False) == ""
        said = fence_warning(address, secured=True)
    assert said.startswith(f"the ports of {address} ask for no certificate")
    assert "docs/zenoh.md" in said
    assert "\n" not in said


@pytest.mark.parametrize("secured", [False, True])
def test_a_device_on_all_interfaces_is_told_of_in_every_cell(secured: bool) -> None:
    sock, address = listening("0.0.0.0")
    with closing(sock):
        said = fence_warning(address, secured)
    assert said.startswith(f"the ports of {address} are open on 0.0.0.0, not on loopback alone")
    assert fence_warning(address, secured=False) == "", "it listens no more"


def test_a_device_on_all_interfaces_of_ipv6_is_told_of() -> None:
    if not socket.has_dualstack_ipv6():
        pytest.skip("this machine has no IPv6")
    sock = socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True)
    with closing(sock):
        assert "are open on ::," in fence_warning(Address(LOOPBACK, sock.getsockname()[1]), secured=False)


@pytest.mark.parametrize("host", ["192.0.2.7", "plant"])
def test_a_device_of_another_machine_is_told_of(host: str) -> None:
    assert f"are open on {host}, not on loopback alone" in fence_warning(Address(host, 61499), secured=False)
