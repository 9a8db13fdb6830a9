"""Values of function blocks as values of OPC UA, with the types that 4diac FORTE gives them.

A TIME is an Int64 of nanoseconds, a date with or without a time of day a DateTime, a WORD a UInt16. Arrays of one
dimension travel as such, and so does a structure LocalizedText; `structures` has the others. Enumerations and times
of day have no form that peers would understand.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any, Final

from asyncua import ua

from iec61499.errors import CommunicationError
from iec61499.net.encoding import STRING_LIMIT, Value
from iec61499.types import STRING, ArrayType, DataType, ElementaryType, StructType

_VARIANTS: Final = {
    "BOOL": ua.VariantType.Boolean,
    "SINT": ua.VariantType.SByte,
    "INT": ua.VariantType.Int16,
    "DINT": ua.VariantType.Int32,
    "LINT": ua.VariantType.Int64,
    "USINT": ua.VariantType.Byte,
    "UINT": ua.VariantType.UInt16,
    "UDINT": ua.VariantType.UInt32,
    "ULINT": ua.VariantType.UInt64,
    "BYTE": ua.VariantType.Byte,
    "WORD": ua.VariantType.UInt16,
    "DWORD": ua.VariantType.UInt32,
    "LWORD": ua.VariantType.UInt64,
    "REAL": ua.VariantType.Float,
    "LREAL": ua.VariantType.Double,
    "STRING": ua.VariantType.String,
    "WSTRING": ua.VariantType.String,
    "CHAR": ua.VariantType.Byte,
    "WCHAR": ua.VariantType.UInt16,
    "TIME": ua.VariantType.Int64,
    "LTIME": ua.VariantType.Int64,
    **dict.fromkeys(("DATE", "LDATE", "DT", "LDT"), ua.VariantType.DateTime),
}
_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_DAY: Final = 86_400_000_000_000
"""ns"""


@dataclass(frozen=True, slots=True)
class Converter:
    """Converts the values of one port.

    Attributes:
        element: the type of the value, or of an array's elements.
        variant: what it is in OPC UA.
        length: elements of the array; 0 for a single value.
    """

    element: ElementaryType | StructType
    variant: ua.VariantType
    length: int

    @property
    def data_type(self) -> ua.NodeId:
        """The node of the data type."""
        return ua.NodeId(self.variant.value, 0)

    @property
    def rank(self) -> int:
        """The rank of a variable: -1 for a single value, 1 for an array."""
        return 1 if self.length else -1

    def encode(self, value: Value) -> ua.Variant:
        """The value for OPC UA. Raises CommunicationError when it has none."""
        try:
            if self.length:
                return ua.Variant([_encode(self.element, one) for one in value], self.variant)
            return ua.Variant(_encode(self.element, value), self.variant)
        except (OverflowError, UnicodeError, ValueError, TypeError, KeyError):
            raise CommunicationError(f"{value!r:.60} is no {self.element} for OPC UA") from None

    def decode(self, variant: ua.Variant | None) -> Value:
        """The value of a block. Raises CommunicationError when it is of another type, or too long."""
        if variant is None or variant.Value is None or variant.VariantType != self.variant:
            got = "nothing" if variant is None or variant.Value is None else variant.VariantType.name
            raise CommunicationError(f"got {got}, expected {self.variant.name} for {self.element}")
        if bool(variant.is_array) != bool(self.length):
            raise CommunicationError(f"expected {'an array' if self.length else 'a single value'}")
        try:
            if self.length:
                return [_decode(self.element, one) for one in variant.Value[: self.length]]
            return _decode(self.element, variant.Value)
        except (OverflowError, UnicodeError, ValueError, TypeError, AttributeError, KeyError):
            raise CommunicationError(f"{variant.Value!r:.60} is no {self.element}") from None


def converter(kind: DataType) -> Converter:
    """What converts values of a type. Raises CommunicationError when OPC UA has none."""
    element = kind.element if isinstance(kind, ArrayType) else kind
    length = kind.elements if isinstance(kind, ArrayType) else 0
    if isinstance(element, StructType) and element.name == "LocalizedText" and not length:
        return Converter(element, ua.VariantType.LocalizedText, 0)
    if not isinstance(element, ElementaryType) or element.name not in _VARIANTS:
        raise CommunicationError(f"{kind} has no value of OPC UA: expected an elementary type, or an array of one")
    return Converter(element, _VARIANTS[element.name], length)


def _encode(kind: ElementaryType | StructType, value: Value) -> Any:
    if isinstance(kind, StructType):
        texts = {m.name.lower(): _encode(STRING, one) for m, one in zip(kind.members, value, strict=True)}
        return ua.LocalizedText(texts["text"], texts["locale"] or None)
    if kind.name == "STRING":
        return value.encode("latin-1").decode("utf-8", "replace")
    if kind.kind == "char":
        return ord(value)
    if kind.kind == "date":
        return _EPOCH + timedelta(microseconds=value // 1000)
    return value


def _decode(kind: ElementaryType | StructType, value: Any) -> Value:
    if isinstance(kind, StructType):
        texts = {"text": value.Text or "", "locale": value.Locale or ""}
        return [_decode(STRING, texts[member.name.lower()]) for member in kind.members]
    if kind.kind == "string":
        text = value.encode("utf-8").decode("latin-1") if kind.name == "STRING" else value
        if len(text) > STRING_LIMIT:
            raise CommunicationError(f"text of {len(text)} characters: expected at most {STRING_LIMIT}")
        return kind.wrap(text)
    if kind.kind == "char":
        return chr(value)
    if kind.kind == "date":
        moment = value if value.tzinfo is not None else value.replace(tzinfo=UTC)
        count = (moment - _EPOCH) // timedelta(microseconds=1) * 1000
        return count // _DAY * _DAY if kind.name in ("DATE", "LDATE") else count
    return kind.wrap(value)
