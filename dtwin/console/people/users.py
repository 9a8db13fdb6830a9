"""Names, roles and passwords of those who may use the console: a JSON file with scrypt hashes (RFC 7914)."""

from __future__ import annotations

import hashlib
import hmac
import os
from base64 import b64decode, b64encode
from pathlib import Path
from typing import Final, Literal, get_args

import msgspec

from dtwin.errors import ParameterError, choices
from dtwin.files import replacing
from dtwin.names import Name, check_name

Role = Literal["viewer", "operator", "engineer"]
ROLES: Final[tuple[Role, ...]] = get_args(Role)
"""In the order of their rights: each may do what the ones before it may."""
SHORTEST: Final = 10
"""Least length of a password, characters."""
LONGEST: Final = 1000
"""Greatest length of a password, characters."""
_COST, _BLOCK, _LANES = 2**15, 8, 1
_MEMORY: Final = 64 * 1024 * 1024


class User(msgspec.Struct, frozen=True):
    """A person who may log in.

    Attributes:
        role: what the person may do.
        salt: salt of the hash, base64.
        scrypt: scrypt hash of the password with N = 2^15, r = 8 and p = 1, base64.
    """

    role: Role
    salt: str
    scrypt: str


_NOBODY: Final = User("viewer", b64encode(bytes(16)).decode(), b64encode(bytes(32)).decode())


class Users:
    """The users of a file, which is read again whenever it has changed, so that a change counts at once.

    Args:
        path: path of the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._read: tuple[tuple[int, ...], dict[str, User]] = (), {}

    def read(self) -> dict[str, User]:
        """All users by name.

        Raises:
            ParameterError: the file cannot be read or is no file of users.
        """
        try:
            found = self.path.stat()
            seen = (found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size)
            if self._read[0] != seen:
                self._read = seen, msgspec.json.decode(self.path.read_bytes(), type=dict[Name, User])
            return self._read[1]
        except OSError as error:
            raise ParameterError(f"{self.path}: {error.strerror}; `dtwin console user NAME` makes it") from None
        except msgspec.MsgspecError as error:
            raise ParameterError(f"{self.path}: expected users with roles and hashes: {error}") from None

    def verified(self, name: str, password: str) -> User | None:
        """The user with the right password, otherwise None; it takes as long for an unknown name.

        Raises:
            ParameterError: the file cannot be read or is no file of users.
        """
        user = self.read().get(name)
        candidate = user or _NOBODY
        right = hmac.compare_digest(_hash(password[:LONGEST], b64decode(candidate.salt)), b64decode(candidate.scrypt))
        return user if right else None

    def set(self, name: str, role: str, password: str) -> None:
        """Adds a user, or gives one another role and password.

        Raises:
            ParameterError: the name, role or password cannot be used, or the file cannot be written.
        """
        if role not in ROLES:
            raise ParameterError(f"role {role!r}: expected {choices(ROLES)}")
        if not SHORTEST <= len(password) <= LONGEST:
            raise ParameterError(f"password: expected {SHORTEST} to {LONGEST} characters, got {len(password)}")
        check_name(name, "user")
        users = dict(self.read()) if self.path.exists() else {}
        salt = os.urandom(16)
        users[name] = User(role, b64encode(salt).decode(), b64encode(_hash(password, salt)).decode())
        with replacing(self.path) as temporary:
            temporary.touch(mode=0o600)
            temporary.chmod(0o600)
            temporary.write_bytes(msgspec.json.format(msgspec.json.encode(users)) + b"\n")


def may(role: Role, needed: Role) -> bool:
    """Whether a role has the rights of another one."""
    return ROLES.index(role) >= ROLES.index(needed)


def _hash(password: str, salt: bytes) -> bytes:
    return hashlib.scrypt(
        password.encode(errors="surrogatepass"), salt=salt, n=_COST, r=_BLOCK, p=_LANES, maxmem=_MEMORY, dklen=32
    )
