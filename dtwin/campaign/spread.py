"""A campaign: many independent tasks, spread over workers, whose results do not depend on who did which, and when."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import TracebackType
from typing import Final, Protocol, TypeVar

from dtwin.campaign.processes import Here, Processes
from dtwin.campaign.task import Failure, Success
from dtwin.errors import ParameterError, TaskError

T = TypeVar("T")
R = TypeVar("R")

Progress = Callable[[int, int], None]
"""told the numbers of items done and in all"""


@dataclass(frozen=True, slots=True)
class Workforce:
    """Who does the tasks of campaigns.

    Attributes:
        workers: number of processes of this machine; None is one for each core, 1 is this process alone.
        scheduler: address of a Dask scheduler, whose workers do them instead, such as tcp://127.0.0.1:8786.

    Raises:
        ParameterError: both are given, or there are no processes.
    """

    workers: int | None = None
    scheduler: str | None = None

    def __post_init__(self) -> None:
        if self.workers is not None and self.scheduler is not None:
            raise ParameterError("--workers, --scheduler: expected one of them: a cluster has workers of its own")
        if self.workers is not None and self.workers < 1:
            raise ParameterError(f"--workers: expected at least 1, got {self.workers}")


EVERY_CORE: Final = Workforce()
"""A process for each core of this machine."""


class _Team(Protocol):
    @property
    def count(self) -> int: ...

    def outcomes(
        self, function: Callable[[T], R], items: Sequence[T], end: Callable[[], int]
    ) -> Iterator[tuple[int, Success[R] | Failure]]: ...

    def close(self) -> None: ...


class Workers:
    """Workers that share tasks; a context manager that lets them go at the end.

    Args:
        workforce: who they are.
        most: largest number of processes of this machine that are of use.

    Raises:
        ParameterError: the scheduler cannot be used.
        CommunicationError: the scheduler cannot be reached.
    """

    def __init__(self, workforce: Workforce = EVERY_CORE, most: int | None = None) -> None:
        self._team: _Team
        if workforce.scheduler is not None:
            from dtwin.campaign.cluster import Cluster  # loads the function blocks

            self._team = Cluster(workforce.scheduler)
        else:
            count = min(workforce.workers or cores(), most or sys.maxsize)
            self._team = Here() if count == 1 else Processes(count)

    @property
    def count(self) -> int:
        """The number of tasks that are done at once; of a cluster, when it was joined."""
        return self._team.count

    def __enter__(self) -> Workers:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._team.close()

    def map(
        self,
        function: Callable[[T], R],
        items: Sequence[T],
        progress: Progress = lambda done, of: None,
        name: Callable[[T], str] = str,
    ) -> list[R]:
        """The function's results in the order of the items, whoever does them.

        The tasks of a worker that is lost are done again by another one. Once a task has failed, those after it are
        no longer begun.

        Args:
            function: what is done with one item; it can be pickled, as a function of a module can.
            items: what the function is called with; what is random in them comes from seeds of their own.
            progress: told the numbers of items done and in all.
            name: what an error calls an item.

        Raises:
            TaskError: a task failed, or several workers were lost with it; the first such in the order of the items.
            CommunicationError: the scheduler was lost.
        """
        results: dict[int, R] = {}
        failures: dict[int, Failure] = {}
        for index, outcome in self._team.outcomes(function, items, lambda: min(failures, default=len(items))):
            if isinstance(outcome, Failure):
                failures[index] = outcome
            else:
                results[index] = outcome.value
                progress(len(results), len(items))
        if failures:
            first = min(failures)
            failure = failures[first]
            error = TaskError(f"task {first + 1} of {len(items)}, {name(items[first])}: {failure.reason}")
            if failure.trace:
                error.add_note(failure.trace)
            raise error
        return [results[index] for index in range(len(items))]


def spread(
    function: Callable[[T], R],
    items: Sequence[T],
    workforce: Workforce = EVERY_CORE,
    progress: Progress = lambda done, of: None,
    name: Callable[[T], str] = str,
) -> list[R]:
    """The results of `Workers.map`, of no more processes than there are items."""
    with Workers(workforce, max(1, len(items))) as workers:
        return workers.map(function, items, progress, name)


def cores() -> int:
    """The number of cores that this process may use."""
    return len(os.sched_getaffinity(0))
