"""Addresses of communication blocks and devices: `HOST:PORT`, or `unix:FOLDER/PORT` on this machine."""

from __future__ import annotations

import ipaddress
import os
import re
from pathlib import Path
from typing import Final, NamedTuple

from iec61499.errors import CommunicationError

LOOPBACK: Final = "127.0.0.1"
LOCAL: Final = "unix:"
LONGEST_PATH: Final = 107
"""Most bytes of the path of a Unix domain socket (unix(7))."""
_LAYERED: Final = re.compile(r"fbdk\[\]\.ip\[([^\[\]]*)\]")


class Address(NamedTuple):
    """An IPv4 host and a port; port 0 lets the system choose when listening."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


class LocalAddress(NamedTuple):
    """A port of a device as a Unix domain socket: the file in a folder that the port's number names.

    Only processes of the folder's user reach it, where a TCP port of the loopback interface is open to every user.
    """

    folder: Path
    port: int

    @property
    def path(self) -> Path:
        """The file of the socket."""
        return self.folder / str(self.port)

    def check(self) -> None:
        """Raises CommunicationError when the path is longer than that of a socket can be."""
        size = len(os.fsencode(self.path))
        if size > LONGEST_PATH:
            raise CommunicationError(f"{self}: path of {size} bytes, expected at most {LONGEST_PATH} for a socket")

    def __str__(self) -> str:
        return f"{LOCAL}{self.path}"


StreamAddress = Address | LocalAddress
"""Where a device or a SERVER block listens."""


def parse_address(text: str, scheme: str = "") -> Address:
    """Reads `HOST:PORT`, `:PORT` (loopback) or, with a scheme, `SCHEME://HOST:PORT`.

    Raises:
        CommunicationError: the text has another form, or the port is out of range.
    """
    expected = f"{scheme}://HOST:PORT" if scheme else "HOST:PORT"
    prefix = f"{scheme}://" if scheme else ""
    host, colon, port = text.removeprefix(prefix).rpartition(":")
    valid = text.startswith(prefix) and colon and "/" not in host and re.fullmatch("[0-9]{1,5}", port)
    if not valid or int(port) > 65535:
        raise CommunicationError(f"address {text!r}: expected {expected} with a port from 0 to 65535")
    return Address(LOOPBACK if host in ("", "localhost") else host, int(port))


def parse_numeric_address(text: str) -> Address:
    """Reads `HOST:PORT` with an IPv4 host in figures, or `localhost`.

    Raises:
        CommunicationError: the text has another form.
    """
    address = parse_address(text)
    try:
        ipaddress.IPv4Address(address.host)
    except ValueError:
        raise CommunicationError(f"address {text!r}: expected localhost or a numeric IPv4 host") from None
    return address


def parse_stream_address(text: str) -> StreamAddress:
    """Reads `HOST:PORT` or `unix:FOLDER/PORT`.

    Raises:
        CommunicationError: the text has another form.
    """
    return _parse_local(text) if text.startswith(LOCAL) else parse_address(text)


def parse_listening_address(text: str) -> StreamAddress:
    """Reads `HOST:PORT` with an IPv4 host in figures, or `localhost`; or `unix:FOLDER/PORT`.

    Raises:
        CommunicationError: the text has another form.
    """
    return _parse_local(text) if text.startswith(LOCAL) else parse_numeric_address(text)


def _parse_local(text: str) -> LocalAddress:
    folder, slash, port = text.removeprefix(LOCAL).rpartition("/")
    if not slash or not re.fullmatch("[0-9]{1,5}", port) or int(port) > 65535:
        raise CommunicationError(f"address {text!r}: expected {LOCAL}FOLDER/PORT with a port from 0 to 65535")
    return LocalAddress(Path(folder or "/"), int(port))


def parse_block_id(text: str) -> Address:
    """Reads the ID input of a communication block: `HOST:PORT`, or the same as `fbdk[].ip[HOST:PORT]`.

    Names are not looked up, as in 4diac FORTE: that would stop the event loop.

    Raises:
        CommunicationError: the text has another form.
    """
    layered = _LAYERED.fullmatch(text)
    return parse_numeric_address(layered[1] if layered else text)
