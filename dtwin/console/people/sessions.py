"""Who is logged in: sessions in memory, told by a cookie, and the limit of attempts to log in.

Where nobody need log in, a visit leaves nothing behind: its cookie proves by a keyed hash that this console made it.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import secrets
import threading
from collections import OrderedDict
from dataclasses import dataclass
from typing import Final

from dtwin.console.people.users import Role

LIFETIME: Final = 12 * 3600.0
"""Time without a sign of life after which a session ends, s."""
EACH: Final = 20
"""Number of sessions of one person; the one that was not used for the longest time makes room for a new one."""
MOST: Final = 1000
"""Number of addresses and names whose failed attempts are remembered."""
ATTEMPTS: Final = 5
"""Number of failed attempts for one name from one address before the next ones wait."""
SPRAYED: Final = 25
"""Number of failed attempts from one address, for whatever names, before the next ones wait."""
PAUSE: Final = 60.0
"""Time in which failed attempts are counted, s."""
_NETWORK: Final = 64
"""Bits of an IPv6 address that tell one subscriber from another one."""


@dataclass(frozen=True, slots=True)
class Session:
    """A browser that is logged in, or needs not be.

    Attributes:
        key: secret that the cookie carries.
        token: secret that every command must carry beside the cookie (against cross-site request forgery).
        user: name of the person.
        role: what the person may do, as of the request that is under way.
        proof: hash of the password with which the person has logged in, "" where nobody need.
    """

    key: str
    token: str
    user: str
    role: Role
    proof: str = ""

    @property
    def name(self) -> str:
        """A name of the session that tells nothing of its secrets."""
        return hashlib.blake2b(self.key.encode(), digest_size=8).hexdigest()


class Sessions:
    """All sessions; every call tells the time (s) on a clock that only grows."""

    def __init__(self) -> None:
        self._sessions: OrderedDict[str, tuple[Session, float]] = OrderedDict()
        self._secret = secrets.token_bytes(32)
        self._lock = threading.Lock()

    def visit(self, user: str) -> Session:
        """A new session of somebody who need not log in; it is not kept."""
        number = secrets.token_urlsafe(32)
        return self._visitor(f"{number}.{self._hash(number)}", user)

    def visitor(self, key: str | None, user: str) -> Session | None:
        """The session of such a cookie, None when this console has not made it."""
        number, _, proof = (key or "").partition(".")
        right = hmac.compare_digest(proof.encode(), self._hash(number).encode())
        return self._visitor(f"{number}.{proof}", user) if right else None

    def open(self, user: str, role: Role, proof: str, now: float) -> Session:
        """A new session of somebody who has logged in."""
        session = Session(secrets.token_urlsafe(32), secrets.token_urlsafe(32), user, role, proof)
        with self._lock:
            self._sessions[session.key] = session, now
            own = [key for key, (other, _) in self._sessions.items() if other.user == user]
            for key in own[:-EACH]:
                del self._sessions[key]
        return session

    def find(self, key: str | None, now: float) -> Session | None:
        """The session of a cookie, None when there is none or it has ended."""
        with self._lock:
            session, seen = self._sessions.get(key or "", (None, now))
            if session is None:
                return None
            if now - seen > LIFETIME:
                del self._sessions[session.key]
                return None
            self._sessions[session.key] = session, now
            self._sessions.move_to_end(session.key)
            return session

    def end(self, key: str) -> None:
        """Ends a session."""
        with self._lock:
            self._sessions.pop(key, None)

    def _visitor(self, key: str, user: str) -> Session:
        return Session(key, self._hash(f"token {key}"), user, "engineer")

    def _hash(self, text: str) -> str:
        return hashlib.blake2b(text.encode(), key=self._secret, digest_size=32).hexdigest()


class Attempts:
    """Counts failed attempts to log in, and says how long the next one has to wait.

    They count for one name from one address, so that nobody is locked out from elsewhere, and for an address with all
    the names that are tried from it.
    """

    def __init__(self) -> None:
        self._failed: OrderedDict[tuple[str, str], list[float]] = OrderedDict()
        self._lock = threading.Lock()

    def wait(self, address: str, name: str, now: float) -> float:
        """Time that an attempt has to wait, s; 0 for none."""
        with self._lock:
            waits = [0.0]
            for key, most in zip(_keys(address, name), (ATTEMPTS, SPRAYED), strict=True):
                recent = [time for time in self._failed.get(key, []) if now - time < PAUSE]
                if len(recent) >= most:
                    waits.append(PAUSE - (now - recent[-most]))
            return max(waits)

    def fail(self, address: str, name: str, now: float) -> None:
        """Notes a failed attempt."""
        with self._lock:
            for key in _keys(address, name):
                recent = [time for time in self._failed.pop(key, []) if now - time < PAUSE]
                self._failed[key] = [*recent, now]
            while len(self._failed) > MOST:
                self._failed.popitem(last=False)

    def clear(self, address: str, name: str) -> None:
        """Forgets the failed attempts for a name after one that was right, which had been noted as failed."""
        with self._lock:
            of_name, of_address = _keys(address, name)
            self._failed.pop(of_name, None)
            del self._failed.get(of_address, [])[-1:]


def _keys(address: str, name: str) -> tuple[tuple[str, str], tuple[str, str]]:
    """What an attempt counts for: a name from an address, and the address; names come from anybody."""
    try:
        found = ipaddress.ip_address(address)
    except ValueError:
        where = address
    else:
        where = address
        if found.version == 6:
            where = str(ipaddress.ip_network((int(found), _NETWORK), strict=False))
    return (where, hashlib.blake2b(name.encode(errors="replace"), digest_size=16).hexdigest()), (where, "")
