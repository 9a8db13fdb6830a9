"""How a value travels between communication blocks: a tag and big-endian data.

The encoding is that of the compliance profile for feasibility demonstrations (ASN.1, ISO/IEC 8825), as 4diac FORTE
has it. A BOOL is its tag alone; a STRING has a 16-bit length in bytes, a WSTRING in UTF-16 code units. An ARRAY has a
16-bit element count, then the elements' tag once, then their data; a structure has the data of its members one after
another. BOOL elements and members are a tag each. A TIME is counted in microseconds, a date in milliseconds. An
enumeration, for which FORTE has no data, is the UINT of its place.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Any, Final

from iec61499.errors import CommunicationError
from iec61499.types import ArrayType, DataType, ElementaryType, StructType

Value = Any
"""A value as the runtime holds it: bool, int, float, str, or a list of those; times and dates in ns."""

NULL: Final = 0x05
ARRAY: Final = 0x76
STRUCT: Final = 0x61
"""Tag that 4diac IDE gives every structure."""
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
    "DATE": (0x4D, "q"),
    "TOD": (0x4E, "q"),
    "DT": (0x4F, "q"),
    "BYTE": (0x51, "B"),
    "WORD": (0x52, "H"),
    "DWORD": (0x53, "I"),
    "LWORD": (0x54, "Q"),
}
"""Tag and struct format of the types whose data have a fixed size."""
UNITS: Final = {"TIME": 1_000, **dict.fromkeys(("DATE", "TOD", "DT"), 1_000_000)}
"""What the data of times and dates count, ns."""
TEXTS: Final = {"STRING": (0x50, "latin-1", 1), "WSTRING": (0x55, "utf-16-be", 2)}
"""Tag, encoding and bytes of a code unit of the types whose data have their own length."""
TAG_NAMES: Final = {
    NULL: "null",
    FALSE: "BOOL",
    TRUE: "BOOL",
    ARRAY: "ARRAY",
    STRUCT: "structure",
    **{tag: name for name, (tag, *_) in (FIXED | TEXTS).items()},
}
STRING_LIMIT: Final = 16384
"""Longest string taken from a peer, in bytes (WSTRING: code units), unless a signature says otherwise."""
CUT: Final = 1_500
"""Most bytes that an array may lose when it is cut: a FORTE with its standard settings takes no longer message."""

_length = struct.Struct(">H")

Encoder = Callable[[Value], bytes]
Decoder = Callable[[bytes | bytearray, int], tuple[Value, int]]


class Incomplete(Exception):
    """The data end before the value does."""


class Malformed(CommunicationError):
    """Data that nothing which follows could make valid."""

    def __init__(self, offset: int, complaint: str) -> None:
        super().__init__(f"byte {offset}: {complaint}")
        self._offset = offset
        self._complaint = complaint

    def describe(self, shift: int) -> str:
        return f"byte {self._offset + shift}: {self._complaint}"


def codec(kind: DataType, string_limit: int) -> tuple[Encoder, Decoder]:
    """What encodes and decodes a value with its tag.

    An array that arrives with more elements than it has is cut. One that arrives with fewer is a shorter list: the
    receiver keeps its others.

    Raises:
        CommunicationError: the type has no encoding.
    """
    if not isinstance(kind, ArrayType | StructType) and kind.name in FIXED:
        return _fixed_codec(kind.name)
    tag, encode, decode = _body(kind, string_limit)
    return (encode, decode) if tag is None else _tagged(tag, encode, decode)


def _body(kind: DataType, string_limit: int) -> tuple[int | None, Encoder, Decoder]:
    """The tag of a type, and what encodes and decodes the data behind it; a BOOL has no tag before its data."""
    if isinstance(kind, ArrayType):
        return ARRAY, *_array_body(kind, string_limit)
    if isinstance(kind, StructType):
        return STRUCT, *_structure_body(kind, string_limit)
    if kind.name == "BOOL":
        return None, _encode_bool, _decode_bool
    if kind.name in TEXTS:
        return TEXTS[kind.name][0], *_text_body(kind.name, string_limit)
    if kind.name in FIXED:
        return FIXED[kind.name][0], *_fixed_body(kind.name)
    if kind.kind == "enum":
        return FIXED["UINT"][0], *_enumeration_body(kind)
    raise CommunicationError(f"{kind.name} has no encoding for communication blocks")


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
            raise Incomplete from None
        if seen != tag:
            _expect_tag(data, at, tag)
        return value, at + size

    return _scaled(encode, decode, UNITS[name]) if name in UNITS else (encode, decode)


def _fixed_body(name: str) -> tuple[Encoder, Decoder]:
    layout = struct.Struct(f">{FIXED[name][1]}")

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        if len(data) < at + layout.size:
            raise Incomplete
        return layout.unpack_from(data, at)[0], at + layout.size

    return _scaled(layout.pack, decode, UNITS[name]) if name in UNITS else (layout.pack, decode)


def _enumeration_body(kind: ElementaryType) -> tuple[Encoder, Decoder]:
    encode, decode_place = _fixed_body("UINT")

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        place, end = decode_place(data, at)
        if place > kind.maximum:
            raise Malformed(at, f"value {place} of {kind}: expected 0 to {kind.maximum}")
        return place, end

    return encode, decode


def _scaled(encode: Encoder, decode: Decoder, unit: int) -> tuple[Encoder, Decoder]:
    """The ns of a time or date as the wire's units."""

    def encode_scaled(value: Value) -> bytes:
        # cut towards zero, as C divides
        return encode(value // unit if value >= 0 else -(-value // unit))

    def decode_scaled(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        value, at = decode(data, at)
        return value * unit, at

    return encode_scaled, decode_scaled


def _encode_bool(value: Value) -> bytes:
    return b"\x41" if value else b"\x40"


def _decode_bool(data: bytes | bytearray, at: int) -> tuple[Value, int]:
    if at >= len(data):
        raise Incomplete
    tag = data[at]
    if tag not in (FALSE, TRUE):
        raise Malformed(at, f"expected tag 0x40 or 0x41 (BOOL), got {_tag_name(tag)}")
    return tag == TRUE, at + 1


def decode_null(data: bytes | bytearray, at: int) -> tuple[Value, int]:
    """Reads what a message without values is."""
    if at >= len(data):
        raise Incomplete
    _expect_tag(data, at, NULL)
    return None, at + 1


def _tagged(tag: int, encode_body: Encoder, decode_body: Decoder) -> tuple[Encoder, Decoder]:
    prefix = bytes((tag,))

    def encode(value: Value) -> bytes:
        return prefix + encode_body(value)

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        if at >= len(data):
            raise Incomplete
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
            raise Malformed(at, f"{name} of length {length}, expected at most {limit}")
        end = begin + unit * length
        if len(data) < end:
            raise Incomplete
        try:
            return str(data[begin:end], encoding), end
        except UnicodeDecodeError:
            raise Malformed(begin, f"expected {name} in {encoding.upper()}, got other bytes") from None

    return encode, decode


def _array_body(kind: ArrayType, string_limit: int) -> tuple[Encoder, Decoder]:
    count = kind.length
    tag, encode_one, decode_one = _body(kind.element, string_limit)
    prefix = _length.pack(count) + (b"" if tag is None else bytes((tag,)))

    def encode(value: Value) -> bytes:
        if len(value) != count:
            raise TypeError
        return prefix + b"".join(map(encode_one, value))

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        length, begin = _read_length(data, at)
        start, at = at, begin
        if tag is not None and length:
            if at >= len(data):
                raise Incomplete
            _expect_tag(data, at, tag)
            at += 1
        values = []
        for _ in range(min(length, count)):
            one, at = decode_one(data, at)
            values.append(one)
        surplus = at
        for _ in range(count, length):
            _, at = decode_one(data, at)
            if at - surplus > CUT:
                raise Malformed(start, f"ARRAY of {length} elements: expected {count}, or {CUT} bytes more")
        return values, at

    return encode, decode


def _structure_body(kind: StructType, string_limit: int) -> tuple[Encoder, Decoder]:
    bodies = [_body(member.type, string_limit) for member in kind.members]
    encoders = [encode for _, encode, _ in bodies]
    decoders = [decode for _, _, decode in bodies]

    def encode(value: Value) -> bytes:
        if len(value) != len(encoders):
            raise TypeError
        return b"".join([encode_one(one) for encode_one, one in zip(encoders, value, strict=True)])

    def decode(data: bytes | bytearray, at: int) -> tuple[Value, int]:
        values = []
        for decode_one in decoders:
            one, at = decode_one(data, at)
            values.append(one)
        return values, at

    return encode, decode


def _read_length(data: bytes | bytearray, at: int) -> tuple[int, int]:
    if len(data) < at + 2:
        raise Incomplete
    return _length.unpack_from(data, at)[0], at + 2


def _expect_tag(data: bytes | bytearray, at: int, tag: int) -> None:
    if at < len(data) and data[at] != tag:
        raise Malformed(at, f"expected tag 0x{tag:02X} ({TAG_NAMES[tag]}), got {_tag_name(data[at])}")


def _tag_name(tag: int) -> str:
    return f"0x{tag:02X} ({TAG_NAMES[tag]})" if tag in TAG_NAMES else f"0x{tag:02X}"
