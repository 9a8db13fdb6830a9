"""The wire format: golden bytes, every split and join, and what is refused."""

from __future__ import annotations

import math
import random
import struct
import tracemalloc
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import CommunicationError
from iec61499.net.encoding import CUT, FIXED, UNITS
from iec61499.net.wire import MessageReader, Signature
from iec61499.types import (
    BOOL,
    ELEMENTARY,
    INT,
    LTIME,
    STRING,
    ArrayType,
    DataType,
    ElementaryType,
    Member,
    StructType,
    elementary,
)

WITHOUT_TAG = ("LTIME", "LDATE", "LTOD", "LDT", "CHAR", "WCHAR")
ENCODABLE = [kind for kind in ELEMENTARY.values() if kind.name not in WITHOUT_TAG]


def signature(*names: str, **options: int) -> Signature:
    return Signature([elementary(name) for name in names], **options)


def trickle(reader: MessageReader, data: bytes) -> list[list[Any]]:
    return [reader.feed(data[i : i + 1]) for i in range(len(data))]


def values_of(kind: DataType) -> st.SearchStrategy[Any]:
    if isinstance(kind, ArrayType):
        return st.lists(values_of(kind.element), min_size=kind.length, max_size=kind.length)
    if isinstance(kind, StructType):
        return st.tuples(*[values_of(member.type) for member in kind.members]).map(list)
    assert isinstance(kind, ElementaryType)
    if kind.kind == "bool":
        return st.booleans()
    if kind.kind == "real":
        return st.floats(allow_nan=False, width=32 if kind.bits == 32 else 64)
    if kind.name == "STRING":
        return st.text(st.characters(max_codepoint=255), max_size=40)
    if kind.name == "WSTRING":
        return st.text(st.characters(exclude_categories=["Cs"]), max_size=40)
    if kind.name in UNITS:
        unit = UNITS[kind.name]
        return st.integers(-(2**63) // unit + 1, 2**63 // unit - 1).map(lambda count: count * unit)
    return st.integers(kind.minimum, kind.maximum)


elements = st.sampled_from(ENCODABLE)


def structure(kinds: list[DataType]) -> StructType:
    return StructType("S", tuple(Member(f"M{i}", kind, kind.default) for i, kind in enumerate(kinds)))


kinds: st.SearchStrategy[DataType] = st.recursive(
    elements,
    lambda inner: st.one_of(
        st.builds(lambda kind, n: ArrayType(kind, 1, n), inner, st.integers(1, 4)),
        st.lists(inner, min_size=1, max_size=4).map(structure),
    ),
    max_leaves=6,
)
messages = st.lists(kinds, max_size=6).flatmap(
    lambda types: st.tuples(st.just(types), st.tuples(*[values_of(kind) for kind in types]))
)


@pytest.mark.parametrize(
    ("names", "values", "encoded"),
    [
        ([], (), "05"),
        (["BOOL", "BOOL"], (False, True), "4041"),
        (["SINT", "INT", "DINT"], (-1, 258, -2), "42ff 430102 44fffffffe"),
        (["LINT", "USINT", "UINT"], (1, 255, 65535), "450000000000000001 46ff 47ffff"),
        (["UDINT", "ULINT"], (1, 2**64 - 1), "4800000001 49ffffffffffffffff"),
        (["REAL", "LREAL"], (1.5, -2.0), "4a3fc00000 4bc000000000000000"),
        (["TIME"], (10_000_000,), "4c0000000000002710"),
        (["DATE", "TOD"], (86_400_000_000_000, 1_000_000), "4d0000000005265c00 4e0000000000000001"),
        (["DT"], (1_700_000_000_123_000_000,), "4f0000018bcfe5687b"),
        (["BYTE", "WORD", "DWORD", "LWORD"], (1, 2, 3, 4), "5101 520002 5300000003 540000000000000004"),
        (["STRING", "STRING"], ("", "blue"), "500000 500004626c7565"),
        (["STRING"], ("é",), "500001e9"),
        (["WSTRING"], ("é😀",), "55000300e9d83dde00"),
    ],
)
def test_encoding_is_the_compliance_profiles(names: list[str], values: tuple[Any, ...], encoded: str) -> None:
    codec = signature(*names)
    assert codec.encode(values) == bytes.fromhex(encoded)
    assert codec.decode(bytes.fromhex(encoded)) == values


@pytest.mark.parametrize(
    ("element", "value", "encoded"),
    [
        ("INT", [1, -1], "760002 43 0001 ffff"),
        ("BOOL", [True, False], "760002 41 40"),
        ("STRING", ["a", "bc"], "760002 50 000161 00026263"),
        ("TIME", [1000, 2000], "760002 4c 0000000000000001 0000000000000002"),
    ],
)
def test_arrays_send_the_element_tag_once_except_for_bool(element: str, value: list[Any], encoded: str) -> None:
    codec = Signature([ArrayType(elementary(element), 0, 1)])
    assert codec.encode([value]) == bytes.fromhex(encoded)
    assert codec.decode(bytes.fromhex(encoded)) == (value,)


@pytest.mark.parametrize(("nanoseconds", "microseconds"), [(1_999, 1), (-1_999, -1), (0, 0)])
def test_time_is_cut_towards_zero_to_microseconds(nanoseconds: int, microseconds: int) -> None:
    assert signature("TIME").encode([nanoseconds])[1:] == struct.pack(">q", microseconds)


def test_nan_and_infinity_pass() -> None:
    codec = signature("LREAL", "REAL")
    values = codec.decode(codec.encode([math.nan, -math.inf]))
    assert math.isnan(values[0])
    assert values[1] == -math.inf


@given(messages, st.data())
def test_any_split_or_join_gives_the_same_messages(
    message: tuple[list[DataType], tuple[Any, ...]], data: st.DataObject
) -> None:
    types, values = message
    codec = Signature(types)
    stream = codec.encode(values) * 3
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    reader = MessageReader(codec)
    received = []
    for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        received += reader.feed(stream[begin:end])
    assert received == [values] * 3
    assert reader.idle


@given(messages)
def test_bytes_may_come_one_by_one(message: tuple[list[DataType], tuple[Any, ...]]) -> None:
    types, values = message
    codec = Signature(types)
    stream = codec.encode(values)
    assert trickle(MessageReader(codec), stream) == [[]] * (len(stream) - 1) + [[values]]


@given(st.lists(elements, max_size=5), st.lists(st.binary(max_size=30), max_size=5))
def test_arbitrary_bytes_give_messages_or_a_named_error(types: list[ElementaryType], chunks: list[bytes]) -> None:
    reader, complaint = MessageReader(Signature(types, string_limit=100)), ""
    try:
        for chunk in chunks:
            reader.feed(chunk)
    except CommunicationError as error:
        complaint = str(error)
    assert not complaint or complaint.startswith("byte ")


@pytest.mark.parametrize(
    ("names", "encoded", "complaint"),
    [
        (["LREAL"], "50", "byte 0: expected tag 0x4B (LREAL), got 0x50 (STRING)"),
        (["BOOL", "LREAL"], "41 4a00", "byte 1: expected tag 0x4B (LREAL), got 0x4A (REAL)"),
        (["BOOL"], "4b", "byte 0: expected tag 0x40 or 0x41 (BOOL), got 0x4B (LREAL)"),
        (["BOOL"], "00", "byte 0: expected tag 0x40 or 0x41 (BOOL), got 0x00"),
        (["STRING"], "55", "byte 0: expected tag 0x50 (STRING), got 0x55 (WSTRING)"),
        (["STRING"], "500065", "byte 1: STRING of length 101, expected at most 100"),
        (["WSTRING"], "550001d800", "byte 3: expected WSTRING in UTF-16-BE, got other bytes"),
        ([], "41", "byte 0: expected tag 0x05 (null), got 0x41 (BOOL)"),
    ],
)
def test_errors_name_offset_and_tags(names: list[str], encoded: str, complaint: str) -> None:
    codec = signature(*names, string_limit=100)
    data = bytes.fromhex(encoded)
    with pytest.raises(CommunicationError) as whole:
        codec.decode(data)
    assert str(whole.value) == complaint
    with pytest.raises(CommunicationError) as piecewise:
        trickle(MessageReader(codec), data)
    assert str(piecewise.value) == complaint


def test_a_structure_is_the_data_of_its_members_and_only_bool_has_a_tag_inside() -> None:
    inner = structure([BOOL, STRING])
    codec = Signature([structure([INT, BOOL, inner, ArrayType(INT, 0, 1), ArrayType(BOOL, 0, 0)])])
    value = [258, True, [False, "a"], [1, 2], [True]]
    encoded = bytes.fromhex("61 0102 41 40 000161 0002 43 0001 0002 0001 41")
    assert codec.encode([value]) == encoded
    assert codec.decode(encoded) == (value,)


def test_arrays_of_structures_and_of_arrays_send_one_tag_for_all_elements() -> None:
    codec = Signature([ArrayType(structure([INT, BOOL]), 0, 1), ArrayType(ArrayType(INT, 0, 0), 0, 1)])
    values = ([[1, True], [2, False]], [[3], [4]])
    encoded = bytes.fromhex("760002 61 0001 41 0002 40 760002 76 0001 43 0003 0001 43 0004")
    assert codec.encode(values) == encoded
    assert codec.decode(encoded) == values


def test_an_array_that_is_too_long_is_cut_and_one_too_short_stays_so() -> None:
    codec = Signature([ArrayType(INT, 1, 2), BOOL])
    assert codec.decode(bytes.fromhex("760003 43 0001 0002 0003 41")) == ([1, 2], True)
    assert codec.decode(bytes.fromhex("760001 43 0001 41")) == ([1], True)
    assert codec.decode(bytes.fromhex("760000 41")) == ([], True)
    booleans = Signature([ArrayType(BOOL, 0, 0)])
    assert booleans.decode(bytes.fromhex("760002 41 40")) == ([True],)


def test_what_an_array_loses_is_bounded() -> None:
    codec = Signature([ArrayType(INT, 1, 2)])
    surplus = CUT // 2
    whole = struct.pack(">BHB", 0x76, 2 + surplus, 0x43) + bytes(2 * (2 + surplus))
    assert codec.decode(whole) == ([0, 0],)
    longer = struct.pack(">BHB", 0x76, 3 + surplus, 0x43) + bytes(2 * (3 + surplus))
    with pytest.raises(CommunicationError, match="byte 1: ARRAY of 753 elements: expected 2, or 1500 bytes more"):
        codec.decode(longer)


def test_the_tag_of_the_elements_is_checked() -> None:
    codec = Signature([ArrayType(elementary("INT"), 1, 2)])
    with pytest.raises(CommunicationError, match=r"byte 3: expected tag 0x43 \(INT\), got 0x44 \(DINT\)"):
        codec.decode(bytes.fromhex("76000244"))


def test_offset_counts_from_the_start_of_the_message_across_pieces() -> None:
    reader = MessageReader(signature("BOOL", "INT", "LREAL"))
    assert reader.feed(bytes.fromhex("41 430001")) == []
    with pytest.raises(CommunicationError, match="byte 4: expected tag 0x4B"):
        reader.feed(b"\x00")


@pytest.mark.parametrize("cut", range(1, 5))
def test_a_datagram_must_hold_exactly_one_message(cut: int) -> None:
    codec = signature("INT", "BOOL")
    whole = codec.encode([7, True])
    if cut < len(whole):
        with pytest.raises(CommunicationError, match=f"message ends at byte {cut}"):
            codec.decode(whole[:cut])
    with pytest.raises(CommunicationError, match="1 bytes follow"):
        codec.decode(whole + b"\x00")


@pytest.mark.parametrize(
    ("name", "value"),
    [("INT", 40000), ("UINT", -1), ("LREAL", "x"), ("STRING", "€"), ("STRING", "x" * 65536), ("REAL", 1e300)],
)
def test_unfit_values_are_named(name: str, value: Any) -> None:
    with pytest.raises(CommunicationError, match=f"value 2 to send: .* is no {name}"):
        signature("BOOL", name).encode([True, value])


def test_wrong_number_of_values() -> None:
    with pytest.raises(CommunicationError, match="expected 2 values to send, got 1"):
        signature("BOOL", "BOOL").encode([True])


def test_types_without_encoding() -> None:
    for kind in (LTIME, ArrayType(LTIME, 0, 1), structure([LTIME])):
        with pytest.raises(CommunicationError, match="no encoding"):
            Signature([kind])


def test_memory_of_an_unfinished_message_is_bounded() -> None:
    """The largest messages the signature allows arrive slowly: no more than one is kept."""
    limit = 10_000
    codec = signature("STRING", "STRING", string_limit=limit)
    reader = MessageReader(codec)
    rng = random.Random(1)
    stream = codec.encode(["a" * limit, "b" * limit]) * 20
    at = 0
    tracemalloc.start()
    while at < len(stream):
        step = rng.randrange(1, 4000)
        reader.feed(stream[at : at + step])
        at += step
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 10 * limit
    assert reader.idle


def test_every_fixed_type_is_as_wide_as_its_values() -> None:
    for name, (_, letter) in FIXED.items():
        assert struct.calcsize(f">{letter}") * 8 == elementary(name).bits


@given(
    st.lists(st.sampled_from(["LREAL", "BOOL", "INT", "REAL", "ULINT"]), min_size=1, max_size=8).map(
        lambda names: signature(*names)
    ),
    st.data(),
)
def test_what_comes_whole_is_read_and_refused_as_what_comes_in_pieces(kinds: Signature, data: st.DataObject) -> None:
    values = data.draw(st.tuples(*[values_of(kind) for kind in kinds.types]))
    sent = bytearray(kinds.encode(values))
    assert MessageReader(kinds).feed(bytes(sent)) == [values]
    place = data.draw(st.integers(0, len(sent) - 1))
    sent[place] = data.draw(st.integers(0, 255))
    found = []
    for pieces in ([bytes(sent)], [bytes(sent[:place]), bytes(sent[place:])]):
        reader = MessageReader(kinds)
        try:
            found.append(repr([message for piece in pieces for message in reader.feed(piece)]))
        except CommunicationError as error:
            found.append(str(error))
    assert found[0] == found[1]
