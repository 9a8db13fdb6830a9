"""Legal names never meet generated Python, and hostile text ends in one message, soon."""

from __future__ import annotations

import pytest

from dtwin.errors import FunctionBlockError
from iec61499.literals import parse_duration, parse_literal
from iec61499.st.check import check_algorithm
from iec61499.st.parser import parse_algorithm
from iec61499.types import DINT, INT, TIME, ArrayType
from tests.support.iec61499.networks import Bench, chart

NAMES = (
    "range",
    "iter",
    "zip",
    "float",
    "int",
    "len",
    "abs",
    "str",
    "next",
    "list",
    "class",
    "state_",
    "name_",
    "_x",
)


@pytest.mark.parametrize("name", NAMES)
def test_a_variable_may_be_called_as_something_in_python(name: str) -> None:
    text = f"""
    {name} := {name} + ABS(X);
    FOR I := 1 TO 3 DO {name} := {name} + I; END_FOR;
    WHILE {name} < 20 DO {name} := {name} + 1; END_WHILE;
    Y := LINT_TO_LREAL(DINT_TO_LINT({name})) / INT_TO_LREAL(LEN(DINT_TO_STRING({name})));
    """
    block = chart(
        "NAMED",
        f"REQ(X) -> CNF({name} Y)",
        f"X: DINT -> {name}: DINT; Y: LREAL",
        {"START": [], "DO": [(text, "CNF")]},
        [("START", f"REQ[{name} >= 0]", "DO"), ("DO", "1", "START")],
        "I: DINT",
    )
    bench = Bench("NAMED", block)
    assert bench.fire("REQ", X=4) == ["CNF"]
    assert (bench[name], bench["Y"]) == (20, 10.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("9" * 5000, "5000 characters"),
        ("DINT#" + "9" * 5000, "5000 characters"),
        ("16#" + "F" * 5000, "5003 characters"),
        ("999999", "out of the range of INT"),
    ],
)
def test_numbers_of_many_digits_are_refused(text: str, message: str) -> None:
    with pytest.raises(FunctionBlockError, match=message) as caught:
        parse_literal(text, INT if text == "999999" else DINT)
    assert len(str(caught.value)) < 200


def test_repetitions_of_many_digits_are_refused() -> None:
    with pytest.raises(FunctionBlockError, match="5000 characters"):
        parse_literal(f"[{'9' * 5000}(T#1s)]", ArrayType(TIME, 0, 3))
    with pytest.raises(FunctionBlockError, match="more than the 4 elements"):
        parse_literal(f"[{'9' * 300}(T#1s)]", ArrayType(TIME, 0, 3))
    assert parse_duration("9" * 5000 + "s") is None


@pytest.mark.parametrize("bounds", ["0..99999, 0..99999", "0..255, 0..256", "0..65535"])
def test_arrays_count_their_elements_over_all_dimensions(bounds: str) -> None:
    with pytest.raises(FunctionBlockError, match="elements: expected at most 65535"):
        _check(f"VAR A: ARRAY [{bounds}] OF INT; END_VAR Y := 1;")


def test_the_variables_of_an_algorithm_have_a_limit() -> None:
    text = "".join(f"A{i}: ARRAY [0..9999] OF INT; " for i in range(7))
    with pytest.raises(FunctionBlockError, match="have 70000 elements: expected at most 65535"):
        _check(f"VAR {text} END_VAR Y := 1;")


def test_many_case_labels_are_refused_at_once() -> None:
    labels = ", ".join(str(i) for i in range(2001))
    with pytest.raises(FunctionBlockError, match="CASE has 2001 labels: expected at most 2000"):
        _check(f"CASE Y OF {labels}: Y := 1; END_CASE;")
    with pytest.raises(FunctionBlockError, match="expected at most 200000; divide the algorithm"):
        _check("CASE Y OF\n" + "".join(f"{i}: Y := {i};\n" for i in range(32_000)) + "END_CASE;")


def test_numbers_in_text_are_refused_where_they_stand() -> None:
    with pytest.raises(FunctionBlockError, match=r"^a\.fbt:2:6: 9+\.\.\. has 5000 characters"):
        _check("\nY := " + "9" * 5000 + ";")


def _check(text: str) -> None:
    check_algorithm(parse_algorithm(text, "a.fbt"), {"Y": DINT}, {"Y"})
