"""Interfaces of the blocks that reach outside the network: restart, timers and communication."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Final

from iec61499 import model
from iec61499.standard.notation import interface

MAXIMUM_VALUES: Final = 100
"""Most data inputs or outputs of a communication block."""

EVENT_TYPES: Final = {"INIT": "EInit"}
"""Types of event inputs that are not `Event`, as in 4diac; E_TRIG triggers all inputs of a type."""
COMMUNICATION: Final = re.compile(r"(SERVER|CLIENT)_(\d{1,3})(?:_(\d{1,3}))?|(PUBLISH|SUBSCRIBE|PUBL|SUBL)_(\d{1,3})")


def _service(name: str, comment: str, ports: model.Interface) -> model.ServiceInterfaceFBType:
    events = tuple(replace(e, type=EVENT_TYPES.get(e.name, e.type)) for e in ports.event_inputs)
    return model.ServiceInterfaceFBType(model.TypeHeader(name, comment=comment), replace(ports, event_inputs=events))


def _channels() -> dict[str, model.ServiceInterfaceFBType]:
    """IX, QW and the like: inputs and outputs of hardware, by name."""
    sizes = {"X": "BOOL", "B": "BYTE", "W": "WORD", "D": "DWORD", "L": "LWORD"}
    events = "INIT(QI PARAMS), REQ(QI{0}) -> INITO(QO STATUS), CNF(QO STATUS{1})"
    data = "QI: BOOL; PARAMS: STRING{0} -> QO: BOOL; STATUS: STRING{1}"
    blocks = {}
    for letter, kind in sizes.items():
        reading = events.format("", " IN") + ", IND(QO STATUS IN)", data.format("", f"; IN: {kind}")
        writing = events.format(" OUT", ""), data.format(f"; OUT: {kind}", "")
        blocks[f"I{letter}"] = _service(f"I{letter}", "Input of hardware", interface(*reading))
        blocks[f"Q{letter}"] = _service(f"Q{letter}", "Output of hardware", interface(*writing))
    telling = events.format("", "") + ", IND(QO STATUS)", data.format("", "")
    blocks["IE"] = _service("IE", "Event of hardware", interface(*telling))
    return blocks


_TIMER: Final = interface("START(DT), STOP -> EO", "DT: TIME ->")
FIXED: Final = _channels() | {
    block.header.name: block
    for block in (
        _service("E_RESTART", "Tells when the resource starts and stops", interface("-> COLD, WARM, STOP", "")),
        _service("E_CYCLE", "Issues an event every DT", _TIMER),
        _service("E_DELAY", "Delays an event by DT; another START meanwhile is ignored", _TIMER),
        _service("E_RDELAY", "Delays an event by DT; another START meanwhile begins anew", _TIMER),
    )
}


def communication(name: str) -> model.ServiceInterfaceFBType | None:
    """SERVER_n_m, CLIENT_n_m, PUBLISH_n, SUBSCRIBE_n and the local PUBL_n, SUBL_n; None for other names.

    n values are sent (SD_1 ...) and m received (RD_1 ...); without m as many as n. The values take the types they are
    connected to.
    """
    match = COMMUNICATION.fullmatch(name)
    if match is None:
        return None
    kind = match[1] or match[4]
    first = int(match[2] or match[5])
    sent = 0 if kind in ("SUBSCRIBE", "SUBL") else first
    received = 0 if kind in ("PUBLISH", "PUBL") else int(match[3]) if match[3] else first
    if max(sent, received) > MAXIMUM_VALUES:
        return None
    request, answer = ("REQ", "CNF") if kind in ("CLIENT", "PUBLISH", "PUBL") else ("RSP", "IND")
    sends = [f"SD_{i}" for i in range(1, sent + 1)]
    receives = [f"RD_{i}" for i in range(1, received + 1)]
    ports = interface(
        f"INIT(QI ID), {request}({' '.join(['QI', 'ID', *sends])})"
        f" -> INITO(QO STATUS), {answer}({' '.join(['QO', 'STATUS', *receives])})",
        f"QI: BOOL; ID: STRING{'; ' + ', '.join(sends) + ': ANY' if sends else ''}"
        f" -> QO: BOOL; STATUS: STRING{'; ' + ', '.join(receives) + ': ANY' if receives else ''}",
    )
    return _service(name, "Communication", ports)
