"""Values of function blocks as values of OPC UA, and back."""

from __future__ import annotations

from typing import Any

import pytest

from iec61499.errors import CommunicationError
from iec61499.types import (
    ELEMENTARY,
    ArrayType,
    DataType,
    Member,
    StructType,
    enumeration,
)

ua = pytest.importorskip("asyncua", reason="the extra opcua is not installed").ua
INT, STRING = ELEMENTARY["INT"], ELEMENTARY["STRING"]
TEXT = StructType("LocalizedText", (Member("locale", STRING, ""), Member("text", STRING, "")))
DAY = 86_400_000_000_000


@pytest.mark.parametrize(
    ("kind", "value", "variant"),
    [
        *((ELEMENTARY[name], 7, kind) for name, kind in (("SINT", "SByte"), ("WORD", "UInt16"), ("ULINT", "UInt64"))),
        (ELEMENTARY["TIME"], 1_500_000_000, "Int64"),
        (ELEMENTARY["DT"], 20_000 * DAY + 5_000, "DateTime"),
        (ELEMENTARY["DATE"], 20_000 * DAY, "DateTime"),
        (ELEMENTARY["CHAR"], "A", "Byte"),
        (STRING, "Öl".encode().decode("latin-1"), "String"),
        (ELEMENTARY["WSTRING"], "Öl €", "String"),
        (ArrayType(INT, 0, 2), [1, 2, 3], "Int16"),
        (TEXT, ["de", "Tür".encode().decode("latin-1")], "LocalizedText"),
    ],
)
def test_a_value_comes_back_as_it_went(kind: DataType, value: Any, variant: str) -> None:
    from iec61499.net.opcua.values import converter

    found = converter(kind)
    encoded = found.encode(value)
    assert encoded.VariantType == ua.VariantType[variant]
    assert found.decode(encoded) == value
    assert found.decode(ua.Variant(encoded.Value, encoded.VariantType)) == value


def test_what_has_no_value_of_the_other_kind_is_told() -> None:
    from iec61499.net.opcua.values import converter

    for kind in (ELEMENTARY["TOD"], enumeration("COLOUR", ("RED",)), StructType("P", (Member("X", INT, 0),))):
        with pytest.raises(CommunicationError, match="has no value of OPC UA"):
            converter(kind)
    with pytest.raises(CommunicationError, match="expected Int16 for INT"):
        converter(INT).decode(ua.Variant(1.0, ua.VariantType.Double))
    with pytest.raises(CommunicationError, match="got nothing, expected Int16"):
        converter(INT).decode(None)
    with pytest.raises(CommunicationError, match="expected a single value"):
        converter(INT).decode(ua.Variant([1], ua.VariantType.Int16))
    with pytest.raises(CommunicationError, match="expected at most 16384"):
        converter(STRING).decode(ua.Variant("x" * 20_000, ua.VariantType.String))
    with pytest.raises(CommunicationError, match="is no DT for OPC UA"):
        converter(ELEMENTARY["DT"]).encode(1 << 70)
