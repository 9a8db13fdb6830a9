"""The wire format of IEC 61499 communication blocks: typed values, big-endian, without framing.

The encoding is that of the compliance profile for feasibility demonstrations (ASN.1, ISO/IEC 8825), which
function-block development kits and 4diac FORTE speak over TCP and UDP: every value is one tag byte and its data.
A BOOL is its tag alone; a STRING has a 16-bit length in bytes, a WSTRING in UTF-16 code units; an ARRAY has a
16-bit element count, then the elements' tag once, then their data (BOOL elements are a tag each); a TIME is
counted in microseconds. A message is the values of a signature one after another; it is complete when the last
has arrived. A message without values is the single byte NULL.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, Final, NoReturn

from dtwin.errors import CommunicationError
from dtwin.iec61499.types import ArrayType, DataType, ElementaryType, StructType

Value = Any
"""A value as the runtime holds it: bool, int, float, str, or a list of those; TIME in ns."""
Message = tuple[Value, ...]

NULL: Final = 0x05
ARRAY: Final = 0x76
FALSE: Final = 0x40
TRUE: Final = 0x41
FIXED: Final = {
    "SINT": (0x42, "b"),
    "INT": (0x43, "h"),
    "DINT": (0x44, "i"),
    "LINT": (0x45, "q"),
    "USINT": (0x46, "B"),
    "UINT": (0x47, "H"),
    "UDINT": (0x48, "I"),
    "ULINT": (0x49, "Q"),
    "REAL": (0x4A, "f"),
    "LREAL": (0x4B, "d"),
    "TIME": (0x4C, "q"),
    "BYTE": (0x51, "B"),
    "WORD": (0x52, "H"),
    "DWORD": (0x53, "I"),
    "LWORD": (0x54, "Q"),
}
"""Tag and struct format of the types whose data have a fixed size."""
TEXTS: Final = {"STRING": (0x50, "latin-1", 1), "WSTRING": (0x55, "utf-16-be", 2)}
"""Tag, encoding and bytes of a code unit of the types whose data have their own length."""
TAG_NAMES: Final = {
    NULL: "null",
    FALSE: "BOOL",
    TRUE: "BOOL",
    ARRAY: "ARRAY",
    **{tag: name for name, (tag, *_) in (FIXED | TEXTS).items()},
}
STRING_LIMIT: Final = 16384
"""Longest string taken from a peer, in bytes (WSTRING: code units), unless a signature says otherwise."""

_length = struct.Struct(">H")

Encoder = Callable[[Value], bytes]
Decoder = Callable[[bytes | bytearray, int], tuple[Value, int]]


class _Incomplete(Exception):
    """The data end before the value does."""


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
        codecs = [_codec(type_, string_limit) for type_ in self.types]
        self._encoders = tuple(encoder for encoder, _ in codecs)
        self.decoders = tuple(decoder for _, decoder in codecs) or (_decode_null,)

    def encode(self, values: Sequence[Value]) -> bytes:
        """The message's bytes.

        Raises:
            CommunicationError: a value is missing, too many, or does not fit its type.
        """
        if len(values) != len(self._encoders):
            raise CommunicationError(f"expected {len(self._encoders)} values to send, got {len(values)}")
        try:
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
            except _Incomplete:
                text = f"message ends at byte {len(data)} in value {number} of {len(self.decoders)}"
                raise CommunicationError(text) from None
            values.append(value)
        if at != len(data):
            raise CommunicationError(f"{len(data) - at} bytes follow the message's end at byte {at}")
        return tuple(values) if self.types else ()

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
            except _Incomplete:
                break
            except _Malformed as error:
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


class _Malformed(CommunicationError):
    """Data that nothing which follows could make valid."""

    def __init__(self, offset: int, complaint: str) -> None:
        super().__init__(f"byte {offset}: {complaint}")
        self._offset = offset
        self._complaint = complaint

    def describe(self, shift: int) -> str:
        return f"byte {self._offset + shift}: {self._complaint}"


def _codec(kind: DataType, string_limit: int) -> tuple[Encoder, Decoder]:
    if isinstance(kind, ArrayType):
        return _array_codec(kind, string_limit)
    if isinstance(kind, StructType):
        raise CommunicationError(f"structure {kind} has no encoding for communication blocks: expected its members")
    if kind.name == "BOOL":
        return _encode_bool, _decode_bool
    if kind.name in TEXTS:
        return _tagged(TEXTS[kind.name][0], *_text_body(kind.name, string_limit))
    if kind.name not in FIXED:
        raise CommunicationError(f"{kind.name} has no encoding for communication blocks")
    return _fixed_codec(kind.name)


def _fixed_codec(name: str) -> tuple[Encoder, Decoder]:
    tag, letter = FIXED[name]
    layout = struct.Struct(f">B{letter}")
    pack, unpack, size = layout.pack, layout.unpack_from, layout.size

    def encode(value: Value) -> bytes:
        return pack(tag, value)

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        try:
            seen, value = unpack(data, at)
        except struct.error:
            _expect_tag(data, at, tag)
            raise _Incomplete from None
        if seen != tag:
            _expect_tag(data, at, tag)
        return value, at + size

    return (encode, decode) if name != "TIME" else _scaled(encode, decode)


def _fixed_body(name: str) -> tuple[Encoder, Decoder]:
    layout = struct.Struct(f">{FIXED[name][1]}")

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        if len(data) < at + layout.size:
            raise _Incomplete
        return layout.unpack_from(data, at)[0], at + layout.size

    return (layout.pack, decode) if name != "TIME" else _scaled(layout.pack, decode)


def _scaled(encode: Encoder, decode: Decoder) -> tuple[Encoder, Decoder]:
    """A TIME's ns as the wire's us."""

    def encode_time(value: Value) -> bytes:
        return encode(_microseconds(value))

    def decode_time(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        value, at = decode(data, at)
        return value * 1000, at

    return encode_time, decode_time


def _microseconds(nanoseconds: int) -> int:
    """Cut towards zero, as C divides."""
    return nanoseconds // 1000 if nanoseconds >= 0 else -(-nanoseconds // 1000)


def _encode_bool(value: Value) -> bytes:
    return b"\x41" if value else b"\x40"


def _decode_bool(data: bytes | bytearray, at: int) -> tuple[Value, int]:
    if at >= len(data):
        raise _Incomplete
    tag = data[at]
    if tag not in (FALSE, TRUE):
        raise _Malformed(at, f"expected tag 0x40 or 0x41 (BOOL), got {_tag_name(tag)}")
    return tag == TRUE, at + 1


def _decode_null(data: bytes | bytearray, at: int) -> tuple[Value, int]:
    if at >= len(data):
        raise _Incomplete
    _expect_tag(data, at, NULL)
    return None, at + 1


def _tagged(tag: int, encode_body: Encoder, decode_body: Decoder) -> tuple[Encoder, Decoder]:
    prefix = bytes((tag,))

    def encode(value: Value) -> bytes:
        return prefix + encode_body(value)

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        if at >= len(data):
            raise _Incomplete
        _expect_tag(data, at, tag)
        return decode_body(data, at + 1)

    return encode, decode


def _text_body(name: str, limit: int) -> tuple[Encoder, Decoder]:
    _, encoding, unit = TEXTS[name]

    def encode(value: Value) -> bytes:
        body = value.encode(encoding)
        return _length.pack(len(body) // unit) + body

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        length, begin = _read_length(data, at)
        if length > limit:
            raise _Malformed(at, f"{name} of length {length}, expected at most {limit}")
        end = begin + unit * length
        if len(data) < end:
            raise _Incomplete
        try:
            return str(data[begin:end], encoding), end
        except UnicodeDecodeError:
            raise _Malformed(begin, f"expected {name} in {encoding.upper()}, got other bytes") from None

    return encode, decode


def _array_codec(kind: ArrayType, string_limit: int) -> tuple[Encoder, Decoder]:
    element, count = kind.element, kind.length
    if not isinstance(element, ElementaryType):
        raise CommunicationError(f"{kind} has no encoding for communication blocks: expected one dimension")
    tag = None
    encode_one: Encoder = _encode_bool
    decode_one: Decoder = _decode_bool
    if element.name in TEXTS:
        tag = TEXTS[element.name][0]
        encode_one, decode_one = _text_body(element.name, string_limit)
    elif element.name in FIXED:
        tag = FIXED[element.name][0]
        encode_one, decode_one = _fixed_body(element.name)
    elif element.name != "BOOL":
        raise CommunicationError(f"{element.name} has no encoding for communication blocks")
    prefix = _length.pack(count) + (b"" if tag is None else bytes((tag,)))

    def encode(value: Value) -> bytes:
        if len(value) != count:
            raise TypeError
        return prefix + b"".join(map(encode_one, value))

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        length, begin = _read_length(data, at)
        if length != count:
            raise _Malformed(at, f"ARRAY of {length} elements, expected {count}")
        at = begin
        if tag is not None:
            if at >= len(data):
                raise _Incomplete
            _expect_tag(data, at, tag)
            at += 1
        values = []
        for _ in range(count):
            one, at = decode_one(data, at)
            values.append(one)
        return values, at

    return _tagged(ARRAY, encode, decode)


def _read_length(data: bytes | bytearray, at: int) -> tuple[int, int]:
    if len(data) < at + 2:
        raise _Incomplete
    return _length.unpack_from(data, at)[0], at + 2


def _expect_tag(data: bytes | bytearray, at: int, tag: int) -> None:
    if at < len(data) and data[at] != tag:
        raise _Malformed(at, f"expected tag 0x{tag:02X} ({TAG_NAMES[tag]}), got {_tag_name(data[at])}")


def _tag_name(tag: int) -> str:
    return f"0x{tag:02X} ({TAG_NAMES[tag]})" if tag in TAG_NAMES else f"0x{tag:02X}"
