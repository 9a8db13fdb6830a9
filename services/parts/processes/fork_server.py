"""A process that loads the modules of services once and forks a service whenever its supervisor asks for one.

Most of what a service takes to start is the loading of modules, which those of a cell share. This process loads a
module when it is asked for it first, starts no thread and opens no session. What it forks leaves its loop and is from
then on what `python -m MODULE` would be, with a session, a command line, an environment and a standard error of its
own.

The process that is forked is a grandchild, whose parent ends at once, so that the supervisor can adopt it, see
`dtwin.services.parts.processes.forked`: services do not end when this process does.
"""

from __future__ import annotations

import ctypes
import gc
import os
import runpy
import socket
import sys
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Final

import msgspec

MODULE: Final = "dtwin.services.parts.processes.fork_server"
ROOM: Final = "." * 8000
"""Last word of this process's command line, over which the words of what it forks are written."""
LONGEST: Final = 1 << 18
"""Of a request, bytes; a longer one cannot be sent through a socket as one message."""
_COMPILED: Final = "dtwin.twin.compiled"
"""Module that is loaded when there are kernels, whose compiler takes as long to load as many modules."""
_ARGUMENTS: Final = slice(45, 47)
"""Where proc(5) tells the place of the command line in memory: fields 48 and 49, the first two taken away."""


class Asked(msgspec.Struct, frozen=True):
    """The process that is asked for: its command line, `PYTHON -m MODULE ...`, its environment, and its folder."""

    words: tuple[str, ...]
    environment: dict[str, str]
    folder: str


def serve(requests: socket.socket) -> Asked | None:
    """Forks what is asked for until nobody can ask any more; then, and in a process that was forked, it returns.

    With every request come two descriptors: the standard error of the new process, and one at which that waits for a
    word, since who has asked may have given up meanwhile.

    Returns:
        What this process shall be now, None if that is nothing.
    """
    gc.disable()  # Nothing here is rubbish, and what is not looked at stays shared.
    while True:
        message, descriptors, *_ = socket.recv_fds(requests, LONGEST, 2)
        if not message:
            return None
        asked = msgspec.json.decode(message, type=Asked)
        _load(asked.words[2])
        gc.freeze()
        if (pid := _forked()) == 0:
            requests.close()
            return asked if _wanted(*descriptors) else None
        for descriptor in descriptors:
            os.close(descriptor)
        requests.send(str(pid).encode())


def _load(module: str) -> None:
    """Loads a module, and what it does first of all."""
    with suppress(Exception):  # The new process finds the same and says it.
        import_module(module)
        if _COMPILED in sys.modules:
            sys.modules[_COMPILED].ready_compiler()


def become(asked: Asked) -> None:
    """Lets this process, which was forked, be what was asked for."""
    gc.enable()
    os.setsid()
    os.chdir(asked.folder)
    os.environ.clear()
    os.environ.update(asked.environment)
    show(asked.words)
    _, _, module, *options = asked.words
    sys.argv = [module, *options]
    sys.modules.pop(module, None)  # It is run, as by Python itself, and not imported.
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def show(words: tuple[str, ...]) -> None:
    """Writes a command line over that of this process, as far as there is room, for all who look at processes."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = (int(field) for field in fields[_ARGUMENTS])
    room = end - begin
    if begin and room > 0:
        line = b"".join(os.fsencode(word) + b"\0" for word in words)
        ctypes.memmove(begin, line[: room - 1].ljust(room, b"\0"), room)


def _forked() -> int:
    """Forks a process whose parent has ended when this returns.

    Returns:
        Its number, or 0 in the new process.

    Raises:
        OSError: it cannot be forked.
    """
    receiver, sender = os.pipe()
    between = os.fork()
    if between == 0:
        try:
            pid = os.fork()
            if pid:
                os.write(sender, str(pid).encode())
        except OSError:
            os._exit(1)
        if pid:
            os._exit(0)
    os.close(sender)
    if between == 0:
        os.close(receiver)
        return 0
    os.waitpid(between, 0)
    with open(receiver, "rb") as told:
        if digits := told.read():
            return int(digits)
    raise OSError("nothing was forked")


def _wanted(errors: int, word: int) -> bool:
    """Takes on standard error, and waits until this new process is wanted, or whoever asked for it does no more."""
    os.dup2(errors, sys.stderr.fileno())
    os.close(errors)
    with open(word, "rb") as waited:
        return bool(waited.read(1))


if __name__ == "__main__":
    show((sys.executable, "-m", MODULE))
    with socket.socket(fileno=int(sys.argv[1])) as connection:
        wanted = serve(connection)
    if wanted is not None:
        become(wanted)
