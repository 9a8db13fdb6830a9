"""One thread's event loop: sockets that became readable or writable, and timers on the monotonic clock."""

from __future__ import annotations

import contextlib
import heapq
import select
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable
from typing import Final

from iec61499.net.sockets import Closing

READ: Final = selectors.EVENT_READ
WRITE: Final = selectors.EVENT_WRITE
LONGEST_WAIT: Final = 3600.0
"""Time after which the loop looks at its timers again, s; the system takes no time beyond some days."""
SELECTABLE: Final = 1024
"""Descriptors from here on are none that select takes (FD_SETSIZE)."""
CROWDED: Final = 1000
"""Timers from which on those that were taken back are removed."""


class Timer:
    """A call that is due at some time; `cancel` takes it back."""

    __slots__ = ("callback",)

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        self.callback = None


class Reactor(Closing):
    """Waits for sockets and timers and calls back, always in the thread that calls `run`.

    Only `stop` and `call_soon_threadsafe` may be called from another thread, `stop` also from a signal handler.

    In one turn one of the calls that were asked for soon is made, then every socket that is ready and every timer
    that is due has its turn; timers are looked at again after every socket. A timer asked for in a turn waits for the
    next one. So who has more to do asks to be called soon, and holds up a timer by what it does at a time.

    Attributes:
        turn: how often the sockets and timers have had their turn.
    """

    def __init__(self) -> None:
        self.turn = 0
        self._selector = selectors.DefaultSelector()
        descriptor = self._selector.fileno() if hasattr(self._selector, "fileno") else SELECTABLE
        self._descriptor = descriptor if descriptor < SELECTABLE else None
        self._callbacks: dict[int, Callable[[int], None]] = {}
        self._timers: list[tuple[float, int, Timer]] = []
        self._soon: deque[Timer] = deque()
        self._asked = 0
        self._asked_before = 0
        self._crowded = CROWDED
        self._stopping = False
        self._wake_receiver, self._wake_sender = socket.socketpair()
        self._wake_receiver.setblocking(False)
        self._wake_sender.setblocking(False)
        self.watch(self._wake_receiver, READ, self._drain)

    def now(self) -> float:
        """The time on the monotonic clock, which timers follow, s."""
        return time.monotonic()

    def watch(self, sock: socket.socket, events: int, callback: Callable[[int], None]) -> None:
        """Calls back with the events (READ, WRITE or both) when the socket is ready; replaces an earlier watch."""
        if sock.fileno() in self._callbacks:
            self._selector.modify(sock, events)
        else:
            self._selector.register(sock, events)
        self._callbacks[sock.fileno()] = callback

    def forget(self, sock: socket.socket) -> None:
        """Ends a watch; call it before the socket is closed."""
        if self._callbacks.pop(sock.fileno(), None) is not None:
            self._selector.unregister(sock)

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Calls back once, when `now` reaches `when`; calls due at one time keep the order they were asked for."""
        timer = Timer(callback)
        if len(self._timers) >= self._crowded:
            # those that were taken back would stay until they are due
            self._timers = [entry for entry in self._timers if entry[2].callback is not None]
            heapq.heapify(self._timers)
            self._crowded = 2 * len(self._timers) + CROWDED
        heapq.heappush(self._timers, (when, self._asked, timer))
        self._asked += 1
        return timer

    def call_soon(self, callback: Callable[[], None]) -> Timer:
        """Calls back once, in one of the next turns; calls keep the order they were asked for."""
        timer = Timer(callback)
        self._soon.append(timer)
        return timer

    def call_soon_threadsafe(self, callback: Callable[[], None]) -> None:
        """As `call_soon`, from any thread."""
        self.call_soon(callback)
        self._wake()

    def run(self) -> None:
        """Serves until `stop`."""
        while not self._stopping:
            self.run_once(None)
        self._stopping = False

    def run_once(self, timeout: float | None) -> None:
        """Serves what is ready, waiting for it at most `timeout` s (None: until something is)."""
        self.turn += 1
        self._asked_before = self._asked
        if self._soon:
            _call(self._soon.popleft())
        due = 0.0 if self._soon else self._until_next_timer()
        waits = [wait for wait in (timeout, due) if wait is not None]
        for key, events in self._ready(min(waits) if waits else None):
            # an earlier callback of this round may have closed the socket
            callback = self._callbacks.get(key.fd)
            if callback is not None:
                callback(events)
                self._call_due()
        self._call_due()

    def _ready(self, wait: float | None) -> list[tuple[selectors.SelectorKey, int]]:
        """What is ready, after `wait` s at most."""
        if wait and self._descriptor is not None:
            # epoll rounds up to milliseconds; select, which waits for its descriptor, does not
            if not select.select([self._descriptor], [], [], wait)[0]:
                return []
            wait = 0.0
        return self._selector.select(wait)

    def stop(self) -> None:
        """Makes `run` return after the callback in progress."""
        self._stopping = True
        self._wake()

    def close(self) -> None:
        """Closes the loop's own sockets; those under watch are closed by their owners."""
        self._selector.close()
        self._wake_receiver.close()
        self._wake_sender.close()

    def _wake(self) -> None:
        # a full pipe has woken the loop already
        with contextlib.suppress(BlockingIOError):
            self._wake_sender.send(b"\0")

    def _drain(self, events: int) -> None:
        self._wake_receiver.recv(4096)

    def _until_next_timer(self) -> float | None:
        while self._timers and self._timers[0][2].callback is None:
            heapq.heappop(self._timers)
        return min(max(0.0, self._timers[0][0] - self.now()), LONGEST_WAIT) if self._timers else None

    def _call_due(self) -> None:
        """Calls back those that are due and were asked for before this turn."""
        now = self.now()
        due: list[tuple[float, int, Timer]] = []
        new: list[tuple[float, int, Timer]] = []
        while self._timers and self._timers[0][0] <= now:
            entry = heapq.heappop(self._timers)
            (due if entry[1] < self._asked_before else new).append(entry)
        for entry in new:
            heapq.heappush(self._timers, entry)
        for _, _, timer in due:
            _call(timer)


def _call(timer: Timer) -> None:
    if timer.callback is not None:
        callback, timer.callback = timer.callback, None
        callback()
