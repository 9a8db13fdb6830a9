"""The supervisor's side of the fork server: how it asks for a process, and what it holds of it."""

from __future__ import annotations

import ctypes
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from typing import IO, Final

import msgspec

from dtwin.services.parts.processes.fork_server import MODULE, ROOM, Asked

LOADING: Final = 30.0
"""Longest wait for the first process of a module, which has to be loaded, s."""
PATIENCE: Final = 3.0
"""Longest wait for a further one, s: the supervisor looks after no other service meanwhile."""
_SET_SUBREAPER: Final = 36
_GET_SUBREAPER: Final = 37
"""Operations of prctl(2): who is a subreaper becomes the parent of descendants whose own parent ends."""


class Forked:
    """A process that the fork server has forked and this one has adopted, with what Popen has of its processes.

    Args:
        pid: its number.
        errors: the end of its standard error to read from.

    Raises:
        ChildProcessError: it is no child of this process.
        OSError: the system cannot watch it.
    """

    def __init__(self, pid: int, errors: IO[str]) -> None:
        self.pid = pid
        self.stderr: IO[str] | None = errors
        self._status: int | None = None
        os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        self._watch = os.pidfd_open(pid)

    def poll(self) -> int | None:
        """Its exit status, or the negative number of the signal that has killed it; None while it runs."""
        if self._status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._status = os.waitstatus_to_exitcode(status)
                os.close(self._watch)
        return self._status

    def wait(self, timeout: float | None = None) -> int:
        """Waits for its end and returns what `poll` does.

        Raises:
            TimeoutExpired: it did not end within `timeout` s.
        """
        if self.poll() is None:
            select.select([self._watch], [], [], timeout)
        if (status := self.poll()) is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return status

    def send_signal(self, number: int) -> None:
        """Sends it a signal, unless it has ended."""
        if self.poll() is None:
            signal.pidfd_send_signal(self._watch, number)

    def kill(self) -> None:
        """Ends it by force."""
        self.send_signal(signal.SIGKILL)


class ForkServer:
    """A fork server and the connection to it.

    Args:
        environment: environment of its process; what modules read when they are loaded counts for all services.
        lifeline: descriptor that the processes that it forks have under the same number.
    """

    def __init__(self, environment: Mapping[str, str], lifeline: int) -> None:
        self._requests, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._loaded: set[str] = set()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", MODULE, str(theirs.fileno()), ROOM],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env=environment,
                pass_fds=(theirs.fileno(), lifeline),
                start_new_session=True,
            )

    def start(self, command: Sequence[str], environment: Mapping[str, str]) -> Forked:
        """Starts `PYTHON -m MODULE ...`, a child of this process.

        Raises:
            OSError, ValueError: the server has gone or does not answer, or what is asked for cannot be sent.
        """
        asked = msgspec.json.encode(Asked(tuple(command), dict(environment), os.getcwd()))
        module = command[2]
        self._requests.settimeout(PATIENCE if module in self._loaded else LOADING)
        with ExitStack() as ours:
            receiver, sender = os.pipe()
            errors = ours.enter_context(open(receiver, errors="replace"))
            waited, word = os.pipe()
            go = ours.enter_context(open(word, "wb"))
            try:
                with _adopting():
                    socket.send_fds(self._requests, [asked], [sender, waited])
                    answer = self._requests.recv(32)
            finally:
                os.close(sender)
                os.close(waited)
            process = Forked(int(answer), errors)
            go.write(b".")
            go.close()
            ours.pop_all()
        self._loaded.add(module)
        return process

    def close(self) -> None:
        """Ends the server; the processes that it has forked stay."""
        self._requests.close()
        self._process.kill()
        self._process.wait()


@contextmanager
def _adopting() -> Iterator[None]:
    """Lets this process adopt what is forked meanwhile, and nothing that is orphaned at another time.

    Raises:
        OSError: the system does not have that.
    """
    library = ctypes.CDLL(None, use_errno=True)
    before = ctypes.c_int()
    if library.prctl(_GET_SUBREAPER, ctypes.byref(before), 0, 0, 0) or library.prctl(_SET_SUBREAPER, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "this process cannot adopt others")
    try:
        yield
    finally:
        library.prctl(_SET_SUBREAPER, before.value, 0, 0, 0)
