"""Who is there: liveliness tokens, which in a cell with a key carry a proof in their own key.

A token has no payload. With the cell's key, `/` and a proof follow its key: a nonce (8 bytes) and a keyed BLAKE2b
hash of the key expression and the nonce (16 bytes), in hexadecimal digits. Whoever copies a token can keep it alive
after its service has gone; nobody can announce a service that was never there.
"""

from __future__ import annotations

import hmac
import secrets
import threading
from collections.abc import Callable
from typing import Any, Final

from dtwin.bus.codec import MessageError
from dtwin.bus.signature import DIGEST, FORGED, UNSIGNED, keyed_hash

_NONCE: Final = 8


def token(expression: str, key: bytes | None) -> str:
    """The key of a new liveliness token of a service.

    Args:
        expression: key expression of the service's tokens.
        key: the cell's key, if it has one.
    """
    if key is None:
        return expression
    nonce = secrets.token_bytes(_NONCE)
    return f"{expression}/{(nonce + _hash(key, expression)(nonce)).hex()}"


class Presence:
    """Tells of services that come and go.

    Args:
        prefix: what all tokens begin with, before the name of the service.
        key: the cell's key, if it has one.
        receive: called with the name of a service and whether it is there, whenever another token of it is there and
            when its last one has gone.
    """

    def __init__(self, prefix: str, key: bytes | None, receive: Callable[[str, bool], Any]) -> None:
        self._prefix = prefix
        self._key = key
        self._receive = receive
        self._proofs: dict[str, set[str]] = {}
        self._lock = threading.Lock()

    def update(self, expression: str, alive: bool) -> None:
        """Takes note of a token that has come or gone.

        Raises:
            MessageError: it was not made with the key of this cell.
        """
        service, _, proof = expression.removeprefix(self._prefix).partition("/")
        if self._key is not None:
            self._check(self._key, service, proof)
        with self._lock:
            proofs = self._proofs.setdefault(service, set())
            if alive:
                proofs.add(proof)
            else:
                proofs.discard(proof)
                if proofs:
                    return
        self._receive(service, alive)

    def _check(self, key: bytes, service: str, proof: str) -> None:
        try:
            sealed = bytes.fromhex(proof)
        except ValueError:
            sealed = b""
        if len(sealed) != _NONCE + DIGEST:
            raise MessageError(UNSIGNED, f"a token of {service} without the proof of this cell")
        nonce, digest = sealed[:_NONCE], sealed[_NONCE:]
        if not hmac.compare_digest(digest, _hash(key, self._prefix + service)(nonce)):
            raise MessageError(FORGED, f"a token of {service} with the proof of another cell")


def _hash(key: bytes, expression: str) -> Callable[[bytes], bytes]:
    return keyed_hash(key, f"token {expression}")
