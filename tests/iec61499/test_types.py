"""Ranges, defaults and literals of the elementary types."""

from __future__ import annotations

import math
import re
import struct
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499.literals import format_literal, parse_literal
from iec61499.types import (
    BOOL,
    BYTE,
    DINT,
    ELEMENTARY,
    INT,
    LREAL,
    LTIME,
    REAL,
    STRING,
    TIME,
    UINT,
    USINT,
    WORD,
    WSTRING,
    ArrayType,
    DataType,
    ElementaryType,
    elementary,
    round_to_real,
)
from tests.support.examples import examples

quick = examples(60, deadline=None, derandomize=True)


def values(data_type: DataType) -> st.SearchStrategy[Any]:
    if isinstance(data_type, ArrayType):
        return st.lists(values(data_type.element), min_size=data_type.length, max_size=data_type.length)
    assert isinstance(data_type, ElementaryType)
    if data_type.kind == "bool":
        return st.booleans()
    if data_type.kind == "real":
        return st.floats(allow_nan=False, allow_infinity=False, width=32 if data_type.bits == 32 else 64)
    if data_type.kind == "string":
        return st.text(st.characters(max_codepoint=0xFF if data_type == STRING else 0xFFFF))
    if data_type.kind == "char":
        return st.characters(max_codepoint=0xFF if data_type.bits == 8 else 0xFFFF, exclude_categories=["Cs"])
    if data_type.name in ("DATE", "LDATE"):
        return st.integers(-100_000, 100_000).map(lambda days: days * 86_400_000_000_000)
    if data_type.name in ("TOD", "LTOD"):
        return st.integers(0, 86_400_000_000_000 - 1)
    return st.integers(data_type.minimum, data_type.maximum)


@pytest.mark.parametrize("data_type", [*ELEMENTARY.values(), ArrayType(INT, 1, 3), ArrayType(STRING, 0, 2)], ids=str)
@quick
@given(data=st.data())
def test_a_formatted_value_reads_back_equal(data_type: DataType, data: st.DataObject) -> None:
    value = data.draw(values(data_type))
    text = format_literal(value, data_type)
    assert repr(parse_literal(text, data_type)) == repr(value), text


@pytest.mark.parametrize(
    ("text", "data_type", "value"),
    [
        ("16#FF", INT, 255),
        ("INT#16#7F", INT, 127),
        ("-5", INT, -5),
        ("2#1111_0000", BYTE, 240),
        ("SINT#5", DINT, 5),
        ("TRUE", BOOL, True),
        ("0", BOOL, False),
        ("BOOL#1", BOOL, True),
        ("LREAL#1.0", LREAL, 1.0),
        ("1", LREAL, 1.0),
        ("-1.5e-3", LREAL, -0.0015),
        ("0.1", REAL, 0.10000000149011612),
        ("T#10ms", TIME, 10_000_000),
        ("t#1h_30m", TIME, 5_400_000_000_000),
        ("TIME#-1.5s", TIME, -1_500_000_000),
        ("LTIME#1ns", LTIME, 1),
        ("T#0s", TIME, 0),
        ("0", TIME, 0),
        ("'a$'b$24'", STRING, "a'b$"),
        ('"$263A"', WSTRING, "☺"),
        ("''", STRING, ""),
        ("[1.0, 2.0]", ArrayType(LREAL, 0, 1), [1.0, 2.0]),
        ("[3(0.5)]", ArrayType(LREAL, 1, 3), [0.5] * 3),
        ("[2(1), 7]", ArrayType(INT, 0, 4), [1, 1, 7, 0, 0]),
        ("['a,b', ']']", ArrayType(STRING, 0, 1), ["a,b", "]"]),
        ("[[1, 2], [3, 4]]", ArrayType(ArrayType(INT, 0, 1), 0, 1), [[1, 2], [3, 4]]),
        ("[]", ArrayType(INT, 0, 0), [0]),
        ("USINT#5", INT, 5),
        ("SINT#-5", INT, -5),
        ("UINT#7", REAL, 7.0),
        ("DINT#-7", LREAL, -7.0),
    ],
)
def test_literals_as_4diac_writes_them(text: str, data_type: DataType, value: object) -> None:
    assert repr(parse_literal(text, data_type)) == repr(value)


@pytest.mark.parametrize(
    ("text", "data_type", "message"),
    [
        ("300", USINT, "300 is out of the range of USINT: expected 0 to 255"),
        ("-1", WORD, "-1 is out of the range of WORD: expected 0 to 65535"),
        ("1.5", INT, "'1.5' is not a INT: expected an integer such as -5 or 16#FF"),
        ("yes", BOOL, "'yes' is not a BOOL: expected TRUE or FALSE"),
        ("abc", STRING, "'abc' is not a STRING: expected text in quotes"),
        ("'a'b'", STRING, "expected $' for a quote inside the text"),
        ("10ms", TIME, "'10ms' is not a TIME: expected a duration such as T#10ms"),
        ("T#10", TIME, "'T#10' is not a TIME"),
        ("T#300000d", TIME, "is out of the range of TIME"),
        ("LREAL#1.0", REAL, "LREAL#1.0 is a LREAL, expected REAL"),
        ("WORD#1", INT, "WORD#1 is a WORD, expected INT"),
        ("UINT#1", INT, "UINT#1 is a UINT, expected INT"),
        ("INT#1", UINT, "INT#1 is a INT, expected UINT"),
        ("DINT#1", REAL, "DINT#1 is a DINT, expected REAL"),
        ("1e39", REAL, "1e39 is beyond the range of REAL"),
        ("nan", LREAL, "'nan' is not a LREAL"),
        ("[1, 2, 3]", ArrayType(INT, 0, 1), "more than the 2 elements of ARRAY [0..1] OF INT"),
        ("1", ArrayType(INT, 0, 1), "'1' is not an array: expected a list such as"),
        ("[1, x]", ArrayType(INT, 0, 1), "'x' is not a INT"),
        ("", INT, "'' is not a INT"),
    ],
)
def test_bad_literals_are_named(text: str, data_type: DataType, message: str) -> None:
    with pytest.raises(FunctionBlockError) as caught:
        parse_literal(text, data_type, "x.fbt", 4, 2)
    assert message in str(caught.value)
    assert str(caught.value).startswith("x.fbt:4:2: ")


@pytest.mark.parametrize("name", ["DATUM", "STRING[0]", "MyStruct", ""])
def test_unknown_types_list_the_known(name: str) -> None:
    expected = f"unknown type {name!r}: expected BOOL, SINT, .* or LDT, STRING[n] or a structure"
    with pytest.raises(FunctionBlockError, match=re.escape(expected).replace(r"\.\*", ".*")):
        elementary(name)


def test_type_names_have_no_case() -> None:
    assert elementary("lreal") is LREAL


@quick
@given(value=st.floats())
def test_reals_round_as_the_hardware_does(value: float) -> None:
    rounded = round_to_real(value)
    if math.isnan(value):
        assert math.isnan(rounded)
    elif math.isfinite(rounded):
        assert rounded == struct.unpack("f", struct.pack("f", value))[0]
    else:
        assert abs(value) >= (2 - 2**-24) * 2.0**127  # half way from the largest one
        assert math.copysign(1, rounded) == math.copysign(1, value)


@pytest.mark.parametrize("value", [math.inf, math.nan])
def test_what_has_no_literal_is_an_error(value: float) -> None:
    with pytest.raises(FunctionBlockError, match="no literal"):
        format_literal(value, LREAL)


def test_arrays_wrap_and_default_to_lists_of_their_own() -> None:
    data_type = ArrayType(ArrayType(INT, 0, 1), 1, 2)
    first, second = data_type.default, data_type.default
    first[0][0] = 5
    assert second == [[0, 0], [0, 0]]
    assert ArrayType(USINT, 1, 3).wrap([256, -1]) == [0, 255, 0]
    assert str(data_type) == "ARRAY [1..2] OF ARRAY [0..1] OF INT"
    with pytest.raises(FunctionBlockError, match="lower <= upper"):
        ArrayType(INT, 2, 1)


@pytest.mark.parametrize(
    "name", ["SINT", "INT", "DINT", "LINT", "USINT", "UINT", "UDINT", "ULINT", "BYTE", "LWORD", "TIME"]
)
@examples(30, deadline=None, derandomize=True)
@given(value=st.integers(-(2**70), 2**70))
def test_wrapping_is_modulo_the_width(name: str, value: int) -> None:
    data_type = ELEMENTARY[name]
    wrapped = data_type.wrap(value)
    assert data_type.minimum <= wrapped <= data_type.maximum
    assert (wrapped - value) % 2**data_type.bits == 0
    assert data_type.wrap(wrapped) == wrapped
