"""Event function blocks of IEC 61499-1, annex A, with the ports of 4diac FORTE.

A block issues an event only where the annex says so: E_SR for example only when Q changes. The timed ones,
which no chart can describe, are in `services`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from iec61499 import model
from iec61499.standard.notation import basic, composite, function, interface
from iec61499.types import STRING

MAXIMUM_FAN: Final = 254
"""Most event inputs or outputs of one block, as in 4diac FORTE."""

TRIGGER: Final = replace(
    function("E_TRIG", "Triggers all events of a type that nothing is connected to", "EVENTTYPE: STRING ->", ""),
    interface=model.Interface(
        (model.EventPort("REQ", ("EVENTTYPE",)),),
        (model.EventPort("CNF"),),
        (model.Variable("EVENTTYPE", STRING, "'EInit'"),),
    ),
)
"""E_TRIG of 4diac FORTE 3: its event CNF goes to the events that it triggers before it goes on."""

_BLOCKS: Final = (
    TRIGGER,
    basic(
        "E_SWITCH",
        "Switches an event by a Boolean",
        "EI(G) -> EO0, EO1",
        "G: BOOL ->",
        [("EI[NOT G]", "", "EO0"), ("EI[G]", "", "EO1")],
    ),
    basic(
        "E_SELECT",
        "Selects between two events",
        "EI0(G), EI1(G) -> EO",
        "G: BOOL ->",
        [("EI0[NOT G]", "", "EO"), ("EI1[G]", "", "EO")],
    ),
    basic("E_PERMIT", "Lets an event through", "EI(PERMIT) -> EO", "PERMIT: BOOL ->", [("EI[PERMIT]", "", "EO")]),
    basic(
        "E_REND",
        "Rendezvous of two events",
        "EI1, EI2, R -> EO",
        "",
        [
            ("EI1[NOT E2]", "E1 := TRUE;", ""),
            ("EI1[E2]", "E2 := FALSE;", "EO"),
            ("EI2[NOT E1]", "E2 := TRUE;", ""),
            ("EI2[E1]", "E1 := FALSE;", "EO"),
            ("R", "E1 := FALSE; E2 := FALSE;", ""),
        ],
        "E1, E2: BOOL",
    ),
    basic(
        "E_SR",
        "Event-driven bistable, set first",
        "S, R -> EO(Q)",
        "-> Q: BOOL",
        [("S[NOT Q]", "Q := TRUE;", "EO"), ("R[Q]", "Q := FALSE;", "EO")],
    ),
    basic(
        "E_RS",
        "Event-driven bistable, reset first",
        "R, S -> EO(Q)",
        "-> Q: BOOL",
        [("R[Q]", "Q := FALSE;", "EO"), ("S[NOT Q]", "Q := TRUE;", "EO")],
    ),
    basic("E_D_FF", "Data latch", "CLK(D) -> EO(Q)", "D: BOOL -> Q: BOOL", [("CLK[D <> Q]", "Q := D;", "EO")]),
    basic("E_D_FF_ANY", "Data latch", "CLK(D) -> EO(Q)", "D: ANY -> Q: ANY", [("CLK[D <> Q]", "Q := D;", "EO")]),
    basic("E_T_FF", "Toggles with every event", "CLK -> EO(Q)", "-> Q: BOOL", [("CLK", "Q := NOT Q;", "EO")]),
    basic(
        "E_R_TRIG",
        "Detects a rising edge",
        "EI(QI) -> EO",
        "QI: BOOL ->",
        [("EI[QI AND NOT OLD]", "OLD := TRUE;", "EO"), ("EI[OLD AND NOT QI]", "OLD := FALSE;", "")],
        "OLD: BOOL",
    ),
    basic(
        "E_F_TRIG",
        "Detects a falling edge",
        "EI(QI) -> EO",
        "QI: BOOL ->",
        [("EI[OLD AND NOT QI]", "OLD := FALSE;", "EO"), ("EI[QI AND NOT OLD]", "OLD := TRUE;", "")],
        "OLD: BOOL",
    ),
    basic(
        "E_CTU",
        "Counts events up",
        "CU(PV), R -> CUO(Q CV), RO(Q CV)",
        "PV: UINT -> Q: BOOL; CV: UINT",
        [
            ("CU[CV < 65535]", "CV := CV + 1; Q := CV >= PV;", "CUO"),
            ("R", "CV := 0; Q := FALSE;", "RO"),
        ],
    ),
    basic(
        "E_CTD",
        "Counts events down",
        "CD, LD(PV) -> CDO(Q CV), LDO(Q CV)",
        "PV: UINT -> Q: BOOL; CV: UINT",
        [
            ("CD[CV > 0]", "CV := CV - 1; Q := CV = 0;", "CDO"),
            ("LD", "CV := PV; Q := CV = 0;", "LDO"),
        ],
    ),
    basic(
        "E_CTUD",
        "Counts events up and down",
        "CU(PV), CD, R, LD(PV) -> CO(QU QD CV), RO(QU QD CV), LDO(QU QD CV)",
        "PV: UINT -> QU, QD: BOOL; CV: UINT",
        [
            ("CU[CV < 65535]", "CV := CV + 1; QU := CV >= PV; QD := CV = 0;", "CO"),
            ("R", "CV := 0; QU := CV >= PV; QD := CV = 0;", "RO"),
            ("CD[CV > 0]", "CV := CV - 1; QU := CV >= PV; QD := CV = 0;", "CO"),
            ("LD", "CV := PV; QU := CV >= PV; QD := CV = 0;", "LDO"),
        ],
    ),
    basic(
        "E_CTUD_UDINT",
        "Counts events up and down, as E_CTUD",
        "CU(PV), CD, R, LD(PV) -> CO(QU QD CV), RO(QU QD CV), LDO(QU QD CV)",
        "PV: UDINT -> QU, QD: BOOL; CV: UDINT",
        [
            ("CU[CV < 4294967295]", "CV := CV + 1; QU := CV >= PV; QD := CV = 0;", "CO"),
            ("R", "CV := 0; QU := CV >= PV; QD := CV = 0;", "RO"),
            ("CD[CV > 0]", "CV := CV - 1; QU := CV >= PV; QD := CV = 0;", "CO"),
            ("LD", "CV := PV; QU := CV >= PV; QD := CV = 0;", "LDO"),
        ],
    ),
    basic(
        "E_TABLE_CTRL",
        "Steps through the delays of an E_TABLE",
        "INIT(DT N), CLK -> CLKO(DTO CV)",
        "DT: TIME[4]; N: UINT -> DTO: TIME; CV: UINT",
        [
            ("INIT[N > 0]", "CV := 0; DTO := DT[0];", "CLKO"),
            ("CLK[CV < 3 AND CV + 1 < N]", "CV := CV + 1; DTO := DT[CV];", "CLKO"),
        ],
    ),
    basic(
        "E_T_FF_SR",
        "Toggles Q at CLK, sets it at S and resets it at R; tells of every change",
        "S, R, CLK -> EO(Q)",
        "-> Q: BOOL",
        [("S[NOT Q]", "Q := TRUE;", "EO"), ("R[Q]", "Q := FALSE;", "EO"), ("CLK", "Q := NOT Q;", "EO")],
    ),
    basic(
        "E_TRAIN_CTRL",
        "Counts the events of an E_TRAIN",
        "INIT(N), CLK -> CLKO(CV), END(CV)",
        "N: UINT -> CV: UINT",
        [
            ("INIT[N > 0]", "CV := 0;", "CLKO"),
            ("INIT", "CV := 0;", "END"),
            ("CLK[CV + 1 < N]", "CV := CV + 1;", "CLKO"),
            ("CLK[CV < N]", "CV := CV + 1;", "END"),
        ],
    ),
    composite(
        "E_TRAIN",
        "Issues N events, DT apart",
        interface("START(DT N), STOP -> EO(CV)", "DT: TIME; N: UINT -> CV: UINT"),
        "CTRL: E_TRAIN_CTRL; DLY: E_DELAY",
        "START -> CTRL.INIT; CTRL.CLKO -> DLY.START; CTRL.END -> DLY.STOP; STOP -> DLY.STOP;"
        "DLY.EO -> EO; DLY.EO -> CTRL.CLK",
        "N -> CTRL.N; CTRL.CV -> CV; DT -> DLY.DT",
    ),
    composite(
        "E_TABLE",
        "Issues N events (4 at most), the n-th after a further delay DT[n]",
        interface("START(DT N), STOP -> EO(CV)", "DT: TIME[4]; N: UINT -> CV: UINT"),
        "CTRL: E_TABLE_CTRL; DLY: E_DELAY",
        "START -> CTRL.INIT; STOP -> DLY.STOP; CTRL.CLKO -> DLY.START; DLY.EO -> EO; DLY.EO -> CTRL.CLK",
        "DT -> CTRL.DT; N -> CTRL.N; CTRL.DTO -> DLY.DT; CTRL.CV -> CV",
    ),
    composite(
        "E_N_TABLE",
        "As E_TABLE, every event at its own output",
        interface("START(DT N), STOP -> EO0, EO1, EO2, EO3", "DT: TIME[4]; N: UINT ->"),
        "TABLE: E_TABLE; DEMUX: E_DEMUX",
        "START -> TABLE.START; STOP -> TABLE.STOP; TABLE.EO -> DEMUX.EI;"
        "DEMUX.EO0 -> EO0; DEMUX.EO1 -> EO1; DEMUX.EO2 -> EO2; DEMUX.EO3 -> EO3",
        "DT -> TABLE.DT; N -> TABLE.N; TABLE.CV -> DEMUX.K",
    ),
)


def split(name: str, count: int) -> model.BasicFBType:
    """E_SPLIT_n: one event becomes n."""
    outputs = [f"EO{i}" for i in range(1, count + 1)]
    return basic(name, "Splits an event", f"EI -> {', '.join(outputs)}", "", [("EI", "", " ".join(outputs))])


def merge(name: str, count: int) -> model.BasicFBType:
    """E_MERGE_n: any of n events becomes one."""
    inputs = [f"EI{i}" for i in range(1, count + 1)]
    return basic(name, "Merges events", f"{', '.join(inputs)} -> EO", "", [(event, "", "EO") for event in inputs])


def demultiplex(name: str, count: int) -> model.BasicFBType:
    """E_DEMUX_n: the event goes to the K-th output, counted from 0; nowhere when K is n or more.

    The outputs of E_DEMUX are EO0 to EO3, those of E_DEMUX_n EO1 to EOn, as in 4diac FORTE; those of E_DEMUX8 of
    4diac IDE EO0 to EO7.
    """
    first = 0 if name in ("E_DEMUX", "E_DEMUX8") else 1
    outputs = [f"EO{first + i}" for i in range(count)]
    rows = [(f"EI[K = {i}]", "", output) for i, output in enumerate(outputs)]
    return basic(name, "Sends an event to output K", f"EI(K) -> {', '.join(outputs)}", "K: UINT ->", rows)


def multiplex(name: str, count: int) -> model.BasicFBType:
    """E_MUX_n: K tells from which input the event came, counted from 0."""
    inputs = [f"EI{i}" for i in range(1, count + 1)]
    rows = [(event, f"K := {i};", "EO") for i, event in enumerate(inputs)]
    return basic(name, "Tells which event came", f"{', '.join(inputs)} -> EO(K)", "-> K: UINT", rows)


SIZED: Final = {"E_SPLIT": (split, 2), "E_MERGE": (merge, 2), "E_DEMUX": (demultiplex, 4), "E_MUX": (multiplex, 2)}
"""Makers of blocks whose name ends in their size, and the size of the block without a number."""
FIXED: Final = {block.header.name: block for block in (*_BLOCKS, demultiplex("E_DEMUX8", 8))}
"""The blocks whose name carries no size of this kind, by name."""
