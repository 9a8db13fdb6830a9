"""Runs the web server of a console on a thread of its own."""

from __future__ import annotations

import asyncio
import ipaddress
import logging
import socket
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import uvicorn

from dtwin.console.console import Console
from dtwin.console.web.replies import LARGEST
from dtwin.console.web.server import Place, Server
from dtwin.errors import CommunicationError, ParameterError

log = logging.getLogger(__name__)

LOOPBACK: Final = "127.0.0.1"
STARTING: Final = 10.0
"""Longest time that the server may take to listen, s."""
BACKLOG: Final = 100
"""Number of connections that may wait to be accepted."""
_LAST_PORT: Final = 65535
_LOOK: Final = 0.02
"""Time between two looks at a server that starts, s."""


@dataclass(frozen=True, kw_only=True)
class Listening:
    """Where a console listens, and how it proves what it is.

    Attributes:
        host: address of the interface, or its name.
        port: TCP port; 0 for a free one.
        certificate: file of the TLS certificate, PEM.
        key: file of its private key, PEM.
        viewer: address of the 3D viewer, "" for none.
    """

    host: str = LOOPBACK
    port: int = 0
    certificate: Path | None = None
    key: Path | None = None
    viewer: str = ""

    @property
    def secure(self) -> bool:
        """Whether the console speaks TLS."""
        return self.certificate is not None

    def check(self, login: bool) -> None:
        """Checks that nobody can be overheard, and that nobody commands without a name, except on loopback.

        Raises:
            ParameterError: the console would listen beyond loopback without TLS or without users.
        """
        if (self.certificate is None) != (self.key is None):
            raise ParameterError("--certificate and --key: expected both or none")
        for path in (self.certificate, self.key):
            if path is not None and not path.is_file():
                raise ParameterError(f"{path}: no such file")
        if not 0 <= self.port <= _LAST_PORT:
            raise ParameterError(f"--port {self.port}: expected 0 to {_LAST_PORT}")
        if is_loopback(self.host):
            return
        if not self.secure:
            raise ParameterError(f"--listen {self.host}: beyond loopback expected TLS: --certificate and --key")
        if not login:
            raise ParameterError(f"--listen {self.host}: beyond loopback expected users who log in: --users FILE")

    def bind(self) -> Bound:
        """Takes the port, at which connections wait from now on until a server accepts them.

        Raises:
            CommunicationError: the port cannot be had.
        """
        sock = socket.socket(socket.AF_INET6 if ":" in self.host else socket.AF_INET)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            sock.bind((self.host, self.port))
            sock.listen(BACKLOG)
        except OSError as error:
            sock.close()
            what = f"--port {self.port}: the console cannot listen at {self.host}"
            raise CommunicationError(f"{what}: {error.strerror}") from None
        return Bound(self, sock)


@dataclass(frozen=True)
class Bound:
    """A port that nobody else can have: where a console listens, and the socket there."""

    listening: Listening
    sock: socket.socket


def is_loopback(host: str) -> bool:
    """Whether an address is one that only this machine reaches."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


class _Server(uvicorn.Server):
    """Sleeps until it shall end, instead of looking whether it shall ten times a second."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self._ended = asyncio.Event()
        self._loop: asyncio.AbstractEventLoop | None = None

    async def main_loop(self) -> None:
        """Waits for the end; `end` finds either the loop, or it is found here that it was called before."""
        self._loop = asyncio.get_running_loop()
        if not self.should_exit:
            await self._ended.wait()

    def end(self) -> None:
        """Ends the server, from any thread."""
        self.should_exit = True
        if self._loop is not None:
            with suppress(RuntimeError):  # it has ended already
                self._loop.call_soon_threadsafe(self._ended.set)


class Web:
    """A server that has begun to listen when it is made.

    Args:
        console: console that is served.
        bound: where it listens; the server closes the socket.

    Attributes:
        address: address to open in a browser.

    Raises:
        CommunicationError: the certificate cannot be used.
    """

    def __init__(self, console: Console, bound: Bound) -> None:
        listening, sock = bound.listening, bound.sock
        port = sock.getsockname()[1]
        shown = f"[{listening.host}]" if ":" in listening.host else listening.host
        self.address = f"{'https' if listening.secure else 'http'}://{shown}:{port}/"
        names = frozenset(f"{name}:{port}" for name in (LOOPBACK, "localhost", "[::1]"))
        place = Place(names if is_loopback(listening.host) else frozenset(), listening.secure, listening.viewer)
        self._server = Server(console, place)
        config = uvicorn.Config(
            self._server.app(),
            log_level="warning",
            access_log=False,
            server_header=False,
            date_header=False,
            ws="websockets-sansio",
            ws_max_size=LARGEST,
            proxy_headers=False,
            timeout_graceful_shutdown=2,
            ssl_certfile=listening.certificate,
            ssl_keyfile=listening.key,
        )
        try:
            config.load()
        except OSError as error:
            sock.close()
            raise CommunicationError(f"{listening.certificate}: no certificate with its key: {error}") from None
        self._uvicorn = _Server(config)
        self._thread = threading.Thread(target=self._uvicorn.run, args=([sock],), name="web", daemon=True)
        self._thread.start()
        deadline = time.monotonic() + STARTING
        while not self._uvicorn.started:
            if not self._thread.is_alive() or time.monotonic() > deadline:
                raise CommunicationError(f"the console does not listen at {self.address}")
            time.sleep(_LOOK)

    def close(self) -> None:
        """Ends the connections and the server."""
        self._server.close()
        self._uvicorn.end()
        self._thread.join()
