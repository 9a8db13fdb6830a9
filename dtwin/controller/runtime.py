"""What runs the blocks of a controller in this process: machine code where it can be had, Python otherwise.

Both give the same results to the bit. DTWIN_RUNTIME says which one is taken, also by the processes started from this
one: `native`, `python`, or nothing for machine code where it can be had.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Final, Literal, Protocol, get_args

from dtwin.errors import FunctionBlockError, NativeError, ParameterError, choices
from iec61499 import model
from iec61499.library import Library
from iec61499.native.resource import NativeResource
from iec61499.runtime.resource import Resource
from iec61499.trace.ctf import TraceWriter
from iec61499.trace.recorder import TracedResource

log = logging.getLogger(__name__)

Runtime = Literal["native", "python"]
"""What runs the blocks."""
VARIABLE: Final = "DTWIN_RUNTIME"
"""The environment variable that names the runtime."""


class Server(Protocol):
    """A client's view of a SERVER block in this process."""

    def exchange(self, values: Sequence[Any]) -> tuple[Any, ...]:
        """Delivers a message, runs the blocks until nothing is left to do, and returns the answer.

        Raises:
            CommunicationError: the block did not answer once. FunctionBlockError: a block failed.
        """


class Port(Protocol):
    """The outer side of a SERVER block in this process."""

    def deliver(self, values: Sequence[Any]) -> None:
        """Puts values out; their event comes when the blocks run. Raises CommunicationError."""


class Blocks(Protocol):
    """Running blocks, whose variables are named `BLOCK.VARIABLE`; an unknown one is a FunctionBlockError."""

    def start(self) -> None:
        """Starts what E_RESTART starts."""

    def read(self, name: str) -> Any:
        """The value of a variable."""

    def reader(self, names: Sequence[str]) -> Callable[[], tuple[Any, ...]]:
        """A function that reads several variables of one block at once."""

    def write(self, name: str, value: Any) -> None:
        """Sets a variable."""

    def states(self) -> dict[str, dict[str, Any]]:
        """The values of all variables, by block and name."""

    def server(self, name: str) -> Server:
        """Attaches to a SERVER block."""

    def port(self, name: str) -> Port:
        """The outer side of a SERVER block."""

    def run_until_idle(self) -> None:
        """Delivers the events that wait."""

    def snapshot(self) -> Any:
        """The state, to go back to."""

    def restore(self, snapshot: Any) -> None:
        """Goes back to a state."""


@contextmanager
def chosen(runtime: Runtime | None) -> Iterator[None]:
    """Makes this process, and those that it starts meanwhile, take a runtime; None leaves it as it is."""
    before = os.environ.get(VARIABLE)
    if runtime is not None:
        os.environ[VARIABLE] = runtime
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(VARIABLE, None)
        else:
            os.environ[VARIABLE] = before


@dataclass(frozen=True, kw_only=True)
class RuntimeOption:
    """The option of commands that run the function blocks in their own processes."""

    runtime: Runtime | None = None
    """What runs the blocks in process: native is machine code, which needs a C compiler; python does without. The
    results are the same to the bit. Without it machine code where it can be had."""


def running(network: model.FBNetwork, library: Library, writer: TraceWriter | None = None) -> Blocks:
    """The blocks of a network, not yet started.

    Args:
        network: what runs.
        library: finds the block types that the network uses.
        writer: writes a trace of all events until it is closed; without it none is recorded.

    Raises:
        FunctionBlockError: the network or one of its types is wrong.
        NativeError: machine code is asked for and cannot be made here.
        ParameterError: the environment names another runtime.
    """
    runtime = os.environ.get(VARIABLE, "")
    if runtime not in ("", *get_args(Runtime)):
        raise ParameterError(f"{VARIABLE}: expected {choices(get_args(Runtime))}, got {runtime!r}")
    if runtime != "python":
        try:
            return NativeResource(network, library, writer)
        except (NativeError, FunctionBlockError) as error:
            if runtime == "native":
                raise
            log.info("the blocks run in Python: %s", error)
    return Resource(network, library) if writer is None else TracedResource(network, library, writer)
