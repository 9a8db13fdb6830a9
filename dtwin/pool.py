"""Work spread over the cores: one pool of processes for everything that is computed many times."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from types import TracebackType
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[int, int], None]
"""told the numbers of items done and in all"""


class Workers:
    """Processes that share work; a context manager that starts them when work comes and ends them.

    Args:
        count: number of processes; None is one for each core, 1 does the work in this process.
    """

    def __init__(self, count: int | None = None) -> None:
        self.count = count or cores()
        self._pool: ProcessPoolExecutor | None = None
        if self.count > 1:
            # Forking would copy whatever threads hold; a fresh process loads the compiled twin in a second.
            self._pool = ProcessPoolExecutor(self.count, multiprocessing.get_context("spawn"))

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(cancel_futures=kind is not None)

    def map(
        self, function: Callable[[T], R], items: Sequence[T], progress: Progress = lambda done, of: None
    ) -> list[R]:
        """The function's results in the order of the items, whatever the number of processes.

        Args:
            function: what is done with one item; it can be pickled, as a function of a module can.
            items: what the function is called with; what is random in them comes from seeds of their own.
            progress: told the numbers of items done and in all.
        """
        if self._pool is None:
            results = []
            for done, item in enumerate(items, 1):
                results.append(function(item))
                progress(done, len(items))
            return results
        futures = [self._pool.submit(function, item) for item in items]
        for done, _ in enumerate(as_completed(futures), 1):
            progress(done, len(items))
        return [future.result() for future in futures]


def spread(
    function: Callable[[T], R],
    items: Sequence[T],
    workers: int | None = None,
    progress: Progress = lambda done, of: None,
) -> list[R]:
    """The results of `Workers.map` with at most `workers` processes, and no more than there are items."""
    with Workers(max(1, min(workers or cores(), len(items)))) as pool:
        return pool.map(function, items, progress)


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
