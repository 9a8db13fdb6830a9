"""The adapter types and structures that 4diac FORTE has by itself, and the blocks that serve the adapters."""

from __future__ import annotations

from typing import Final

from iec61499 import model
from iec61499.files.interface import with_adapters
from iec61499.standard.notation import composite, interface, simple
from iec61499.types import STRING, Member, StructType


def _timeout(name: str) -> model.AdapterType:
    return model.AdapterType(
        model.TypeHeader(name, comment="Interface of a time-out service"),
        interface("TimeOut -> START(DT), STOP", "-> DT: TIME"),
    )


ADAPTERS: Final = {name: _timeout(name) for name in ("ATimeOut", "ARTimeOut")}
"""Adapter types by name."""


STRUCTURES: Final = {
    "LocalizedText": StructType("LocalizedText", (Member("text", STRING, ""), Member("locale", STRING, ""))),
}
"""Structures by name; a LocalizedText is that of OPC UA (part 3, 8.5)."""


def _service(name: str, adapter: str, delay: str) -> model.CompositeFBType:
    socket = model.AdapterPort("TimeOutSocket", ADAPTERS[adapter], is_plug=False)
    return composite(
        name,
        "Serves time-outs",
        with_adapters(model.Interface(), (socket,)),
        f"DLY: {delay}",
        "TimeOutSocket.START -> DLY.START; TimeOutSocket.STOP -> DLY.STOP; DLY.EO -> TimeOutSocket.TimeOut",
        "TimeOutSocket.DT -> DLY.DT",
    )


_TEXT: Final = STRUCTURES["LocalizedText"]
FIXED: Final[dict[str, model.FBType]] = {
    "String2LocalizedText": simple(
        "String2LocalizedText",
        (model.Variable("locale", STRING), model.Variable("text", STRING)),
        (model.Variable("RD", _TEXT),),
        "RD.locale := locale; RD.text := text;",
    ),
    "LocalizedText2LocalizedText": simple(
        "LocalizedText2LocalizedText", (model.Variable("IN", _TEXT),), (model.Variable("OUT", _TEXT),), "OUT := IN;"
    ),
    "E_TimeOut": _service("E_TimeOut", "ATimeOut", "E_DELAY"),
    "E_RTimeOut": _service("E_RTimeOut", "ARTimeOut", "E_RDELAY"),
}
"""The blocks by name."""
