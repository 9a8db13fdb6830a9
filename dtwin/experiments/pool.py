"""Many runs spread over the cores."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def spread(
    function: Callable[[T], R],
    items: Sequence[T],
    workers: int | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[R]:
    """The function's results in the order of the items, computed in as many processes as there are cores.

    Args:
        function: of one item; a function of a module, so that processes can be told of it.
        items: each with its own seed, so that nothing depends on the number of processes.
        workers: processes; 1 runs all in this one.
        progress: told the numbers of items done and in all.
    """
    count = min(workers or os.cpu_count() or 1, len(items))
    if count <= 1:
        results = []
        for done, item in enumerate(items, 1):
            results.append(function(item))
            progress(done, len(items))
        return results
    # Forking would copy whatever threads hold; a fresh process loads the compiled twin in a second.
    with ProcessPoolExecutor(count, multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(function, item) for item in items]
        for done, _ in enumerate(as_completed(futures), 1):
            progress(done, len(items))
        return [future.result() for future in futures]
