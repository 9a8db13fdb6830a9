"""Messages of IEC 61499 communication blocks: the values of a signature one after another, without framing.

A message is complete when its last value has arrived; one without values is the single byte NULL. How a value is
encoded is in `encoding`. The layer `raw[]` sends one STRING as it is, without tag and length, as 4diac FORTE does.
"""

from __future__ import annotations

import itertools
import struct
from collections.abc import Sequence
from typing import Final, NoReturn, Protocol

from iec61499.errors import CommunicationError
from iec61499.net.encoding import (
    FALSE,
    FIXED,
    STRING_LIMIT,
    TRUE,
    UNITS,
    Incomplete,
    Malformed,
    Value,
    codec,
    decode_null,
)
from iec61499.types import ArrayType, DataType, ElementaryType, StructType

Message = tuple[Value, ...]
_MOST_BOOLS: Final = 6
"""Values of type BOOL in a message that is read at once: every one doubles the number of heads that it may have."""


class FixedLayout:
    """A message all of whose values have the same size whatever they are: it is written and read at once.

    Args:
        types: the values' types, at least one, as `has_fixed_layout` wants them.

    Attributes:
        size: length of the message, bytes.
    """

    def __init__(self, types: Sequence[DataType]) -> None:
        # What is no BOOL has a tag before it; the tag of a BOOL is its value, and nothing stands behind it.
        names = [getattr(kind, "name", "") for kind in types]
        self._bools = [place for place, name in enumerate(names) if name == "BOOL"]
        letters = "".join("B0s" if name == "BOOL" else f"B{FIXED[name][1]}" for name in names)
        heads = [(FALSE, TRUE) if name == "BOOL" else (FIXED[name][0],) for name in names]
        self._tags = {tags: [tags[place] == TRUE for place in self._bools] for tags in itertools.product(*heads)}
        self._blank = [field for tags in heads for field in (tags[0], b"")]
        self._layout = struct.Struct(f">{letters}")
        self.size = self._layout.size

    def encode(self, values: Sequence[Value]) -> bytes:
        """The message's bytes. Raises what `struct` raises when a value does not fit its type."""
        fields = self._blank.copy()
        fields[1::2] = values
        for place in self._bools:
            fields[2 * place : 2 * place + 2] = (TRUE if values[place] else FALSE), b""
        return self._layout.pack(*fields)

    def decode(self, data: bytes) -> Message | None:
        """The values of so many bytes; None if they are not one message."""
        fields = self._layout.unpack(data)
        bools = self._tags.get(fields[::2])
        if bools is None:
            return None
        if not bools:
            return fields[1::2]
        values = list(fields[1::2])
        for place, value in zip(self._bools, bools, strict=True):
            values[place] = value
        return tuple(values)


def has_fixed_layout(types: Sequence[DataType]) -> bool:
    """Whether a message of these types is written and read at once."""
    if any(isinstance(kind, ArrayType | StructType) for kind in types):
        return False
    names = [getattr(kind, "name", "") for kind in types]
    fixed = all(name == "BOOL" or (name in FIXED and name not in UNITS) for name in names)
    return fixed and len(names) > 0 and names.count("BOOL") <= _MOST_BOOLS


class Reader(Protocol):
    """Puts messages of a stream together."""

    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data` completes, oldest first. Raises CommunicationError."""


class Signature:
    """The value types of a message, compiled once; encoding and decoding seven values takes 1 to 2 us each.

    Args:
        types: the values' types, in order; empty for a message that only notifies.
        string_limit: longest string that `decode` and `MessageReader` accept, in bytes (WSTRING: UTF-16 code units).

    Raises:
        CommunicationError: a type has no encoding.
    """

    def __init__(self, types: Sequence[DataType], string_limit: int = STRING_LIMIT) -> None:
        self.types = tuple(types)
        codecs = [codec(type_, string_limit) for type_ in self.types]
        self._encoders = tuple(encoder for encoder, _ in codecs)
        self.decoders = tuple(decoder for _, decoder in codecs) or (decode_null,)
        self.fixed = FixedLayout(self.types) if has_fixed_layout(self.types) else None

    def encode(self, values: Sequence[Value]) -> bytes:
        """The message's bytes.

        Raises:
            CommunicationError: a value is missing, too many, or does not fit its type.
        """
        if len(values) != len(self._encoders):
            raise CommunicationError(f"expected {len(self._encoders)} values to send, got {len(values)}")
        try:
            if self.fixed is not None:
                return self.fixed.encode(values)
            return b"".join([encode(value) for encode, value in zip(self._encoders, values, strict=True)]) or b"\x05"
        except (struct.error, OverflowError, UnicodeError, AttributeError, TypeError):
            self._report_unfit(values)

    def decode(self, data: bytes) -> Message:
        """The values of one whole message, as a datagram holds it.

        Raises:
            CommunicationError: the data are not exactly one message of this signature.
        """
        values = []
        at = 0
        for number, decode in enumerate(self.decoders, 1):
            try:
                value, at = decode(data, at)
            except Incomplete:
                text = f"message ends at byte {len(data)} in value {number} of {len(self.decoders)}"
                raise CommunicationError(text) from None
            values.append(value)
        if at != len(data):
            raise CommunicationError(f"{len(data) - at} bytes follow the message's end at byte {at}")
        return tuple(values) if self.types else ()

    def reader(self) -> Reader:
        """What puts messages of a stream together."""
        return MessageReader(self)

    def _report_unfit(self, values: Sequence[Value]) -> NoReturn:
        for number, (encode, value) in enumerate(zip(self._encoders, values, strict=True), 1):
            try:
                encode(value)
            except (struct.error, OverflowError, UnicodeError, AttributeError, TypeError):
                kind = self.types[number - 1]
                raise CommunicationError(f"value {number} to send: {value!r:.60} is no {kind}") from None
        raise AssertionError("only an encoder can have failed")


class MessageReader:
    """Puts messages of one signature together from a stream cut anywhere.

    It keeps the decoded values of the unfinished message and the bytes of the unfinished value, which the
    signature bounds. After an error the stream has no known place to continue from: drop the connection.
    """

    def __init__(self, signature: Signature) -> None:
        self._decoders = signature.decoders
        self._fixed = signature.fixed
        self._empty = not signature.types
        self._values: list[Value] = []
        self._pending = bytearray()
        self._consumed = 0

    @property
    def idle(self) -> bool:
        """Whether the stream stands between two messages."""
        return not self._values and not self._pending

    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data` completes, oldest first.

        Raises:
            CommunicationError: a tag, length or count that the signature does not have; its offset counts the bytes
                of the unfinished message. Messages completed before it in the same data are lost.
        """
        fixed = self._fixed
        if fixed is not None and len(data) == fixed.size and not self._values and not self._pending:
            message = fixed.decode(data)
            if message is not None:
                return [message]
        stream: bytes | bytearray = data
        if self._pending:
            self._pending += data
            stream = self._pending
        messages: list[Message] = []
        decoders, values = self._decoders, self._values
        at = start = 0
        end = len(stream)
        while at < end:
            try:
                value, at = decoders[len(values)](stream, at)
            except Incomplete:
                break
            except Malformed as error:
                raise CommunicationError(error.describe(self._consumed - start)) from None
            values.append(value)
            if len(values) == len(decoders):
                messages.append(() if self._empty else tuple(values))
                values.clear()
                start = at
                self._consumed = 0
        self._consumed += at - start
        self._pending = bytearray(stream[at:])
        return messages


class RawSignature(Signature):
    """The type of a message that is one text.

    Args:
        types: a STRING; none for a message that a block only sends, or only receives.

    Raises:
        CommunicationError: they are other ones.
    """

    def __init__(self, types: Sequence[DataType]) -> None:
        if len(types) > 1 or any(not isinstance(kind, ElementaryType) or kind.name != "STRING" for kind in types):
            given = ", ".join(map(str, types))
            raise CommunicationError(f"raw[] carries one STRING, not {given}", "TERMINATED")
        super().__init__(types)

    def encode(self, values: Sequence[Value]) -> bytes:
        """The text's bytes. Raises CommunicationError when it is none."""
        if not self.types:
            return b""
        try:
            (text,) = values
            data: bytes = text.encode("latin-1")
        except (AttributeError, UnicodeError, ValueError):
            raise CommunicationError(f"{values!r:.60} is no STRING") from None
        return data

    def decode(self, data: bytes) -> Message:
        """The text of all bytes. Raises CommunicationError when it is too long."""
        if not self.types:
            return ()
        if len(data) > STRING_LIMIT:
            raise CommunicationError(f"text of {len(data)} bytes: expected at most {STRING_LIMIT}")
        return (data.decode("latin-1"),)

    def reader(self) -> Reader:
        """What puts messages of a stream together: what comes at once is one."""
        return RawReader(self)


class RawReader:
    """Takes every part of a stream, as it comes, for a message: there is no sign of where one ends."""

    def __init__(self, signature: RawSignature) -> None:
        self._signature = signature

    def feed(self, data: bytes) -> list[Message]:
        """The message that the data are."""
        return [self._signature.decode(data)]
