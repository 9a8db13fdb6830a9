"""Tests of the ports of a cell."""

import socket

import pytest

from dtwin.services.service import held_port

LOOPBACK = "127.0.0.1"


def test_a_held_port_is_free_for_its_own_server_only_and_for_it_again_after_it_has_ended() -> None:
    with held_port() as port:
        for _ in range(2):
            with socket.socket() as another, pytest.raises(OSError, match="in use"):
                another.bind((LOOPBACK, port))
            with socket.socket() as server:
                server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                server.bind((LOOPBACK, port))
                server.listen()
                with socket.create_connection((LOOPBACK, port)):
                    server.accept()[0].close()


def test_a_port_is_free_once_it_is_held_no_more() -> None:
    with held_port() as port:
        pass
    with socket.socket() as another:
        another.bind((LOOPBACK, port))
