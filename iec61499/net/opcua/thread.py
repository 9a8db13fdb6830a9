"""An asyncio loop in a thread of its own, begun when something has to be done in it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from typing import Any, Final

PATIENCE: Final = 5.0
"""Longest time that the end of what is under way is waited for, s."""

Work = Coroutine[Any, Any, None]


class LoopThread:
    """Does things in the loop. Its thread is a daemon: it never keeps a process from its end."""

    def __init__(self) -> None:
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._under_way: set[asyncio.Task[Any]] = set()

    def submit(self, work: Work) -> Future[None]:
        """Has a coroutine done, from any thread."""
        return asyncio.run_coroutine_threadsafe(self._done(work), self._running())

    def call(self, function: Callable[[], None]) -> None:
        """Calls a function in the loop, from any thread."""
        self._running().call_soon_threadsafe(function)

    def close(self, last: Callable[[], Work]) -> None:
        """Cancels what is under way, has `last` done, and ends the thread."""
        if self._loop is None or self._thread is None:
            return
        asyncio.run_coroutine_threadsafe(self._end(last), self._loop)
        self._thread.join(PATIENCE)
        self._loop = self._thread = None

    def _running(self) -> asyncio.AbstractEventLoop:
        if self._loop is None:
            self._loop = asyncio.new_event_loop()
            self._loop.set_exception_handler(lambda loop, context: None)  # told where it is noticed
            self._thread = threading.Thread(target=_run, args=(self._loop,), name="opcua", daemon=True)
            self._thread.start()
        return self._loop

    async def _done(self, work: Work) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._under_way.add(task)
        try:
            await work
        finally:
            self._under_way.discard(task)

    async def _end(self, last: Callable[[], Work]) -> None:
        tasks = list(self._under_way)
        for task in tasks:
            task.cancel()
        with contextlib.suppress(Exception):
            if tasks:
                await asyncio.wait(tasks, timeout=PATIENCE / 2)
            await asyncio.wait_for(last(), PATIENCE / 2)
        asyncio.get_running_loop().stop()


def _run(loop: asyncio.AbstractEventLoop) -> None:
    asyncio.set_event_loop(loop)
    loop.run_forever()
    loop.close()
