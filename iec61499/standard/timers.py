"""The event-driven timers of 4diac IDE's library of events: pulse, on-delay, off-delay, and both delays.

They are told of their input by an event, and tell of their output Q by one when it changes, as the E_SR inside does.
"""

from __future__ import annotations

from typing import Final

from iec61499.standard.notation import composite, interface

_BLOCKS: Final = (
    composite(
        "E_PULSE",
        "Sets Q for PT with every request; one more does not make it longer",
        interface("REQ(PT), R -> CNF(Q)", "PT: TIME -> Q: BOOL"),
        "DLY: E_DELAY; OUT: E_SR",
        "REQ -> DLY.START; REQ -> OUT.S; DLY.EO -> OUT.R; OUT.EO -> CNF; R -> DLY.STOP; R -> OUT.R",
        "PT -> DLY.DT; OUT.Q -> Q",
    ),
    composite(
        "E_TP",
        "Sets Q for PT when IN is true at a request",
        interface("REQ(IN PT), R(IN) -> CNF(Q)", "IN: BOOL; PT: TIME -> Q: BOOL"),
        "GATE: E_PERMIT; DLY: E_DELAY; OUT: E_RS",
        "REQ -> GATE.EI; GATE.EO -> OUT.S; GATE.EO -> DLY.START; DLY.EO -> OUT.R; OUT.EO -> CNF;"
        "R -> DLY.STOP; R -> OUT.R",
        "IN -> GATE.PERMIT; PT -> DLY.DT; OUT.Q -> Q",
    ),
    composite(
        "E_TON",
        "Sets Q when IN has been true for PT; resets it when IN is false",
        interface("REQ(IN PT) -> CNF(Q)", "IN: BOOL; PT: TIME -> Q: BOOL"),
        "WAY: E_SWITCH; DLY: E_DELAY; OUT: E_RS",
        "REQ -> WAY.EI; WAY.EO1 -> DLY.START; WAY.EO0 -> DLY.STOP; WAY.EO0 -> OUT.R; DLY.EO -> OUT.S; OUT.EO -> CNF",
        "IN -> WAY.G; PT -> DLY.DT; OUT.Q -> Q",
    ),
    composite(
        "E_TOF",
        "Sets Q when IN is true; resets it when IN has been false for PT",
        interface("REQ(IN PT), R -> CNF(Q)", "IN: BOOL; PT: TIME -> Q: BOOL"),
        "WAY: E_SWITCH; DLY: E_DELAY; OUT: E_RS",
        "REQ -> WAY.EI; WAY.EO1 -> OUT.S; WAY.EO1 -> DLY.STOP; WAY.EO0 -> DLY.START; DLY.EO -> OUT.R; OUT.EO -> CNF;"
        "R -> OUT.R; R -> DLY.STOP",
        "IN -> WAY.G; PT -> DLY.DT; OUT.Q -> Q",
    ),
    composite(
        "E_TONOF",
        "Sets Q when IN has been true for PT_ON; resets it when IN has been false for PT_OFF",
        interface("REQ(IN PT_ON PT_OFF), R -> CNF(Q)", "IN: BOOL; PT_ON, PT_OFF: TIME -> Q: BOOL"),
        "WAY: E_SWITCH; ON: E_DELAY; OFF: E_DELAY; OUT: E_RS",
        "REQ -> WAY.EI; WAY.EO1 -> ON.START; WAY.EO1 -> OFF.STOP; WAY.EO0 -> ON.STOP; WAY.EO0 -> OFF.START;"
        "ON.EO -> OUT.S; OFF.EO -> OUT.R; OUT.EO -> CNF; R -> OUT.R; R -> OFF.STOP",
        "IN -> WAY.G; PT_ON -> ON.DT; PT_OFF -> OFF.DT; OUT.Q -> Q",
    ),
)
FIXED: Final = {block.header.name: block for block in _BLOCKS}
"""The blocks by name."""
