"""Who is logged in: sessions in memory, told by a cookie, and the limit of attempts to log in."""

from __future__ import annotations

import hashlib
import secrets
import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from dtwin.console.people.users import Role

LIFETIME: Final = 12 * 3600.0
"""Time without a request after which a session ends, s."""
MOST: Final = 1000
"""Number of sessions; the one that was not used for the longest time makes room for a new one."""
ATTEMPTS: Final = 5
"""Number of failed attempts from one address, or for one name, before the next ones wait."""
PAUSE: Final = 60.0
"""Time in which failed attempts are counted, s."""


@dataclass(slots=True)
class Session:
    """A browser that is logged in.

    Attributes:
        key: secret that the cookie carries.
        token: secret that every command must carry beside the cookie (against cross-site request forgery).
        user: name of the person.
        role: what the person may do.
        seen: time of the last request, s.
    """

    key: str
    token: str
    user: str
    role: Role
    seen: float

    @property
    def name(self) -> str:
        """A name of the session that tells nothing of its secrets."""
        return hashlib.blake2b(self.key.encode(), digest_size=4).hexdigest()


class Sessions:
    """All sessions; every call tells the time (s) on a clock that only grows."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._lock = threading.Lock()

    def begin(self, user: str, role: Role, now: float) -> Session:
        """A new session."""
        session = Session(secrets.token_urlsafe(32), secrets.token_urlsafe(32), user, role, now)
        with self._lock:
            self._sessions[session.key] = session
            while len(self._sessions) > MOST:
                self._sessions.popitem(last=False)
        return session

    def find(self, key: str | None, now: float) -> Session | None:
        """The session of a cookie, None when there is none or it has ended."""
        with self._lock:
            session = self._sessions.get(key or "")
            if session is None:
                return None
            if now - session.seen > LIFETIME:
                del self._sessions[session.key]
                return None
            session.seen = now
            self._sessions.move_to_end(session.key)
            return session

    def holds(self, session: Session) -> bool:
        """Whether a session has not ended."""
        return session.key in self._sessions

    def end(self, key: str) -> None:
        """Ends a session."""
        with self._lock:
            self._sessions.pop(key, None)


class Attempts:
    """Counts failed attempts to log in, by address and by name, and says how long the next one has to wait."""

    def __init__(self) -> None:
        self._failed: OrderedDict[str, list[float]] = OrderedDict()
        self._lock = threading.Lock()

    def wait(self, keys: tuple[str, ...], now: float) -> float:
        """Time that an attempt has to wait, s; 0 for none."""
        with self._lock:
            waits = [0.0]
            for key in keys:
                recent = [time for time in self._failed.get(key, []) if now - time < PAUSE]
                if len(recent) >= ATTEMPTS:
                    waits.append(PAUSE - (now - recent[-ATTEMPTS]))
            return max(waits)

    def fail(self, keys: tuple[str, ...], now: float) -> None:
        """Notes a failed attempt."""
        with self._lock:
            for key in keys:
                recent = [time for time in self._failed.pop(key, []) if now - time < PAUSE]
                self._failed[key] = [*recent, now]
            while len(self._failed) > MOST:
                self._failed.popitem(last=False)

    def clear(self, keys: tuple[str, ...]) -> None:
        """Forgets the failed attempts after one that was right."""
        with self._lock:
            for key in keys:
                self._failed.pop(key, None)
