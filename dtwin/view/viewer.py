"""The Rerun viewer as a process of its own, in a window or as a page for browsers, on the loopback interface only."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal
from urllib.parse import quote

from dtwin.errors import CommunicationError

Viewer = Literal["none", "window", "web"]
Detail = Literal["screen", "full"]
"""What a recording holds: what a screen can show of a run, or every sample."""
LOOPBACK: Final = "127.0.0.1"
PAGE, DATA = 9090, 9876
"""Rerun's default TCP ports for web pages and for data."""
_TIMEOUT: Final = 10.0
"""Longest wait for the viewer to listen, and for an earlier viewer to end, s."""
_LOOK: Final = 0.05
"""Time between two attempts to connect, s."""
_TIED: Final = '"$@" & read -r _; kill 0'
"""Shell command that runs another one until standard input ends, which it does however its writer ends."""


@dataclass(frozen=True, slots=True)
class Ports:
    """The TCP ports at which a viewer listens.

    Attributes:
        page: port for browsers, used by a web viewer only.
        data: port for data.
    """

    page: int = PAGE
    data: int = DATA

    @property
    def data_url(self) -> str:
        """URL that a recording connects to."""
        return f"rerun+http://{LOOPBACK}:{self.data}/proxy"

    @property
    def page_url(self) -> str:
        """URL to open in a browser."""
        return f"http://{LOOPBACK}:{self.page}/?url={quote(self.data_url, safe='')}"


def has_gpu() -> bool:
    """Whether this machine has a device that a browser may draw with; software draws a frame or so a second."""
    return any(Path("/dev/dri").glob("renderD*")) or Path("/dev/nvidia0").exists() or sys.platform != "linux"


def free_ports() -> Ports:
    """Rerun's default ports where they are free, otherwise other free ports."""
    return Ports(_free(PAGE), _free(DATA))


class ViewerProcess:
    """A viewer in a process of its own; a window stays open after this process ends, a web viewer ends with it.

    Args:
        kind: "window" for a window, "web" for a page in a browser.
        ports: ports at which the viewer listens.

    Raises:
        CommunicationError: the viewer does not start to listen.
    """

    def __init__(self, kind: Literal["window", "web"], ports: Ports) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        common = ["--bind", LOOPBACK, "--port", str(ports.data)]
        viewer = [sys.executable, "-m", "rerun_cli", *common]
        if kind == "web":
            _wait(ports, listening=False)
            page = [*viewer, "--serve-web", "--web-viewer-port", str(ports.page)]
            self._process = _start(["/bin/sh", "-c", _TIED, "sh", *page], subprocess.PIPE)
        elif not listens(ports.data):  # otherwise the window of an earlier recorder is used
            _start([*viewer, "--expect-data-soon"], subprocess.DEVNULL)
        _wait(ports, listening=True)

    def close(self) -> None:
        """Ends a web viewer."""
        if self._process is not None:
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._process.wait()


def _start(command: list[str], stdin: int) -> subprocess.Popen[bytes]:
    """Starts a process that Ctrl-C in the terminal of this one does not reach."""
    return subprocess.Popen(
        command, stdin=stdin, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def _wait(ports: Ports, listening: bool) -> None:
    deadline = time.monotonic() + _TIMEOUT
    while listens(ports.data) != listening:
        if time.monotonic() > deadline:
            state = "does not listen" if listening else "is in use"
            raise CommunicationError(f"the viewer's port {LOOPBACK}:{ports.data} {state}")
        time.sleep(_LOOK)


def listens(port: int) -> bool:
    """Whether something listens at a port of the loopback interface."""
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0


def _free(wanted: int) -> int:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((LOOPBACK, 0 if listens(wanted) else wanted))
        port: int = probe.getsockname()[1]
    return port
