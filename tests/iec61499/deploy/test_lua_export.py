"""Blocks as Lua: they do what the embedded runtime does, and what Lua or FORTE cannot take is refused by name."""

from __future__ import annotations

from functools import cache

import lupa.lua54
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from dtwin.parameters import ROOT
from iec61499 import model
from iec61499.deploy.device_type import DeviceType, original_name
from iec61499.deploy.lua_export import export_type
from iec61499.library import Library
from iec61499.management.protocol import REQUEST_LIMIT
from iec61499.standard.notation import interface
from iec61499.types import ArrayType, ElementaryType
from tests.iec61499.runtime.test_chart import STATES, Interpreter, action_lists, transition_lists
from tests.support.examples import examples
from tests.support.iec61499.lua_bench import INTERPRETERS, LuaBench, same
from tests.support.iec61499.networks import Bench, chart

LIBRARY = Library([ROOT / "fb"])
ALGORITHMIC = [
    name for name in LIBRARY.names() if isinstance(LIBRARY.find(name), model.BasicFBType | model.SimpleFBType)
]


def basic(name: str) -> model.BasicFBType:
    found = LIBRARY.find(name)
    assert isinstance(found, model.BasicFBType)
    return found


@cache
def exported(name: str) -> DeviceType:
    """A block of the library as Lua, made once for all examples."""
    return export_type(basic(name))


@examples(100)
@given(
    st.fixed_dictionaries(dict.fromkeys(STATES, action_lists)),
    transition_lists,
    st.lists(st.sampled_from(["E", "F"]), max_size=6),
    st.sampled_from(list(INTERPRETERS)),
)
def test_generated_charts_follow_the_rules(
    states: dict[str, list[tuple[str, str]]],
    transitions: list[tuple[str, str, str, str]],
    events: list[str],
    interpreter: str,
) -> None:
    arrows = [
        (source, f"{trigger}[{guard or '1'}]" if trigger else guard or "1", destination)
        for source, trigger, guard, destination in transitions
    ]
    block = chart("T", "E, F -> P(N), Q(N)", "-> N: DINT", {s: states[s] for s in STATES}, arrows)
    bench = LuaBench(export_type(block), interpreter)
    rules = Interpreter(states, transitions)
    for event in events:
        expected = rules.fire(event)
        if expected is None:
            return
        assert bench.fire(event) == expected
        assert (STATES[bench.state], bench["N"]) == (rules.state, rules.n)


def values(data_type: object) -> st.SearchStrategy[object]:
    if isinstance(data_type, ArrayType):
        length = data_type.upper - data_type.lower + 1
        return st.lists(values(data_type.element), min_size=1, max_size=4).map(
            lambda some: [some[k % len(some)] for k in range(length)]
        )
    assert isinstance(data_type, ElementaryType)
    if data_type.kind == "real":
        return st.one_of(st.floats(-4, 4), st.floats())
    if data_type.kind == "bool":
        return st.booleans()
    if data_type.kind == "string":
        return st.sampled_from(["", "pickup", "blue", "red", "green", 'it\'s "pink"\n'])
    return st.one_of(st.integers(-3, 9), st.integers(data_type.minimum, data_type.maximum))


@pytest.mark.parametrize("name", ALGORITHMIC)
@examples(60)
@given(st.data())
def test_the_library_does_the_same_as_in_the_embedded_runtime(name: str, data: st.DataObject) -> None:
    block = basic(name)
    embedded, lua = Bench(name, *(basic(n) for n in ALGORITHMIC)), LuaBench(exported(name))
    variables = {v.name: v for v in (*block.interface.inputs, *block.interface.outputs, *block.internals)}
    for variable in variables.values():
        lua[variable.name] = embedded[variable.name]
    events = [event.name for event in block.interface.event_inputs]
    for event in ["INIT"] * ("INIT" in events) + data.draw(st.lists(st.sampled_from(events), max_size=8)):
        given_ = data.draw(st.dictionaries(st.sampled_from([v.name for v in block.interface.inputs]), st.none()))
        inputs = {port: data.draw(values(variables[port].type)) for port in given_}
        try:
            expected = embedded.fire(event, **inputs)
        except FunctionBlockError:  # such as a number of vehicles for which there is no room
            with pytest.raises(lupa.lua54.LuaError):
                lua.fire(event, **inputs)
            return
        assert lua.fire(event, **inputs) == expected
        for name in variables:
            assert same(lua[name], embedded[name]), name
        assert block.states[lua.state].name == embedded["$ECC"]


def test_simple_blocks_run_the_actions_of_the_event() -> None:
    states = (
        model.ECState("REQ", (model.ECAction("ADD", "CNF"),)),
        model.ECState("CLEAR", (model.ECAction("ZERO", "CLEARED"),)),
    )
    algorithms = (
        model.Algorithm("ADD", model.Source("Q := Q + X;")),
        model.Algorithm("ZERO", model.Source("Q := 0;")),
    )
    ports = interface("REQ(X), IDLE, CLEAR -> CNF(Q), CLEARED(Q)", "X: INT -> Q: INT")
    bench = LuaBench(export_type(model.SimpleFBType(model.TypeHeader("S"), ports, (), states, algorithms)))
    assert [bench.fire("REQ", X=2), bench.fire("REQ", X=3), bench["Q"]] == [["CNF"], ["CNF"], 5]
    assert [bench.fire("IDLE"), bench["Q"]] == [[], 5]
    assert [bench.fire("CLEAR"), bench["Q"]] == [["CLEARED"], 0]


def block_of(text: str, data: str, internals: str = "") -> model.BasicFBType:
    states = {"START": [], "S": [(text, "CNF")]}
    return chart("T", "REQ -> CNF", data, states, [("START", "REQ", "S"), ("S", "1", "START")], internals)


def test_arrays_are_loaded_and_stored_as_a_whole() -> None:
    text = "FOR I := 0 TO 3 DO Y[I] := Y[I] + 2.0 * X[I]; END_FOR; Z := X;"
    bench = LuaBench(export_type(block_of(text, "X: LREAL[4] -> Y, Z: LREAL[4]", "I: INT")))
    assert bench.fire("REQ", X=[1.0, 2.0, 3.0, 4.5]) == ["CNF"]
    bench.fire("REQ")
    assert bench["Y"] == [4.0, 8.0, 12.0, 18.0]
    assert bench["Z"] == [1.0, 2.0, 3.0, 4.5]


def test_times_may_be_passed_on_but_not_computed_with() -> None:
    bench = LuaBench(export_type(block_of("Y := X;", "X: TIME -> Y: TIME")))
    bench.fire("REQ", X=2**53 + 1)
    assert bench["Y"] == 2**53 + 1
    with pytest.raises(FunctionBlockError, match="TIME has 64 bit and a number in Lua holds integers of 53 bit"):
        export_type(block_of("Y := X + X;", "X: TIME -> Y: TIME"))


def test_a_chart_that_never_rests_is_an_error() -> None:
    states: dict[str, list[tuple[str, str]]] = {"START": [], "A": [], "B": []}
    bench = LuaBench(
        export_type(chart("T", "E ->", "", states, [("START", "E", "A"), ("A", "1", "B"), ("B", "1", "A")]))
    )
    with pytest.raises(Exception, match="T: more than 10000 transitions without an event"):
        bench.fire("E")


def test_the_name_follows_the_code_and_leads_back_to_the_type() -> None:
    one, other = (export_type(block_of(f"Y := {factor} * X;", "X: LREAL -> Y: LREAL")) for factor in (2.0, 3.0))
    assert one == export_type(block_of("Y := 2.0 * X;", "X: LREAL -> Y: LREAL"))
    assert one.name != other.name
    assert original_name(one.name) == original_name(other.name) == "T"
    assert one.block.header.name == one.name
    assert [original_name(name) for name in ("PATH_PLANNER", "T_0123456", "T_0123456G", "_01234567")] == [None] * 4


def test_initial_values_are_not_part_of_the_deployed_type() -> None:
    exported = export_type(basic("PATH_PLANNER"))
    assert {variable.initial for variable in exported.block.interface.inputs} == {""}


def test_what_a_request_cannot_hold_is_refused_with_its_size() -> None:
    block = block_of("".join(f"Y := Y + SIN(X * {i}.0);\n" for i in range(1000)), "X: LREAL -> Y: LREAL")
    with pytest.raises(
        FunctionBlockError, match=rf"T takes a request of \d{{5}} bytes as Lua: expected at most {REQUEST_LIMIT}"
    ):
        export_type(block)


@pytest.mark.parametrize(
    ("block", "complaint"),
    [
        (
            block_of("Y := 0;", f"{', '.join(f'X{i}' for i in range(256))}: INT -> Y: INT"),
            "T has 256 ports of one kind",
        ),
        (
            block_of(
                "".join(f"Y := Y + X{i};" for i in range(181)),
                f"{', '.join(f'X{i}' for i in range(181))}: INT -> Y: INT",
            ),
            "algorithm A0 uses 182 variables: expected at most 180",
        ),
    ],
)
def test_what_lua_cannot_hold_is_refused(block: model.BasicFBType, complaint: str) -> None:
    with pytest.raises(FunctionBlockError, match=complaint):
        export_type(block)
