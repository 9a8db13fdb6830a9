"""Counters, bistables, edges, timers and utilities with the ports of 4diac FORTE."""

from __future__ import annotations

import pytest

from iec61499.library import Library
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import Bench, network


def test_counters() -> None:
    bench = Bench("FB_CTUD", parameters={"PV": "2"})
    values = []
    for inputs in ({"CU": True}, {}, {}, {"CD": True}, {"CU": False}, {}, {}, {}, {"LD": True}, {"R": True}):
        assert bench.fire("REQ", **inputs) == ["CNF"]
        values.append((bench["CV"], bench["QU"], bench["QD"]))
    assert [value[0] for value in values] == [1, 2, 3, 3, 2, 1, 0, -1, 2, 0]
    assert values[1][1:] == (True, False)
    assert values[-1][1:] == (False, True)
    assert Bench("FB_CTU_LINT")["CV"] == 0


@pytest.mark.parametrize(
    ("kind", "steps"),
    [
        ("FB_SR", [({"S1": True, "R": True}, True), ({"S1": False}, False), ({"S1": True}, True)]),
        ("FB_RS", [({"S": True, "R1": True}, False), ({"R1": False}, True), ({"S": False}, True)]),
    ],
)
def test_bistables(kind: str, steps: list[tuple[dict[str, bool], bool]]) -> None:
    bench = Bench(kind)
    for inputs, expected in steps:
        bench.fire("REQ", **inputs)
        assert bench["Q1"] is expected


def test_edges() -> None:
    rising, falling = Bench("FB_R_TRIG"), Bench("FB_F_TRIG")
    seen = []
    for clock in (False, True, True, False, False):
        rising.fire("REQ", CLK=clock)
        falling.fire("REQ", CLK=clock)
        seen.append((rising["Q"], falling["Q"]))
    # as in 4diac FORTE, FB_F_TRIG takes a low level at the beginning for an edge
    assert seen == [(False, True), (True, False), (False, False), (False, True), (False, False)]


def test_timers_look_at_the_clock_when_they_are_asked() -> None:
    on = Bench("FB_TON", parameters={"PT": "T#50ms"})
    off = Bench("FB_TOF", parameters={"PT": "T#50ms"})
    pulse = Bench("FB_TP", parameters={"PT": "T#50ms"})
    seen = []
    for step in range(5):
        for bench in (on, off, pulse):
            bench.fire("REQ", IN=step < 3 if bench is not off else step < 1)
            bench.advance(30)
        seen.append((on["Q"], off["Q"], pulse["Q"]))
    assert seen == [
        (False, True, True),
        (False, True, True),
        (True, True, False),
        (False, False, False),
        (False, False, False),
    ]
    assert (off["ET"], on["ET"]) == (50_000_000, 0)


PULSES: list[list[tuple[int, bool, bool, int]]] = [
    # (ms, IN, Q, ET in ms) with PT = 1 s
    [(0, True, True, 0), (750, True, True, 750), (1250, True, False, 1000), (9000, True, False, 1000)],
    [(0, True, True, 0), (5000, True, False, 1000)],
    [(0, True, True, 0), (5000, False, False, 0), (6000, False, False, 0), (6100, True, True, 0)],
    [(0, True, True, 0), (500, False, True, 500), (5000, True, True, 0), (6000, True, False, 1000)],
    [(0, True, True, 0), (500, False, True, 500), (700, True, True, 700), (5000, True, False, 1000)],
    [(0, False, False, 0), (100, True, True, 0), (1100, False, False, 0), (1101, True, True, 0)],
]
"""Calls of an FB_TP after the timing diagram of IEC 61131-3, 6.6.3.5.5, table 46."""


def called(kind: str, calls: list[tuple[int, bool, bool, int]], pt: str = "T#1s") -> list[tuple[bool, int]]:
    """Q and ET (ms) after each call."""
    bench, seen, now = Bench(kind, parameters={"PT": pt}), [], 0
    for at, given, _, _ in calls:
        bench.advance(at - now)
        now = at
        assert bench.fire("REQ", IN=given) == ["CNF"]
        seen.append((bench["Q"], bench["ET"] // 1_000_000))
    return seen


@pytest.mark.parametrize("calls", PULSES)
def test_a_pulse_lasts_pt_and_the_next_edge_begins_another(calls: list[tuple[int, bool, bool, int]]) -> None:
    assert called("FB_TP", calls) == [(q, et) for _, _, q, et in calls]


@pytest.mark.parametrize("pt", ["T#0s", "T#-1s"])
@pytest.mark.parametrize(("kind", "expected"), [("FB_TON", True), ("FB_TOF", False), ("FB_TP", False)])
def test_no_time_is_over_at_once(kind: str, expected: bool, pt: str) -> None:
    edge = kind != "FB_TOF"
    calls = [(0, not edge, False, 0), (10, edge, False, 0)]
    assert called(kind, calls, pt)[1] == (expected, 0)


def test_elements_of_arrays() -> None:
    resource = Resource(
        network(
            "START: E_RESTART; M: VALUES2ARRAY_3_INT; G: GET_AT_INDEX; S: SET_AT_INDEX; V: INT2INT;"
            "O: ARRAY2ARRAY_3_INT; I: INT2INT",
            "START.COLD -> V.REQ; V.CNF -> M.REQ; M.CNF -> G.REQ; G.CNF -> S.REQ; S.CNF -> O.REQ; O.CNF -> I.REQ",
            "M.OUT -> G.IN_ARRAY; M.OUT -> S.IN_ARRAY; V.OUT -> S.VALUE; S.OUT_ARRAY -> O.IN; G.OUT -> I.IN",
            {"M.IN_1": "1", "M.IN_2": "2", "M.IN_3": "3", "V.IN": "9", "G.INDEX": "1", "S.INDEX": "2"},
        ),
        Library(),
    )
    resource.start()
    assert (resource.read("G.OUT"), resource.read("O.OUT"), resource.read("I.OUT")) == (2, [1, 2, 9], 2)
    assert resource.read("G.QO") is resource.read("S.QO") is True
    resource.write("G.INDEX", 3)
    resource.start()
    assert resource.read("G.QO") is False


def test_texts_are_put_together() -> None:
    resource = Resource(
        network(
            "START: E_RESTART; A: APPEND_STRING_2; S: STRING2STRING; I: INT2INT",
            "START.COLD -> S.REQ; S.CNF -> I.REQ; I.CNF -> A.REQ",
            "S.OUT -> A.IN_1; I.OUT -> A.IN_2",
            {"S.IN": "'n = '", "I.IN": "5"},
        ),
        Library(),
    )
    resource.start()
    assert resource.read("A.OUT") == "n = 5"
