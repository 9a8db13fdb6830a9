"""Who sent a message: a keyed hash beside it, which only those who know the cell's key can make.

The attachment is the sender (8 bytes), a number (8 bytes, big-endian), and the BLAKE2b hash of key expression,
sender, number and payload (RFC 7693, keyed mode, 16 bytes). A sender is one publisher; its numbers grow from 1, so
that a message counts once.
"""

from __future__ import annotations

import hashlib
import hmac
import itertools
import secrets
from collections import OrderedDict
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
_SIZE: Final = _SENDER + _NUMBER + _DIGEST
_REMEMBERED: Final = 256
"""Senders whose last number is remembered; only holders of the key can make a new one."""


def new_key() -> bytes:
    """A key for one run of a cell."""
    return secrets.token_bytes(KEY_SIZE)


class Signer:
    """Signs the messages of one publisher.

    Args:
        key: The cell's key.

    Attributes:
        sender: Name of this publisher, by which a subscription knows it.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self.sender = secrets.token_bytes(_SENDER)
        self._numbers = itertools.count(1)

    def __call__(self, expression: str, payload: bytes) -> bytes:
        """The attachment for a payload that goes out under a key expression."""
        head = self.sender + next(self._numbers).to_bytes(_NUMBER, "big")
        return head + _digest(self._key, expression, head, payload)


class Verifier:
    """Checks the messages of one subscription.

    Args:
        key: The cell's key.
    """

    def __init__(self, key: bytes) -> None:
        self._key = key
        self._last: OrderedDict[bytes, int] = OrderedDict()

    def __call__(self, expression: str, payload: bytes, attachment: bytes | None) -> bytes:
        """The sender of a message.

        Raises:
            MessageError: The message is not signed, is signed with another key, or has been received before.
        """
        if attachment is None or len(attachment) != _SIZE:
            raise MessageError(UNSIGNED, "expected the signature of a service of this cell")
        head, digest = attachment[: _SENDER + _NUMBER], attachment[_SENDER + _NUMBER :]
        if not hmac.compare_digest(digest, _digest(self._key, expression, head, payload)):
            raise MessageError(FORGED, "expected the signature of a service of this cell, got another one")
        sender, number = head[:_SENDER], int.from_bytes(head[_SENDER:], "big")
        if number <= self._last.get(sender, 0):
            raise MessageError("replayed", f"message {number} of its sender has been received before")
        self._last[sender] = number
        if len(self._last) > _REMEMBERED:
            self._last.popitem(last=False)
        return sender


def _digest(key: bytes, expression: str, head: bytes, payload: bytes) -> bytes:
    return hashlib.blake2b(b"\0".join((expression.encode(), head, payload)), key=key, digest_size=_DIGEST).digest()
