"""Function blocks of IEC 61131-3, 6.6.3.5 (counters, bistables, edges, timers), with the ports of 4diac FORTE.

They work on REQ alone: a timer looks at the clock when it is asked, and not in between.
"""

from __future__ import annotations

import re
from typing import Final

from iec61499 import model
from iec61499.standard.notation import function, interface
from iec61499.types import ELEMENTARY

_COUNTER: Final = re.compile(r"FB_CT(U|D|UD)(?:_(DINT|LINT|UDINT|ULINT))?")
_SIMPLE: Final = {
    "FB_SR": ("S1, R: BOOL -> Q1: BOOL", "Q1 := S1 OR (NOT R AND Q1);", ""),
    "FB_RS": ("S, R1: BOOL -> Q1: BOOL", "Q1 := NOT R1 AND (S OR Q1);", ""),
    "FB_R_TRIG": ("CLK: BOOL -> Q: BOOL", "Q := CLK AND NOT M; M := CLK;", "M: BOOL"),
    "FB_F_TRIG": ("CLK: BOOL -> Q: BOOL", "Q := NOT CLK AND NOT M; M := NOT CLK;", "M: BOOL"),
}
_TIMERS: Final = ("FB_TON", "FB_TOF", "FB_TP")


def _counter(name: str, kind: str, data_type: str) -> model.SimpleFBType:
    low, high = ELEMENTARY[data_type].minimum, ELEMENTARY[data_type].maximum
    up, down = f"CV < {high} THEN CV := CV + 1;", f"CV > {low} THEN CV := CV - 1;"
    if kind == "U":
        data = f"CU, R: BOOL; PV: {data_type} -> Q: BOOL; CV: {data_type}"
        text = f"IF R THEN CV := 0; ELSIF CU AND {up} END_IF; Q := CV >= PV;"
    elif kind == "D":
        data = f"CD, LD: BOOL; PV: {data_type} -> Q: BOOL; CV: {data_type}"
        text = f"IF LD THEN CV := PV; ELSIF CD AND {down} END_IF; Q := CV <= 0;"
    else:
        data = f"CU, CD, R, LD: BOOL; PV: {data_type} -> QU, QD: BOOL; CV: {data_type}"
        text = (
            f"IF R THEN CV := 0; ELSIF LD THEN CV := PV; ELSIF NOT (CU AND CD) THEN "
            f"IF CU AND {up} ELSIF CD AND {down} END_IF; END_IF; QU := CV >= PV; QD := CV <= 0;"
        )
    return function(name, "Counter", data, text)


def counter(name: str) -> model.SimpleFBType | None:
    """FB_CTU, FB_CTD_LINT and the like; None for other names."""
    match = _COUNTER.fullmatch(name)
    return _counter(name, match[1], match[2] or "INT") if match else None


FIXED: Final[dict[str, model.FBType]] = {
    **{name: function(name, "", data, text, internals) for name, (data, text, internals) in _SIMPLE.items()},
    **{
        name: model.ServiceInterfaceFBType(
            model.TypeHeader(name, comment="Timer"),
            interface("REQ(IN PT) -> CNF(Q ET)", "IN: BOOL; PT: TIME -> Q: BOOL; ET: TIME"),
        )
        for name in _TIMERS
    },
    "E_STOPWATCH": model.ServiceInterfaceFBType(
        model.TypeHeader("E_STOPWATCH", comment="Measures the time between two events"),
        interface("START, ET, STOP, RESET -> EO(TD), ETO(TD), RESETO(TD)", "-> TD: TIME"),
    ),
}
"""The blocks whose name carries no type, by name."""
