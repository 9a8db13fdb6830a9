"""Starts the processes of services: forked from one that has loaded their modules, or anew where that cannot be.

They hold one end of a pipe, their lifeline: when the process that has started them goes, in whatever way, they notice
and end.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from types import TracebackType
from typing import Final, TypeAlias

from dtwin.parameters import SOURCE
from dtwin.services.parts.processes.forked import Forked, ForkServer

Process: TypeAlias = "subprocess.Popen[str] | Forked"
UNDRAWN: Final = {"MUJOCO_GL": "disable"}
"""Environment of processes that draw nothing with MuJoCo, which otherwise looks for OpenGL when it is loaded."""


class Starter:
    """Starts processes until it is closed.

    Attributes:
        lifeline: descriptor, in the processes too, that is at its end when this process has gone or has closed it.
    """

    def __init__(self) -> None:
        self.lifeline, self._hold = os.pipe()
        self._server: ForkServer | None = None
        self._may_fork = sys.platform == "linux"
        self._closed = False

    def __enter__(self) -> Starter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self, command: Sequence[str], further: Mapping[str, str] = {}) -> Process:
        """Starts a command in a session of its own; only what it says on its standard error is heard.

        Args:
            command: its words; forked are those of the form `PYTHON -m MODULE ...`.
            further: what its environment has beside this process's own.
        """
        environment = {**UNDRAWN, **os.environ, "PYTHONPATH": str(SOURCE)}
        if self._may_fork and tuple(command[:2]) == (sys.executable, "-m"):
            try:
                if self._server is None:
                    self._server = ForkServer(environment, self.lifeline)
                return self._server.start(command, {**environment, **further})
            except (OSError, ValueError):
                # Whoever has killed it may kill the next one too, and a service shall be back soon.
                self._may_fork = False
                self._end_server()
        return subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            env={**environment, **further},
            pass_fds=(self.lifeline,),
            start_new_session=True,
        )

    def close(self) -> None:
        """Lets go of the lifeline, at which whatever runs still ends, and ends the fork server."""
        if self._closed:
            return
        self._closed = True
        self._end_server()
        os.close(self._hold)
        os.close(self.lifeline)

    def _end_server(self) -> None:
        server, self._server = self._server, None
        if server is not None:
            server.close()
