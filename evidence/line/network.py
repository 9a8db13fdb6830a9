"""A network for the processes of a line on this machine: a Zenoh router, and links to it that can be cut."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from dtwin.bus.line.messages import LineState
from dtwin.bus.line.topics import LINE_STATE
from dtwin.bus.session import Bus
from dtwin.bus.signature import KEY
from dtwin.errors import CommunicationError
from dtwin.parameters import ROOT
from dtwin.services.runfile import join_line
from dtwin.services.service import free_port

PORT: Final = "7447"
"""Port of the router in config/routed."""
_START: Final = 120.0
"""Longest time in which all is ready, s."""
_CHUNK: Final = 1 << 16


class Relay:
    """A link to a port of this machine that can be cut, as when somebody pulls a cable.

    Args:
        target: the port to which it leads.

    Attributes:
        port: port at which it begins.
    """

    def __init__(self, target: int) -> None:
        self._target = target
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._server.getsockname()[1]
        self._whole = threading.Event()
        self._whole.set()
        self._open: set[socket.socket] = set()
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Nothing passes any more."""
        self._whole.clear()
        for end in list(self._open):
            self._end(end)

    def mend(self) -> None:
        """New connections pass again."""
        self._whole.set()

    def close(self) -> None:
        """Ends it for good."""
        self.cut()
        self._server.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._server.accept()
                if not self._whole.is_set():
                    near.close()
                    continue
                try:
                    far = socket.create_connection(("127.0.0.1", self._target))
                except OSError:
                    near.close()
                    continue
                self._open |= {near, far}
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._pass, args=pair, daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while chunk := source.recv(_CHUNK):
                sink.sendall(chunk)
        self._end(source)
        self._end(sink)

    def _end(self, end: socket.socket) -> None:
        self._open.discard(end)
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()


@dataclass(frozen=True)
class Host:
    """Processes of a line that reach the others over one link.

    Attributes:
        link: the link.
        up: the process of `dtwin line up`, whose children they are.
    """

    link: Relay
    up: subprocess.Popen[bytes]


@contextmanager
def router(folder: Path) -> Iterator[int]:
    """A router with its configuration in a folder; its port."""
    port = free_port()
    _configure(folder, "router", port)
    command = [sys.executable, "-m", "dtwin.services.router", "--zenoh", str(folder)]
    with _process(command, {}):
        yield port


@contextmanager
def host(name: str, line: str, port: int, key: bytes, folder: Path, words: list[str]) -> Iterator[Host]:
    """Processes of a line on a host of their own.

    Args:
        name: name of the line.
        line: its file, or its name in the folder lines.
        port: port of the router.
        key: key of the line.
        folder: folder for what they keep: each host has a user's runtime folder of its own there.
        words: further options of `dtwin line up`.
    """
    link = Relay(port)
    _configure(folder, "service", link.port)
    command = [sys.executable, "-m", "dtwin", "line", "up", line, "--name", name, "--zenoh", str(folder)]
    command += ["--history", str(folder / "history.jsonl"), "--json", *words]
    with ExitStack() as stack:
        stack.callback(link.close)
        up = stack.enter_context(_process(command, {KEY: key.hex(), "XDG_RUNTIME_DIR": str(folder)}))
        yield Host(link, up)


def joined(name: str, folder: Path, key: bytes) -> Bus:
    """The bus of a line that is up, as a configuration file of a folder says, when the line answers.

    Raises:
        CommunicationError: it does not answer in time.
    """
    os.environ[KEY] = key.hex()
    bus = join_line(name, folder)
    until = time.monotonic() + _START
    while True:
        try:
            bus.ask(LINE_STATE, None, LineState)
        except CommunicationError:
            if time.monotonic() > until:
                bus.close()
                raise
            time.sleep(0.5)
        else:
            return bus


def _configure(folder: Path, name: str, port: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    text = (ROOT / "config" / "routed" / f"{name}.json5").read_text(encoding="utf-8")
    (folder / f"{name}.json5").write_text(text.replace(PORT, str(port)).replace("0.0.0.0", "127.0.0.1"), "utf-8")


@contextmanager
def _process(command: list[str], more: dict[str, str]) -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, env={**os.environ, **more}) as process:
        try:
            yield process
        finally:
            process.terminate()
            with suppress(subprocess.TimeoutExpired):
                process.wait(20.0)
            process.kill()
