"""Sends frames and states to all pages that are open: each page gets the newest, and none waits for a slow one."""

from __future__ import annotations

import asyncio
import logging
import math
from contextlib import suppress
from typing import Final

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.websockets import WebSocket, WebSocketDisconnect

from dtwin.console.console import Console
from dtwin.console.people.occupancy import IDLE
from dtwin.console.people.sessions import Session
from dtwin.console.telling import CellState

log = logging.getLogger(__name__)

RATE: Final = 20.0
"""Number of frames in a second."""
STATE_EVERY: Final = 5
"""Number of frames between two looks at the state."""
UNREAD_EVERY: Final = 2 * STATE_EVERY
"""The same while no page is open."""
KEEPING: Final = 1.5
"""Time between two signs of life that are passed on to who keeps the desk, s."""
ACTED: Final = "acted"
"""What a page says when its person has done something; anything else is a sign of life of the page alone."""
LOOKS: Final = "look "
"""What a page says before the name of the station of a line whose arm it shows, "" for none."""
LONGEST: Final = 64
"""Length of the longest name of a station."""
MOST: Final = 64
"""Number of pages at one time."""


class Reader:
    """One open page: what waits to be sent to it, of each kind the newest.

    Args:
        session: session of the page.
        now: time at which it was opened, s.

    Attributes:
        session: session of the page, with the rights of now.
        acted: time at which its person last did something, s.
        kept: time of the last sign of life that was passed on, s; before the first one, minus infinity.
        over: whether the session has ended.
        station: name of the station whose arm the page shows, "" for none.
    """

    def __init__(self, session: Session, now: float) -> None:
        self.session = session
        self.acted = now
        self.kept = -math.inf
        self.over = False
        self.station = ""
        self.told: dict[str, bytes] = {}
        self.waiting: dict[str, bytes] = {}
        self.news = asyncio.Event()

    def put(self, kind: str, message: bytes) -> None:
        """Replaces what waits of a kind."""
        self.waiting[kind] = message
        self.news.set()

    def put_changed(self, kind: str, message: bytes) -> None:
        """Replaces what waits of a kind, if it differs from what was told."""
        if self.told.get(kind) != message:
            self.told[kind] = message
            self.put(kind, message)


class Stream:
    """The pages that are open, and the loop that feeds them.

    Args:
        console: console whose cell is shown.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._readers: set[Reader] = set()
        self._closed = False
        self._opened = asyncio.Event()

    async def run(self) -> None:
        """Feeds all pages until it is cancelled."""
        loop = asyncio.get_running_loop()
        due, count = loop.time(), 0
        while True:
            try:
                self._tell(count)
            except Exception:  # The loop serves everybody: nothing that is shown may end it.
                log.exception("a frame was not told")
            passed = 1 if self._readers else UNREAD_EVERY - count % UNREAD_EVERY
            count += passed
            due = max(due + passed / RATE, loop.time())
            if self._readers:
                await asyncio.sleep(due - loop.time())
            elif await self._has_opened(due - loop.time()):
                due = loop.time()

    async def _has_opened(self, timeout: float) -> bool:
        """Whether a page is opened within a time, s."""
        self._opened.clear()
        with suppress(TimeoutError):
            await asyncio.wait_for(self._opened.wait(), timeout)
        return self._opened.is_set()

    def close(self) -> None:
        """Ends all connections."""
        self._closed = True
        for reader in self._readers:
            reader.news.set()

    def _tell(self, count: int) -> None:
        console, hub = self._console, self._console.hub
        hub.follow_path(bool(self._readers))
        hub.watch(frozenset(reader.station for reader in self._readers))
        if self._readers:
            encoded = msgspec.json.encode(hub.frame())
            for reader in self._readers:
                reader.put("frame", encoded)
                if (face := hub.station(reader.station)) is not None:
                    reader.put("station", msgspec.json.encode(face))
        if count % STATE_EVERY == 0:
            state, at = hub.state(), console.clocks.wall()
            console.annunciator.look(state, hub.fresh_events(), hub.age, at)
            told = msgspec.json.encode(state)
            console.ring.add_state(at, told)
            if self._readers:
                alarms = msgspec.json.encode(console.annunciator.message(at))
                for reader in self._readers:
                    self._tell_state(reader, state, told)
                    reader.put_changed("alarms", alarms)

    def _tell_state(self, reader: Reader, state: CellState, told: bytes) -> None:
        session = self._console.session(reader.session.key)
        if session is None:
            reader.over = True
            reader.news.set()
            return
        reader.session = session
        reader.put_changed("state", told)
        reader.put_changed("you", msgspec.json.encode(self._console.you(reader.session, state)))

    async def serve(self, socket: WebSocket, session: Session) -> None:
        """Serves one page until it is closed or its session has ended."""
        if len(self._readers) >= MOST:
            await socket.close(1013, "too many pages are open")
            return
        await socket.accept()
        reader = Reader(session, self._console.clocks.steady())
        state = self._console.hub.state()
        self._tell_state(reader, state, msgspec.json.encode(state))
        self._readers.add(reader)
        self._opened.set()
        listening = asyncio.create_task(self._listen(socket, reader))
        try:
            while not (listening.done() or self._closed or reader.over):
                await reader.news.wait()
                reader.news.clear()
                waiting, reader.waiting = reader.waiting, {}
                for message in waiting.values():
                    await socket.send_text(message.decode())
            if not listening.done():
                await socket.close(1001 if self._closed else 1008)
        except (WebSocketDisconnect, RuntimeError):
            pass  # The page has gone.
        finally:
            self._readers.discard(reader)
            listening.cancel()

    async def _listen(self, socket: WebSocket, reader: Reader) -> None:
        """Takes signs of life, the only thing that a page says here: of itself, or that a person has acted."""
        try:
            while True:
                said, now = await socket.receive_text(), self._console.clocks.steady()
                if said == ACTED:
                    reader.acted = now
                elif said.startswith(LOOKS):
                    reader.station = said.removeprefix(LOOKS)[:LONGEST]
                if now - reader.acted < IDLE and now - reader.kept >= KEEPING:
                    reader.kept = now
                    await run_in_threadpool(self._console.keep_desk, reader.session)
        except (WebSocketDisconnect, RuntimeError, KeyError):
            return
