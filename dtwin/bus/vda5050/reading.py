"""What vehicles tell is decoded and checked before anybody acts on it."""

from __future__ import annotations

from typing import Final, Generic, TypeVar

import msgspec

from dtwin.bus.codec import MessageError, decoded
from dtwin.bus.vda5050.messages import VERSION, Header

M = TypeVar("M", bound=Header)
_NUMBERS: Final = 2**32
"""Header numbers begin anew after this many (7.2: uint32)."""


class RobotReader(Generic[M]):
    """Decodes the messages of one topic of one vehicle, each newer than the one before.

    Args:
        message: type of the messages.
        manufacturer, vehicle: names that they must have in their headers, as in the key by which they come.
    """

    def __init__(self, message: type[M], manufacturer: str, vehicle: str) -> None:
        self._decode = msgspec.json.Decoder(message).decode
        self._names = manufacturer, vehicle
        self._last: int | None = None

    def forget(self) -> None:
        """The vehicle has begun anew: its next message is the first, whatever its number."""
        self._last = None

    def __call__(self, payload: bytes) -> M:
        """Decodes a message.

        Raises:
            MessageError: it is too long, no JSON, of another version or another vehicle, not newer than the last one
                that was read, or a field is missing, not finite or out of range.
        """
        found = decoded(self._decode, payload)
        major = VERSION.partition(".")[0]
        if found.version.partition(".")[0] != major:
            raise MessageError("invalid", f"version: expected {major}.x.y, got {found.version}")
        names = found.manufacturer, found.serialNumber
        if names != self._names:
            expected, got = ("/".join(each) for each in (self._names, names))
            raise MessageError("invalid", f"manufacturer and serialNumber: expected {expected}, got {got}")
        if self._last is not None and not 0 < (found.headerId - self._last) % _NUMBERS < _NUMBERS // 2:
            raise MessageError("out of order", f"headerId: expected one after {self._last}, got {found.headerId}")
        self._last = found.headerId
        return found
