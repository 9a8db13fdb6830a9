"""What takes long before a request can be carried out, in a thread beside the reactor's: types read and compiled."""

from __future__ import annotations

import sys
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from typing import Final, TypeVar

from iec61499 import model
from iec61499.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.net.reactor import Reactor
from iec61499.runtime.compile import compile_type
from iec61499.runtime.linking.generic_ports import generic_variables

SWITCH: Final = 0.0005
"""Time after which a thread that computes lets the other have the interpreter, s. A tick needs it several times."""

_T = TypeVar("_T")


class Worker:
    """One thread, which does one thing after another while the reactor serves.

    It makes the interpreter change threads every `SWITCH`, in the whole process.
    """

    def __init__(self, reactor: Reactor) -> None:
        self._reactor = reactor
        self._executor = ThreadPoolExecutor(1, "preparation")
        sys.setswitchinterval(SWITCH)

    def submit(self, work: Callable[[], _T], done: Callable[[Future[_T]], None]) -> None:
        """Does the work in the thread, then calls `done` in the reactor's with its outcome."""

        def finished(outcome: Future[_T]) -> None:
            self._reactor.call_soon_threadsafe(partial(done, outcome))

        self._executor.submit(work).add_done_callback(finished)

    def close(self) -> None:
        """Waits for what is being done, and forgets the rest."""
        self._executor.shutdown(cancel_futures=True)


class Preparation:
    """Reads and compiles block types ahead of their use.

    Args:
        library: finds the types.
    """

    def __init__(self, library: Library) -> None:
        self._library = library
        self._ready: set[str] = set()

    def is_ready(self, name: str) -> bool:
        """Whether a type can be used without what takes long: it has been prepared, or there is no such type."""
        return name in self._ready or not self._library.offers(name)

    def prepare(self, name: str) -> None:
        """Reads a type and compiles it, and what is inside it. What is wrong is found again when it is used."""
        if not self.is_ready(name):
            self._ready.add(name)
            with suppress(FunctionBlockError):
                self._prepare(name)

    def _prepare(self, name: str) -> None:
        found = self._library.find(name)
        if isinstance(found, model.CompositeFBType | model.SubApplicationType):
            self.prepare_network(found.network)
        elif not generic_variables(found):
            compile_type(found)

    def prepare_network(self, network: model.FBNetwork) -> None:
        """Prepares the types of a network."""
        for block in network.blocks:
            self.prepare(block.type_name)
        for sub in network.subapplications:
            self.prepare_network(sub.network)
