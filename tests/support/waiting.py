"""What the tests of services share: free ports, waiting for conditions, processes that are surely ended."""

import os
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from dtwin.errors import CommunicationError
from dtwin.iec61499.management.client import ManagementClient
from dtwin.iec61499.net.address import Address

FORTE = os.environ.get("FORTE", "")
NO_FORTE = "set FORTE to the path of a 4diac FORTE with Lua types to run this"

ROOT = Path(__file__).resolve().parents[2]


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


T = TypeVar("T")


def until(condition: Callable[[], T], what: str, timeout: float = 20.0) -> T:
    """Waits for a condition and returns its value; the pause between two looks is no synchronisation."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        assert time.monotonic() < deadline, f"not within {timeout} s: {what}"
        time.sleep(0.02)
    return value


@contextmanager
def forte(folder: Path) -> Iterator[Address]:
    """A FORTE that listens at its management port; SIGPIPE stays ignored, which it does not do by itself."""
    address = Address("127.0.0.1", free_port())
    command = [FORTE, "-c", str(address)]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, restore_signals=False)

    def listens() -> bool:
        try:
            ManagementClient(address).close()
        except CommunicationError:
            return False
        return True

    try:
        until(listens, "FORTE listens")
        yield address
    finally:
        process.kill()
        process.wait()
