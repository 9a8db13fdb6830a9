"""Unix domain sockets in a folder for one user: what they are called, who may listen, and what is left behind."""

from __future__ import annotations

import os
import socket
import stat
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from dtwin.errors import CommunicationError
from iec61499.net.address import (
    LONGEST_PATH,
    LocalAddress,
    parse_block_id,
    parse_listening_address,
    parse_stream_address,
)
from iec61499.net.sockets import ListeningSocket, connected_socket

PATIENCE = 10.0


@pytest.fixture
def address() -> Iterator[LocalAddress]:
    with TemporaryDirectory() as folder:
        yield LocalAddress(Path(folder), 61500)


def leave_behind(address: LocalAddress) -> None:
    """A socket file as a killed process leaves it."""
    with socket.socket(socket.AF_UNIX) as sock:
        sock.bind(str(address.path))
        sock.listen()


def accepts(listening: ListeningSocket) -> bool:
    """Whether a connection to the address reaches this socket."""
    with connected_socket(listening.address, PATIENCE):
        try:
            listening.accept()[0].close()
        except BlockingIOError:
            return False
        return True


def test_an_address_is_read_as_it_is_written(address: LocalAddress) -> None:
    assert parse_stream_address(str(address)) == parse_listening_address(str(address)) == address
    assert str(address) == f"unix:{address.folder}/61500"
    assert parse_stream_address("localhost:1") == parse_listening_address("localhost:1") == ("127.0.0.1", 1)


@pytest.mark.parametrize("text", ["unix:", "unix:61500", "unix:/run/cell", "unix:/run/70000", "unix:/run/-1"])
def test_a_bad_address_is_refused(text: str) -> None:
    for parse in (parse_stream_address, parse_listening_address):
        with pytest.raises(CommunicationError, match="expected unix:FOLDER/PORT with a port from 0 to 65535"):
            parse(text)


def test_a_block_cannot_choose_its_own_folder() -> None:
    with pytest.raises(CommunicationError, match="expected"):
        parse_block_id("unix:/tmp/61500")


def test_only_the_user_may_connect(address: LocalAddress) -> None:
    before = os.umask(0)
    try:
        listening = ListeningSocket(address)
    finally:
        os.umask(before)
    state = address.path.stat()
    assert stat.S_ISSOCK(state.st_mode)
    assert stat.S_IMODE(state.st_mode) == 0o600
    assert accepts(listening)
    listening.close()
    assert list(address.folder.iterdir()) == []


@pytest.mark.parametrize("mode", [0o755, 0o710, 0o701, 0o777])
def test_a_folder_open_to_other_users_is_refused(address: LocalAddress, mode: int) -> None:
    address.folder.chmod(mode)
    with pytest.raises(CommunicationError, match=f"mode {mode:04o} of user .*, expected a folder of mode 0700"):
        ListeningSocket(address)
    assert list(address.folder.iterdir()) == []


@pytest.mark.skipif(os.getuid() != 0, reason="needs root to give a folder to another user")
def test_a_folder_of_another_user_is_refused(address: LocalAddress) -> None:
    os.chown(address.folder, 65534, 65534)
    with pytest.raises(CommunicationError, match="of user 65534, expected a folder of mode 0700 of user 0"):
        ListeningSocket(address)


def test_a_missing_folder_is_named(address: LocalAddress) -> None:
    missing = LocalAddress(address.folder / "missing", 1)
    with pytest.raises(CommunicationError, match=f"cannot listen on {missing}: No such file or directory"):
        ListeningSocket(missing)
    with pytest.raises(CommunicationError, match=f"{missing}: cannot connect: No such file or directory"):
        connected_socket(missing, PATIENCE)


def test_a_path_is_as_long_as_a_socket_can_have(address: LocalAddress) -> None:
    name = "x" * (LONGEST_PATH - len(os.fsencode(address.folder)) - len("//61500"))
    longest = LocalAddress(address.folder / name, 61500)
    longest.folder.mkdir(mode=0o700)
    listening = ListeningSocket(longest)
    assert accepts(listening)
    listening.close()
    longer = LocalAddress(address.folder / f"{name}y", 61500)
    longer.folder.mkdir(mode=0o700)
    for use in (lambda: ListeningSocket(longer), lambda: connected_socket(longer, PATIENCE)):
        with pytest.raises(CommunicationError, match="path of 108 bytes, expected at most 107 for a socket"):
            use()


def test_a_socket_left_behind_is_replaced(address: LocalAddress) -> None:
    leave_behind(address)
    with pytest.raises(CommunicationError, match="cannot connect: Connection refused"):
        connected_socket(address, PATIENCE)
    listening = ListeningSocket(address)
    assert accepts(listening)
    listening.close()


def test_a_socket_in_use_is_not_replaced(address: LocalAddress) -> None:
    listening = ListeningSocket(address)
    for _ in range(2):
        with pytest.raises(CommunicationError, match=f"cannot listen on {address}: Address already in use"):
            ListeningSocket(address)
    while True:  # those who have asked
        try:
            listening.accept()[0].close()
        except BlockingIOError:
            break
    assert accepts(listening)
    listening.close()


def test_a_file_that_is_no_socket_is_not_replaced(address: LocalAddress) -> None:
    address.path.write_text("kept")
    with pytest.raises(CommunicationError, match="Address already in use"):
        ListeningSocket(address)
    assert address.path.read_text() == "kept"


def test_closing_leaves_the_socket_of_another(address: LocalAddress) -> None:
    """As when the folder was cleared for a new run while the controller of the last one was still ending."""
    old = ListeningSocket(address)
    address.path.unlink()
    new = ListeningSocket(address)
    old.close()
    assert accepts(new)
    new.close()
