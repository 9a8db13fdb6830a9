"""Who sent a message: a keyed hash beside it, which only those who know the cell's key can make.

The attachment is the sender (8 bytes), a number (8 bytes, big-endian), and the BLAKE2b hash of the topic's key
expression, sender, number and payload (RFC 7693, keyed mode, 16 bytes). A sender is one publisher; its numbers grow,
so that a message counts once. They are times of its clock, ns since 1970, so that a subscriber who does not know a
sender yet tells what is said now from what somebody has kept.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from dtwin.bus.codec import MessageError
from dtwin.errors import ParameterError

KEY: Final = "DTWIN_KEY"
"""Environment variable with the key of a cell, in hexadecimal digits."""
KEY_SIZE: Final = 32
"""Bytes of a key."""
UNSIGNED: Final = "unsigned"
"""Reason for the refusal of a message without signature."""
FORGED: Final = "forged"
"""Reason for the refusal of a message with the signature of another key."""
_SENDER: Final = 8
_NUMBER: Final = 8
DIGEST: Final = 16
"""Bytes of a hash."""
_HEAD: Final = _SENDER + _NUMBER
_SIZE: Final = _HEAD + DIGEST
ACQUAINTANCE: Final = 30.0
"""Age of a message, s, up to which its sender may be a new one. A machine that is busy may take its time."""
_REMEMBERED: Final = 256
"""Senders whose last number is remembered; only holders of the key can make a new one."""


def new_key() -> bytes:
    """A key for one run of a cell."""
    return secrets.token_bytes(KEY_SIZE)


def read_key(digits: str, where: str) -> bytes:
    """A key from its hexadecimal digits.

    Raises:
        ParameterError: They are no key; `where` says where they stand.
    """
    try:
        key = bytes.fromhex(digits)
    except ValueError:
        key = b""
    if len(key) != KEY_SIZE:
        raise ParameterError(f"{where}: expected {2 * KEY_SIZE} hexadecimal digits")
    return key


class Signer:
    """Signs the messages of one publisher.

    Args:
        key: The cell's key.
        expression: Key expression of the topic that all its messages belong to.

        clock: Gives the time, ns since 1970.

    Attributes:
        sender: Name of this publisher, by which a subscription knows it.
    """

    def __init__(self, key: bytes, expression: str, clock: Callable[[], int] = time.time_ns) -> None:
        self.sender = secrets.token_bytes(_SENDER)
        self._last = 0
        self._clock = clock
        self._digest = keyed_hash(key, expression)

    def __call__(self, payload: bytes) -> bytes:
        """The attachment for a payload."""
        self._last = max(self._clock(), self._last + 1)
        head = self.sender + self._last.to_bytes(_NUMBER, "big")
        return head + self._digest(head + payload)


class Verifier:
    """Checks the messages of one subscription.

    Args:
        key: The cell's key.
        expression: Key expression of the topic that the messages must have been signed for.
        clock: Gives the time, ns since 1970.
    """

    def __init__(self, key: bytes, expression: str, clock: Callable[[], int] = time.time_ns) -> None:
        self._clock = clock
        self._digest = keyed_hash(key, expression)
        self._last: OrderedDict[bytes, bytes] = OrderedDict()

    def __call__(self, payload: bytes, attachment: bytes | None) -> bytes:
        """The sender of a message.

        Raises:
            MessageError: The message is not signed, is signed with another key, has been received before, or is the
                first of its sender and old.
        """
        if attachment is None or len(attachment) != _SIZE:
            raise MessageError(UNSIGNED, "expected the signature of a service of this cell")
        head = attachment[:_HEAD]
        if not hmac.compare_digest(attachment[_HEAD:], self._digest(head + payload)):
            raise MessageError(FORGED, "expected the signature of a service of this cell, got another one")
        # Numbers of equal length, big-endian, have the order of their bytes.
        sender, number = head[:_SENDER], head[_SENDER:]
        last = self._last.get(sender)
        if last is None:
            self._meet(int.from_bytes(number))
        elif number <= last:
            raise MessageError("replayed", "this message of its sender, or a later one, has been received before")
        self._last[sender] = number
        if len(self._last) > _REMEMBERED:
            self._last.popitem(last=False)
        return sender

    def _meet(self, number: int) -> None:
        """Checks the first message of a sender."""
        away = (self._clock() - number) * 1e-9
        if abs(away) > ACQUAINTANCE:
            raise MessageError("stale", f"{away:.0f} s old: somebody has kept it, or the clocks of machines differ")


def keyed_hash(key: bytes, purpose: str) -> Callable[[bytes], bytes]:
    """The hash of messages under a key and for one purpose; what is the same for every message is hashed once."""
    begun = hashlib.blake2b(purpose.encode() + b"\0", key=key, digest_size=DIGEST)

    def digest(message: bytes) -> bytes:
        hashed = begun.copy()
        hashed.update(message)
        return hashed.digest()

    return digest
