"""Tasks at the workers of a Dask cluster, which runs those of a lost worker again."""

from __future__ import annotations

import asyncio
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar, cast

from dtwin.campaign.task import Failure, Success
from dtwin.campaign.there import attempt_there, versions
from dtwin.controller.runtime import VARIABLE, Runtime
from dtwin.errors import CommunicationError, ParameterError

if TYPE_CHECKING:
    from distributed import Client, Future

T = TypeVar("T")
R = TypeVar("R")

PATIENCE: Final = 10.0
"""Time in which a scheduler has to answer, s."""


class Cluster:
    """The workers of a Dask scheduler. They have this package, in the version of this process.

    Args:
        address: where the scheduler listens, such as tcp://127.0.0.1:8786.

    Raises:
        ParameterError: the package distributed is missing, or this is no such address.
        CommunicationError: no scheduler answers.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise ParameterError("--scheduler: expected the package distributed: pip install 'dtwin[dask]'") from None
        # What it would log of a lost connection comes as an error.
        logging.getLogger("distributed.client").setLevel(logging.CRITICAL)
        self._address = address
        self.count = max(1, _threads_of(address))
        try:
            self._client: Client = Client(address, timeout=PATIENCE, set_as_default=False)
        except OSError as error:
            raise CommunicationError(f"--scheduler {address}: the connection was lost: {error}") from None

    def outcomes(
        self, function: Callable[[T], R], items: Sequence[T], end: Callable[[], int]
    ) -> Iterator[tuple[int, Success[R] | Failure]]:
        """As those of `Processes`.

        Raises:
            CommunicationError: the scheduler was lost.
        """
        from distributed import as_completed

        runtime = cast(Runtime | None, os.environ.get(VARIABLE) or None)
        futures = self._client.map(partial(attempt_there, function, runtime, versions()), items, pure=False)
        numbers = {future.key: index for index, future in enumerate(futures)}
        missing = set(numbers.values())
        for future in as_completed(futures, loop=self._client.loop):
            index = numbers[future.key]
            missing.discard(index)
            yield index, self._outcome(future)
            if end() < len(items) and min(missing, default=end()) >= end():
                break
        self._client.cancel(futures)

    def _outcome(self, future: Future) -> Success[Any] | Failure:
        from distributed import KilledWorker

        try:
            found: Success[Any] | Failure = future.result()
        except (CancelledError, OSError):
            raise CommunicationError(f"--scheduler {self._address}: the connection was lost") from None
        except KilledWorker:
            return Failure("all workers that began it were lost")
        except Exception as error:  # the worker cannot read the task, as where this package is missing
            return Failure(f"{type(error).__name__}: {error}")
        return found

    def close(self) -> None:
        """Leaves the cluster, which drops what it still does for this campaign."""
        self._client.close()


def _threads_of(address: str) -> int:
    """The number of threads that the workers of a scheduler have."""
    from distributed import rpc
    from distributed.security import Security

    async def ask() -> dict[str, Any]:
        options = Security().get_connection_args("client")
        async with rpc(address, timeout=PATIENCE, connection_args=options) as peer:
            found: dict[str, Any] = await peer.identity(n_workers=-1)
            return found

    def answer() -> dict[str, Any]:
        return asyncio.run(asyncio.wait_for(ask(), PATIENCE))

    # The client itself would wait for ever for a peer that speaks another protocol, and show its traces.
    try:
        with ThreadPoolExecutor(1) as apart:  # notebooks have a loop of their own
            found = apart.submit(answer).result()
    except (ValueError, TypeError) as error:
        raise ParameterError(f"--scheduler {address}: expected an address such as tcp://HOST:8786: {error}") from None
    except (OSError, TimeoutError) as error:
        reason = error.__cause__ or error
        raise CommunicationError(f"--scheduler {address}: no Dask scheduler answers: {reason}") from None
    if found.get("type") != "Scheduler":
        raise ParameterError(f"--scheduler {address}: expected a Dask scheduler, got {found.get('type')}")
    return sum(worker["nthreads"] for worker in found["workers"].values())
