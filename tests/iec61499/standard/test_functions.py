"""The F_ blocks: values, generic types, conversions and events."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.library import Library
from iec61499.runtime.resource import Resource
from tests.support.iec61499.networks import Bench, network


@pytest.mark.parametrize(
    ("kind", "type_name", "inputs", "expected"),
    [
        ("F_ADD", "INT", (3, 4), 7),
        ("F_ADD", "LREAL", (0.1, 0.2), 0.1 + 0.2),
        ("F_ADD", "TIME", (1, 2), 3),
        ("F_ADD_4", "DINT", (1, 2, 3, 4), 10),
        ("F_SUB", "INT", (3, 4), -1),
        ("F_SUB", "UINT", (3, 4), 65535),
        ("F_MUL", "LREAL", (1.5, 4.0), 6.0),
        ("F_MUL_3", "INT", (2, 3, 4), 24),
        ("F_DIV", "INT", (-7, 2), -3),
        ("F_DIV", "LREAL", (1.0, 0.0), math.inf),
        ("F_MOD", "INT", (-7, 2), -1),
        ("F_EXPT", "LREAL", (2.0, 10.0), 1024.0),
        ("F_MIN", "LREAL", (2.0, -3.0), -3.0),
        ("F_MAX", "INT", (2, -3), 2),
        ("F_AND", "WORD", (0x0FF0, 0x3C3C), 0x0C30),
        ("F_OR_3", "BOOL", (False, False, True), True),
        ("F_XOR", "BYTE", (0xFF, 0x0F), 0xF0),
        ("F_GT", "INT", (3, 3), False),
        ("F_GE", "INT", (3, 3), True),
        ("F_EQ", "STRING", ("red", "red"), True),
        ("F_NE", "STRING", ("red", "blue"), True),
        ("F_LE", "LREAL", (1.0, 2.0), True),
        ("F_LT", "LREAL", (2.0, 1.0), False),
        ("F_CONCAT", "STRING", ("re", "d"), "red"),
    ],
)
def test_functions_of_equal_inputs(kind: str, type_name: str, inputs: tuple[Any, ...], expected: Any) -> None:
    names = [f"IN{i}" for i in range(1, len(inputs) + 1)]
    bench = Bench(kind, probe=", ".join(f"{name}: {type_name}" for name in names))
    assert bench.fire("REQ", **dict(zip(names, inputs, strict=True))) == ["CNF"]
    assert bench["OUT"] == expected
    assert type(bench["OUT"]) is type(expected)


@pytest.mark.parametrize(
    ("kind", "type_name", "value", "expected"),
    [
        ("F_MOVE", "STRING", "green", "green"),
        ("F_NOT", "BOOL", True, False),
        ("F_NOT", "BYTE", 0x0F, 0xF0),
        ("F_ABS", "INT", -5, 5),
        ("F_SQRT", "LREAL", 2.0, math.sqrt(2.0)),
        ("F_LN", "LREAL", 2.0, math.log(2.0)),
        ("F_LOG", "LREAL", 1000.0, 3.0),
        ("F_EXP", "LREAL", 1.0, math.e),
        ("F_SIN", "LREAL", 0.5, math.sin(0.5)),
        ("F_COS", "LREAL", 0.5, math.cos(0.5)),
        ("F_TAN", "LREAL", 0.5, math.tan(0.5)),
        ("F_ASIN", "LREAL", 0.5, math.asin(0.5)),
        ("F_ACOS", "LREAL", 0.5, math.acos(0.5)),
        ("F_ATAN", "LREAL", 0.5, math.atan(0.5)),
        ("F_LEN", "STRING", "green", 5),
    ],
)
def test_functions_of_one_input(kind: str, type_name: str, value: Any, expected: Any) -> None:
    bench = Bench(kind, probe=f"IN: {type_name}")
    assert bench.fire("REQ", IN=value) == ["CNF"]
    assert bench["OUT"] == (pytest.approx(expected, rel=1e-15) if isinstance(expected, float) else expected)


def test_selection() -> None:
    select = Bench("F_SEL", probe="IN0: INT, IN1: INT")
    for g in (False, True):
        select.fire("REQ", G=g, IN0=10, IN1=11)
        assert select["OUT"] == 10 + g
    multiplex = Bench("F_MUX_3", probe="K: INT, IN1: LREAL, IN2: LREAL, IN3: LREAL")
    for k in range(3):
        multiplex.fire("REQ", K=k, IN1=1.0, IN2=2.0, IN3=3.0)
        assert multiplex["OUT"] == k + 1.0
    limit = Bench("F_LIMIT", probe="MN: LREAL, IN: LREAL, MX: LREAL")
    for value, expected in ((-9.0, -8.0), (0.5, 0.5), (9.0, 8.0)):
        limit.fire("REQ", MN=-8.0, IN=value, MX=8.0)
        assert limit["OUT"] == expected


def test_shifts_and_rotations() -> None:
    for kind, expected in (("F_SHL", 0x2468), ("F_SHR", 0x091A), ("F_ROL", 0x2469), ("F_ROR", 0x891A)):
        bench = Bench(kind, probe="IN: WORD, N: INT")
        value = 0x9234 if kind == "F_ROL" else 0x1234 if kind != "F_ROR" else 0x1235
        bench.fire("REQ", IN=value, N=1)
        assert bench["OUT"] == (expected if kind != "F_ROR" else 0x891A), kind


def test_strings() -> None:
    bench = Bench("F_MID", probe="IN: STRING, L: INT, P: INT")
    bench.fire("REQ", IN="green", L=3, P=2)
    assert bench["OUT"] == "ree"
    find = Bench("F_FIND", probe="IN1: STRING, IN2: STRING")
    find.fire("REQ", IN1="green", IN2="e")
    assert find["OUT"] == 3


@pytest.mark.parametrize(
    ("kind", "value", "expected"),
    [
        ("F_LREAL_TO_DINT", 2.6, 3),
        ("F_LREAL_TO_DINT", -2.6, -3),
        ("F_DINT_TO_INT", 65537, 1),
        ("F_INT_TO_LREAL", 3, 3.0),
        ("F_LREAL_TO_REAL", 0.1, 0.10000000149011612),
        ("F_BOOL_TO_INT", True, 1),
        ("F_INT_TO_STRING", -12, "-12"),
        ("F_STRING_TO_DINT", "42", 42),
    ],
)
def test_conversions(kind: str, value: Any, expected: Any) -> None:
    bench = Bench(kind)
    assert bench.fire("REQ", IN=value) == ["CNF"]
    assert bench["OUT"] == expected
    assert type(bench["OUT"]) is type(expected)


def test_time_and_number() -> None:
    bench = Bench("F_TIME_IN_S_TO_LREAL")
    bench.fire("REQ", IN=1_500_000_000)
    assert bench["OUT"] == 1.5
    scaled = Bench("F_MULTIME", probe="IN2: LREAL")
    scaled.fire("REQ", IN1=1_000_000, IN2=2.5)
    assert scaled["OUT"] == 2_500_000


def test_generic_inputs_meet_at_their_common_type() -> None:
    resource = Resource(
        network(
            "A: F_INT_TO_LREAL; B: F_REAL_TO_LREAL; I: F_LREAL_TO_INT; ADD: F_ADD; OUT: F_MOVE",
            "I.CNF -> ADD.REQ",
            "I.OUT -> ADD.IN1; A.OUT -> ADD.IN2; ADD.OUT -> OUT.IN",
        ),
        Library(),
    )
    assert str(resource.variable_type("ADD.OUT")) == "LREAL"
    assert str(resource.variable_type("OUT.OUT")) == "LREAL"


def test_generic_output_takes_the_type_of_its_destination() -> None:
    resource = Resource(network("S: SERVER_1_1; C: E_CTU", "", "S.RD_1 -> C.PV; C.Q -> S.SD_1"), Library())
    assert [str(kind) for kind in resource.port("S").receives] == ["UINT"]
    assert [str(kind) for kind in resource.port("S").sends] == ["BOOL"]


def test_generic_input_takes_the_type_of_its_literal() -> None:
    literals = {"A.IN": "UINT#5", "B.IN": "TRUE", "C.IN": "1.5", "D.IN": "'red'", "E.IN": "T#5ms", "F.IN": "7"}
    resource = Resource(network("; ".join(f"{n}: F_MOVE" for n in "ABCDEF"), "", "", literals), Library())
    types = [str(resource.variable_type(f"{n}.OUT")) for n in "ABCDEF"]
    assert types == ["UINT", "BOOL", "LREAL", "STRING", "TIME", "DINT"]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("T.OUT -> ADD.IN1; B.OUT -> ADD.IN2", "LREAL and TIME have no common type"),
        ("S.OUT -> ABS.IN", "ABS: STRING is no ANY_NUM"),
        ("B.OUT -> C.PV", "LREAL does not fit UINT: expected UINT or a conversion block such as F_LREAL_TO_UINT"),
    ],
)
def test_types_that_do_not_fit(data: str, message: str) -> None:
    blocks = "T: F_STRING_TO_TIME; S: F_INT_TO_STRING; B: F_INT_TO_LREAL; ADD: F_ADD; ABS: F_ABS; C: E_CTU"
    with pytest.raises(FunctionBlockError, match=message):
        Resource(network(blocks, "", data), Library())
