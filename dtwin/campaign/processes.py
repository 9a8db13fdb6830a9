"""Tasks in this process, or in processes of this machine, of which one that is lost has its task taken over."""

from __future__ import annotations

import multiprocessing
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from heapq import heappop, heappush
from typing import Final, TypeVar

from dtwin.campaign.task import Failure, Success, attempt

T = TypeVar("T")
R = TypeVar("R")

LOSSES: Final = 3
"""Number of processes that may be lost with a task: the last of them is no accident any more."""


class Here:
    """This process."""

    count = 1

    def outcomes(
        self, function: Callable[[T], R], items: Sequence[T], end: Callable[[], int]
    ) -> Iterator[tuple[int, Success[R] | Failure]]:
        """As those of `Processes`."""
        for index, item in enumerate(items):
            if index >= end():
                return
            yield index, attempt(function, item)

    def close(self) -> None:
        """Nothing has to end."""


class Processes:
    """Processes of this machine.

    Args:
        count: their number.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        # A pool of one for each: when a process is lost, its pool breaks, and tells whose task that was.
        self._pools = [_one_process() for _ in range(count)]

    def outcomes(
        self, function: Callable[[T], R], items: Sequence[T], end: Callable[[], int]
    ) -> Iterator[tuple[int, Success[R] | Failure]]:
        """What becomes of tasks, as they end, with their numbers.

        Args:
            function: what is done with an item; it can be pickled, as a function of a module can.
            items: the items.
            end: number of the first item that is no longer of interest; it may become smaller meanwhile.
        """
        waiting, losses = list(range(len(items))), Counter[int]()
        idle, busy = list(range(self.count)), dict[Future[Success[R] | Failure], tuple[int, int]]()
        while True:
            while idle and waiting and waiting[0] < end():
                index, number = heappop(waiting), idle.pop()
                busy[self._submit(number, function, items[index])] = index, number
            if all(index >= end() for index, _ in busy.values()):
                return
            for future in wait(busy, return_when=FIRST_COMPLETED).done:
                index, number = busy.pop(future)
                idle.append(number)
                error = future.exception()
                losses[index] += isinstance(error, BrokenProcessPool)
                if error is None:
                    yield index, future.result()
                elif not isinstance(error, BrokenProcessPool):
                    yield index, Failure(f"{type(error).__name__}: {error}")
                elif losses[index] < LOSSES:
                    heappush(waiting, index)
                else:
                    yield index, Failure(f"{LOSSES} processes that began it were lost")

    def _submit(self, number: int, function: Callable[[T], R], item: T) -> Future[Success[R] | Failure]:
        """Hands a task to a process, to a new one if that is lost."""
        try:
            return self._pools[number].submit(attempt, function, item)
        except BrokenProcessPool:
            self._pools[number] = _one_process()
            return self._pools[number].submit(attempt, function, item)

    def close(self) -> None:
        """Ends the processes when they have done what they are at."""
        for pool in self._pools:
            pool.shutdown(wait=False, cancel_futures=True)
        for pool in self._pools:
            pool.shutdown()


def _one_process() -> ProcessPoolExecutor:
    # Forking would copy whatever threads hold; a fresh process loads the compiled twin in a second.
    return ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
