"""The adapter types of 4diac FORTE's event library, and the blocks that serve them."""

from __future__ import annotations

from typing import Final

from dtwin.iec61499 import model
from dtwin.iec61499.files.interface import with_adapters
from dtwin.iec61499.standard.notation import composite, interface


def _timeout(name: str) -> model.AdapterType:
    return model.AdapterType(
        model.TypeHeader(name, comment="Interface of a time-out service"),
        interface("TimeOut -> START(DT), STOP", "-> DT: TIME"),
    )


ADAPTERS: Final = {name: _timeout(name) for name in ("ATimeOut", "ARTimeOut")}
"""Adapter types by name."""


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


FIXED: Final = {
    "E_TimeOut": _service("E_TimeOut", "ATimeOut", "E_DELAY"),
    "E_RTimeOut": _service("E_RTimeOut", "ARTimeOut", "E_RDELAY"),
}
"""The blocks by name."""
