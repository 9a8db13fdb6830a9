"""Requests that act once and in time, and replies that belong to them: what both carry beside their payload.

The attachment of a request is a nonce (16 bytes), a challenge (16 bytes) and a hash of both and the payload. The
challenge is one that the answerer gave shortly before, or zeros for none: such a request does nothing but fetch one.
The attachment of a reply is its kind (1 byte), the challenge for the next request (16 bytes), and a hash of the hash
of its request, both and the payload. Each hash is BLAKE2b (RFC 7693, keyed mode, 16 bytes), begun with the word
request or reply and the key expression, so that nothing counts as anything else.
"""

from __future__ import annotations

import hmac
import math
import secrets
import time
from collections.abc import Callable
from enum import IntEnum
from typing import Final, NamedTuple

from dtwin.bus.codec import MessageError
from dtwin.bus.signature import DIGEST, FORGED, UNSIGNED, keyed_hash

NO_CHALLENGE: Final = bytes(16)
"""In the place of a challenge in a request for one."""
_LIFE: Final = 8
_SIZE: Final = 16
_REQUEST: Final = 2 * _SIZE + DIGEST
_REPLY: Final = 1 + _SIZE + DIGEST
_EXPECTED: Final = "expected the signature of this cell"


class Kind(IntEnum):
    """What a reply is: the answer, a refusal in words, or the challenge without which nothing is done."""

    ANSWER = 0
    REFUSAL = 1
    CHALLENGE = 2


class Opened(NamedTuple):
    """A reply that belongs to its request: its kind, the challenge for the next request, and its payload."""

    kind: Kind
    challenge: bytes
    payload: bytes


class Asking:
    """Signs the requests of one key expression and checks the replies.

    Args:
        key: The cell's key.
        expression: Key expression that is asked.
    """

    def __init__(self, key: bytes, expression: str) -> None:
        self._request = keyed_hash(key, f"request {expression}")
        self._reply = keyed_hash(key, f"reply {expression}")

    def request(self, payload: bytes, challenge: bytes) -> bytes:
        """The attachment of a new request."""
        head = secrets.token_bytes(_SIZE) + challenge
        return head + self._request(head + payload)

    def open(self, request: bytes, payload: bytes, attachment: bytes | None) -> Opened:
        """A reply to the request with that attachment.

        Raises:
            MessageError: The reply is not signed, or not by this cell, or belongs to another request.
        """
        if attachment is None or len(attachment) != _REPLY:
            raise MessageError(UNSIGNED, _EXPECTED)
        head = attachment[:-DIGEST]
        if not hmac.compare_digest(attachment[-DIGEST:], self._reply(request[-DIGEST:] + head + payload)):
            raise MessageError(FORGED, f"{_EXPECTED} and the answer to this very request, got another one")
        return Opened(Kind(head[0]), head[1:], payload)


class Answering:
    """Checks the requests of one key expression and signs the replies.

    Args:
        key: The cell's key.
        expression: Key expression that is answered.
        clock: Gives a time that only grows, ns.
    """

    def __init__(self, key: bytes, expression: str, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._request = keyed_hash(key, f"request {expression}")
        self._reply = keyed_hash(key, f"reply {expression}")
        self._life = secrets.token_bytes(_LIFE)
        self._clock = clock

    def open(self, payload: bytes, attachment: bytes | None) -> tuple[bytes, bytes]:
        """The hash of a request, which is its name, and its challenge.

        Raises:
            MessageError: The request is not signed, or not with the key of this cell.
        """
        if attachment is None or len(attachment) != _REQUEST:
            raise MessageError(UNSIGNED, f"{_EXPECTED}: only who has its key may ask for that")
        if not hmac.compare_digest(attachment[-DIGEST:], self._request(attachment[:-DIGEST] + payload)):
            raise MessageError(FORGED, f"{_EXPECTED}, got another one")
        return attachment[-DIGEST:], attachment[_SIZE:-DIGEST]

    def age(self, challenge: bytes) -> float:
        """Time since a challenge was given, s; infinite for one that this answerer has not given."""
        if challenge[:_LIFE] != self._life:
            return math.inf
        return (self._clock() - int.from_bytes(challenge[_LIFE:])) * 1e-9

    def attachment(self, request: bytes, kind: Kind, payload: bytes) -> bytes:
        """The attachment of a reply to the request of that name."""
        head = bytes((kind,)) + self._life + self._clock().to_bytes(_SIZE - _LIFE)
        return head + self._reply(request + head + payload)
