"""`dtwin fb run` in a process of its own."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import IO, Final

from dtwin.errors import DtwinError
from iec61499.net.address import parse_stream_address

TIMEOUT: Final = 20.0
"""Longest time that the process takes to end, s."""


class ServedDevice:
    """A device that serves as long as the context lasts.

    Args:
        errors: file for its log, or `subprocess.DEVNULL`.
        arguments: what follows `fb run` on the command line.

    Attributes:
        process: the process.
        address: where its management is.

    Raises:
        DtwinError: it did not start.
    """

    def __init__(self, errors: IO[str] | int, *arguments: str) -> None:
        command = [sys.executable, "-m", "dtwin", "fb", "run", *arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        match = re.search(r"management on (\S+)", line)
        if match is None:
            self.process.kill()
            raise DtwinError(f"the device did not start: {line!r}")
        self.address = parse_stream_address(match[1])

    def __enter__(self) -> ServedDevice:
        return self

    def __exit__(self, *_: object) -> None:
        self.process.terminate()
        self.process.wait(TIMEOUT)
        assert self.process.stdout is not None
        self.process.stdout.close()

    def memory(self) -> int:
        """What the device has of the memory, bytes."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        found = re.search(r"VmRSS:\s+(\d+) kB", status)
        assert found is not None
        return int(found[1]) * 1024
