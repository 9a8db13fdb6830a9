"""Messages as bytes: JSON with a schema version, bounded and checked on receipt."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, Generic, TypeVar

import msgspec

from dtwin.errors import CommunicationError
from dtwin.signals import SCHEMA

SIZE_LIMIT: Final = 65536
"""Length of the longest message, bytes; longer ones are refused before they are decoded."""

M = TypeVar("M", bound=msgspec.Struct)
D = TypeVar("D")


class MessageError(CommunicationError):
    """Reports that a message is refused; `reason` is the short name under which refusals are counted."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason


def decoded(decode: Callable[[bytes], D], payload: bytes) -> D:
    """What a decoder makes of a message.

    Raises:
        MessageError: it is too long or no JSON, or a field is missing or out of range.
    """
    if len(payload) > SIZE_LIMIT:
        raise MessageError("too long", f"expected at most {SIZE_LIMIT} bytes, got {len(payload)}")
    try:
        return decode(payload)
    except msgspec.ValidationError as error:
        raise MessageError("invalid", str(error)) from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise MessageError("malformed", str(error)) from None
    except RecursionError:
        raise MessageError("malformed", "nested too deeply") from None


class _Unversioned(msgspec.Struct, frozen=True, tag_field="schema", tag=0):
    """A message of schema version 0, which was never used: in a union with it, msgspec demands a version."""


class Reader(Generic[M]):
    """Decodes and checks messages of one type.

    Args:
        message: type of the messages.
    """

    def __init__(self, message: type[M]) -> None:
        self._message = message
        self._decode = msgspec.json.Decoder(message | _Unversioned).decode
        self._strict = message.__struct_config__.forbid_unknown_fields

    def __call__(self, payload: bytes) -> M:
        """Decodes one message.

        Raises:
            MessageError: it is too long, no JSON or of another version, or a field is missing or out of range, or not
                one of a message that is refused with others.
        """
        found = decoded(self._decode, payload)
        if type(found) is not self._message:
            raise MessageError("invalid", f"expected schema {SCHEMA}, got 0")
        message: M = found
        # The decoder refuses unknown fields of the message itself, not those of the values in it.
        if self._strict:
            for field in _unknown_fields(msgspec.json.decode(payload), msgspec.to_builtins(message)):
                raise MessageError("invalid", f"Object contains unknown field {field}")
        return message


def _unknown_fields(given: Any, known: Any, at: str = "$") -> Iterator[str]:
    """Names of the fields that were given but are not known, and where.

    Args:
        given: a message as it came, or a part of it.
        known: the same with all of the fields that it can have, and no others.
        at: path of the part.
    """
    if isinstance(given, dict) and isinstance(known, dict):
        yield from (f"`{name}` - at `{at}`" for name in given if name not in known)
        pairs = [(f"{at}.{name}", given[name], known[name]) for name in given if name in known]
    elif isinstance(given, list) and isinstance(known, list | tuple):
        pairs = [(f"{at}[...]", *pair) for pair in zip(given, known, strict=False)]
    else:
        return
    for inside, part, parts in pairs:
        yield from _unknown_fields(part, parts, inside)


encode: Final = msgspec.json.Encoder().encode
"""Encodes a message as bytes."""
