"""Counters, bistables, edges, timers and utilities with the ports of 4diac FORTE."""

from __future__ import annotations

import pytest

from dtwin.iec61499.library import Library
from dtwin.iec61499.runtime.resource import Resource
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
        (True, True, True),
        (False, False, False),
        (False, False, False),
    ]
    assert (off["ET"], on["ET"]) == (50_000_000, 0)


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
