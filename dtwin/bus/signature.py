"""Who sent a message: a keyed hash beside it, which only those who know the cell's key can make.

The attachment is the sender (8 bytes), a number (8 bytes, big-endian), and the BLAKE2b hash of the topic's key
expression, sender, number and payload (RFC 7693, keyed mode, 16 bytes). A sender is one publisher; its numbers grow
from 1, so that a message counts once.
"""

from __future__ import annotations

import hashlib
import hmac
import itertools
import secrets
from collections import OrderedDict
from collections.abc import Callable
from typing import Final

from dtwin.bus.codec import MessageError

KEY_SIZE: Final = 32
"""Bytes of a key."""
UNSIGNED: Final = "unsigned"
"""Reason for the refusal of a message without signature."""
FORGED: Final = "forged"
"""Reason for the refusal of a message with the signature of another key."""
_SENDER: Final = 8
_NUMBER: Final = 8
_DIGEST: Final = 16
_HEAD: Final = _SENDER + _NUMBER
_SIZE: Final = _HEAD + _DIGEST
_REMEMBERED: Final = 256
"""Senders whose last number is remembered; only holders of the key can make a new one."""


def new_key() -> bytes:
    """A key for one run of a cell."""
    return secrets.token_bytes(KEY_SIZE)


class Signer:
    """Signs the messages of one publisher.

    Args:
        key: The cell's key.
        expression: Key expression of the topic that all its messages belong to.

    Attributes:
        sender: Name of this publisher, by which a subscription knows it.
    """

    def __init__(self, key: bytes, expression: str) -> None:
        self.sender = secrets.token_bytes(_SENDER)
        self._numbers = itertools.count(1)
        self._digest = _keyed(key, expression)

    def __call__(self, payload: bytes) -> bytes:
        """The attachment for a payload."""
        head = self.sender + next(self._numbers).to_bytes(_NUMBER, "big")
        return head + self._digest(head + payload)


class Verifier:
    """Checks the messages of one subscription.

    Args:
        key: The cell's key.
        expression: Key expression of the topic that the messages must have been signed for.
    """

    def __init__(self, key: bytes, expression: str) -> None:
        self._digest = _keyed(key, expression)
        self._last: OrderedDict[bytes, bytes] = OrderedDict()

    def __call__(self, payload: bytes, attachment: bytes | None) -> bytes:
        """The sender of a message.

        Raises:
            MessageError: The message is not signed, is signed with another key, or has been received before.
        """
        if attachment is None or len(attachment) != _SIZE:
            raise MessageError(UNSIGNED, "expected the signature of a service of this cell")
        head = attachment[:_HEAD]
        if not hmac.compare_digest(attachment[_HEAD:], self._digest(head + payload)):
            raise MessageError(FORGED, "expected the signature of a service of this cell, got another one")
        # Numbers of equal length, big-endian, have the order of their bytes.
        sender, number = head[:_SENDER], head[_SENDER:]
        if number <= self._last.get(sender, b""):
            raise MessageError("replayed", f"message {int.from_bytes(number)} of its sender has been received before")
        self._last[sender] = number
        if len(self._last) > _REMEMBERED:
            self._last.popitem(last=False)
        return sender


def _keyed(key: bytes, expression: str) -> Callable[[bytes], bytes]:
    """The digest of head and payload in a topic; what is the same for every message is hashed once."""
    begun = hashlib.blake2b(expression.encode() + b"\0", key=key, digest_size=_DIGEST)

    def digest(message: bytes) -> bytes:
        hashed = begun.copy()
        hashed.update(message)
        return hashed.digest()

    return digest
