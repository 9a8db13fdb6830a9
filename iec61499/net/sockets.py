"""Makes stream sockets: of TCP, and Unix domain sockets in folders that only their user may enter.

A Unix domain socket is for the processes of one user on one machine: nobody else may enter its folder, and the socket
has mode 0600 besides. A socket that a killed process has left behind is replaced when somebody listens there again.
"""

from __future__ import annotations

import errno
import fcntl
import itertools
import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Self

from iec61499.errors import CommunicationError
from iec61499.net.address import Address, LocalAddress, StreamAddress

BACKLOG: Final = 128
"""Connections the kernel holds until they are accepted."""


class Closing:
    """What holds connections: a context manager that closes them at its end."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Closes them."""
        raise NotImplementedError


def tune(sock: socket.socket) -> None:
    """Makes TCP send small messages at once, and find out within half a minute that a peer's machine is gone."""
    if sock.family is not socket.AF_INET:
        return
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (("TCP_KEEPIDLE", 10), ("TCP_KEEPINTVL", 5), ("TCP_KEEPCNT", 3)):
        if hasattr(socket, option):
            sock.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)


def connected_socket(address: StreamAddress, timeout: float) -> socket.socket:
    """A socket that is connected to an address within `timeout` s, which is its timeout from then on, too.

    Raises:
        CommunicationError: nobody answers at the address.
    """
    try:
        if isinstance(address, Address):
            sock = socket.create_connection(address, timeout)
        else:
            sock = _connected_locally(address, timeout)
    except OSError as error:
        raise CommunicationError(f"{address}: cannot connect: {error.strerror or error}") from None
    tune(sock)
    return sock


class ListeningSocket:
    """A socket that listens and never waits.

    Attributes:
        sock: the socket itself.
        address: where it listens, with the port that the system chose when TCP port 0 was asked for.

    Raises:
        CommunicationError: somebody listens there already, or the folder is open to other users or missing.
    """

    def __init__(self, address: StreamAddress) -> None:
        try:
            if isinstance(address, Address):
                self.sock = _listening(address)
                self.address: StreamAddress = Address(*self.sock.getsockname())
            else:
                self.sock, self._identity = _listening_locally(address)
                self.address = address
        except OSError as error:
            raise CommunicationError(f"cannot listen on {address}: {error.strerror or error}") from None
        self.sock.setblocking(False)
        self._numbers = itertools.count(1)

    def accept(self) -> tuple[socket.socket, str]:
        """The socket of the next connection, and its peer's name in the log. Raises OSError when there is none."""
        sock, peer = self.sock.accept()
        if isinstance(self.address, Address):
            host, port = peer
            return sock, f"{host}:{port} at port {self.address.port}"
        return sock, f"client {next(self._numbers)} at {self.address}"

    def close(self) -> None:
        """Ends listening; the file of a Unix domain socket goes, unless it is another one's meanwhile."""
        if isinstance(self.address, LocalAddress):
            with suppress(OSError, CommunicationError), _reserved(self.address.folder):
                if _identity(self.address.path) == self._identity:
                    self.address.path.unlink()
        self.sock.close()


def _listening(address: Address) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind(address)
        sock.listen(BACKLOG)
    except OSError:
        sock.close()
        raise
    return sock


def _listening_locally(address: LocalAddress) -> tuple[socket.socket, tuple[int, int]]:
    """A listening socket and the identity of its file."""
    address.check()
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        with _reserved(address.folder):
            if _is_left_behind(address.path):
                address.path.unlink()
            sock.bind(str(address.path))
            address.path.chmod(0o600)
            sock.listen(BACKLOG)
            return sock, _identity(address.path)
    except (OSError, CommunicationError):
        sock.close()
        raise


def _connected_locally(address: LocalAddress, timeout: float) -> socket.socket:
    address.check()
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        sock.settimeout(timeout)
        sock.connect(str(address.path))
    except OSError:
        sock.close()
        raise
    return sock


@contextmanager
def _reserved(folder: Path) -> Iterator[None]:
    """Lets nobody else begin or end to listen in a folder meanwhile.

    Raises:
        CommunicationError: other users may enter the folder.
        OSError: there is no such folder.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        state = os.fstat(descriptor)
        if state.st_uid != os.getuid() or state.st_mode & 0o077:
            mode = stat.S_IMODE(state.st_mode)
            raise CommunicationError(
                f"{folder}: mode {mode:04o} of user {state.st_uid}, expected a folder of mode "
                f"0700 of user {os.getuid()} for sockets"
            )
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _is_left_behind(path: Path) -> bool:
    """Whether a file is a socket at which nobody listens any more."""
    try:
        if not stat.S_ISSOCK(path.lstat().st_mode):
            return False
    except FileNotFoundError:
        return False
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        # where somebody listens whose queue is full, a blocking socket would wait
        probe.setblocking(False)
        return probe.connect_ex(str(path)) == errno.ECONNREFUSED


def _identity(path: Path) -> tuple[int, int]:
    state = path.lstat()
    return state.st_dev, state.st_ino
