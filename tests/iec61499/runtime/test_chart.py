"""Execution control charts: the semantics of IEC 61499-1, 5.2.2."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499 import model
from iec61499.runtime.resource import Resource
from iec61499.standard.notation import interface
from tests.support.examples import examples
from tests.support.iec61499.networks import Bench, Types, chart, network


def test_transitions_are_tried_in_order() -> None:
    states: dict[str, list[tuple[str, str]]] = {"START": [], "FIRST": [("", "A")], "SECOND": [("", "B")]}
    arrows = [("START", "E[X > 0]", "FIRST"), ("START", "E", "SECOND"), ("START", "E[X > 1]", "FIRST")]
    back = [("FIRST", "1", "START"), ("SECOND", "1", "START")]
    bench = Bench("T", chart("T", "E(X) -> A, B", "X: INT ->", states, arrows + back))
    assert bench.fire("E", X=1) == ["A"]
    assert bench.fire("E", X=0) == ["B"]


def test_an_event_is_used_up_by_the_first_transition() -> None:
    states: dict[str, list[tuple[str, str]]] = {"START": [], "ONE": [("", "O")], "TWO": [("", "O")]}
    bench = Bench("T", chart("T", "E -> O", "", states, [("START", "E", "ONE"), ("ONE", "E", "TWO")]))
    assert bench.fire("E") == ["O"]
    assert bench["$ECC"] == "ONE"
    assert bench.fire("E") == ["O"]
    assert bench["$ECC"] == "TWO"
    assert bench.fire("E") == []


def test_transitions_without_event_go_on_until_none_is_true() -> None:
    states = {"START": [], "COUNT": [("N := N + 1;", "TICK")], "DONE": [("", "END")]}
    arrows = [("START", "E", "COUNT"), ("COUNT", "N < LIMIT", "COUNT"), ("COUNT", "[N >= LIMIT]", "DONE")]
    bench = Bench("T", chart("T", "E(LIMIT) -> TICK, END", "LIMIT: INT -> N: INT", states, arrows))
    assert bench.fire("E", LIMIT=4) == ["TICK"] * 4 + ["END"]
    assert bench["$ECC"] == "DONE"


def test_a_guard_without_event_waits_for_any_event() -> None:
    states: dict[str, list[tuple[str, str]]] = {"START": [], "ON": [("", "O")]}
    bench = Bench("T", chart("T", "E(X), F -> O", "X: BOOL ->", states, [("START", "[X]", "ON")]))
    assert bench.fire("E", X=False) == []
    bench.resource.write("DUT.X", True)
    assert bench["$ECC"] == "START"
    assert bench.fire("F") == ["O"]


def test_every_action_runs_its_algorithm_and_then_issues_its_event() -> None:
    states = {"START": [], "S": [("Q := 1;", "A"), ("Q := 2;", ""), ("", "B"), ("Q := 3;", "A")]}
    block = chart("T", "E -> A(Q), B(Q)", "-> Q: INT", states, [("START", "E", "S"), ("S", "1", "START")])
    resource = Resource(
        network(
            "START: E_RESTART; T: T; A: SEE; B: SEE",
            "START.COLD -> T.E; T.A -> A.E; T.B -> B.E",
            "T.Q -> A.X; T.Q -> B.X",
        ),
        Types(
            block,
            chart(
                "SEE",
                "E(X) ->",
                "X: INT -> SEEN: INT",
                {"S": [], "R": [("SEEN := SEEN * 10 + X;", "")]},
                [("S", "E", "R"), ("R", "1", "S")],
            ),
        ),
    )
    resource.start()
    # the events wait in the queue, so what is published last is what all of them sample
    assert resource.read("A.SEEN") == 33
    assert resource.read("B.SEEN") == 3


def test_data_are_published_with_the_event_and_not_before() -> None:
    states = {"START": [], "SET": [("Q := Q + 1;", "")], "TELL": [("", "TOLD")]}
    arrows = [("START", "E", "SET"), ("SET", "1", "START"), ("START", "F", "TELL"), ("TELL", "1", "START")]
    block = chart("T", "E, F -> TOLD(Q)", "-> Q: INT", states, arrows)
    look = chart("LOOK", "E(X) ->", "X: INT ->", {"S": []}, [])
    wires = "I.IND -> T.E; I.IND -> LOOK.E; J.IND -> T.F; J.IND -> LOOK.E; START.COLD -> I.INIT; START.COLD -> J.INIT"
    given = {"I.QI": "TRUE", "J.QI": "TRUE", "I.ID": "'I'", "J.ID": "'J'"}
    resource = Resource(
        network("START: E_RESTART; I: SUBSCRIBE_0; J: SUBSCRIBE_0; T: T; LOOK: LOOK", wires, "T.Q -> LOOK.X", given),
        Types(block, look),
    )
    resource.start()
    for name, expected in (("I", (1, 0)), ("J", (1, 1)), ("I", (2, 1)), ("I", (3, 1)), ("J", (3, 3))):
        resource.port(name).deliver(())
        resource.run_until_idle()
        assert (resource.read("T.Q"), resource.read("LOOK.X")) == expected


def test_inputs_are_sampled_by_their_event_only() -> None:
    add = chart(
        "T",
        "E(X), F(Y) -> O(Q)",
        "X, Y: INT -> Q: INT",
        {"START": [], "SUM": [("Q := 100 * X + Y;", "O")]},
        [("START", "E", "SUM"), ("START", "F", "SUM"), ("SUM", "1", "START")],
    )
    bench = Bench("T", add, probe="X: INT, Y: INT")
    assert bench.fire("E", X=1, Y=2) == ["O"]
    assert bench["Q"] == 100
    assert bench.fire("F", X=5, Y=2) == ["O"]
    assert bench["Q"] == 102
    bench.fire("E", X=5)
    assert bench["Q"] == 502


def test_a_state_is_entered_again_by_a_transition_to_itself() -> None:
    states = {"START": [("N := N + 1;", "O")]}
    bench = Bench("T", chart("T", "E -> O", "-> N: INT", states, [("START", "E", "START")]))
    assert [bench.fire("E"), bench["N"], bench.fire("E"), bench["N"]] == [["O"], 1, ["O"], 2]


def test_the_initial_state_runs_no_action_at_the_start() -> None:
    bench = Bench("T", chart("T", "E -> O", "-> N: INT", {"START": [("N := N + 1;", "O")]}, []))
    assert bench["N"] == 0


def test_conditions_of_older_tools() -> None:
    states: dict[str, list[tuple[str, str]]] = {"START": [], "ON": [("", "O")]}
    arrows = [("START", "E & X", "ON"), ("ON", "E AND NOT X", "START")]
    bench = Bench("T", chart("T", "E(X) -> O", "X: BOOL ->", states, arrows))
    assert bench.fire("E", X=False) == []
    assert bench.fire("E", X=True) == ["O"]
    bench.fire("E", X=False)
    assert bench["$ECC"] == "START"


def test_a_chart_that_never_rests_is_an_error() -> None:
    states: dict[str, list[tuple[str, str]]] = {"START": [], "A": [], "B": []}
    bench = Bench("T", chart("T", "E ->", "", states, [("START", "E", "A"), ("A", "1", "B"), ("B", "1", "A")]))
    with pytest.raises(FunctionBlockError, match=r"DUT\.E: DUT: more than 10000 transitions without an event"):
        bench.fire("E")


def test_many_states_go_through_the_loop_and_mean_the_same() -> None:
    count = 60
    start: dict[str, list[tuple[str, str]]] = {"START": []}
    states = start | {f"S{i}": [(f"N := N * 3 + {i};", "O")] for i in range(count)}
    arrows = [
        ("START", "E", "S0"),
        *((f"S{i}", "1", f"S{i + 1}") for i in range(count - 1)),
        (f"S{count - 1}", "1", "START"),
    ]
    bench = Bench("T", chart("T", "E -> O", "-> N: DINT", states, arrows))
    assert bench.fire("E") == ["O"] * count
    expected = 0
    for i in range(count):
        expected = (expected * 3 + i + 2**31) % 2**32 - 2**31
    assert bench["N"] == expected
    assert bench["$ECC"] == "START"


def test_simple_block_runs_its_actions_on_each_event() -> None:
    ports = interface("REQ(X), CLEAR -> CNF(Q), CLEARED(Q)", "X: INT -> Q: INT")
    states = (
        model.ECState("REQ", (model.ECAction("ADD", "CNF"),)),
        model.ECState("CLEAR", (model.ECAction("ZERO", "CLEARED"),)),
    )
    algorithms = (
        model.Algorithm("ADD", model.Source("Q := Q + X;")),
        model.Algorithm("ZERO", model.Source("Q := 0;")),
    )
    bench = Bench("S", model.SimpleFBType(model.TypeHeader("S"), ports, (), states, algorithms))
    assert [bench.fire("REQ", X=2), bench.fire("REQ", X=3), bench["Q"]] == [["CNF"], ["CNF"], 5]
    assert [bench.fire("CLEAR"), bench["Q"]] == [["CLEARED"], 0]


def test_names_that_mean_something_in_python() -> None:
    states = {"START": [], "S": [("is := in + _x;", "class")]}
    block = chart(
        "T",
        "def(in) -> class(is)",
        "in: INT -> is: INT",
        states,
        [("START", "def[in > 0]", "S"), ("S", "1", "START")],
        "_x: INT",
    )
    bench = Bench("T", block, probe="in: INT")
    bench.resource.write("DUT._x", 40)
    assert bench.fire("def", **{"in": 2}) == ["class"]
    assert bench["is"] == 42


GUARDS = {"": lambda n: True, "N < 3": lambda n: n < 3, "N MOD 2 = 0": lambda n: n % 2 == 0, "N > 5": lambda n: n > 5}
TEXTS = {"": lambda n: n, "N := N + 1;": lambda n: n + 1, "N := 0;": lambda n: 0, "N := 2 * N;": lambda n: 2 * n}
STATES = ("START", "A", "B", "C")

action_lists = st.lists(st.tuples(st.sampled_from(list(TEXTS)), st.sampled_from(["", "P", "Q"])), max_size=2)
transition_lists = st.lists(
    st.tuples(
        st.sampled_from(STATES),
        st.sampled_from(["E", "F", ""]),
        st.sampled_from(list(GUARDS)),
        st.sampled_from(STATES),
    ),
    max_size=8,
)


class Interpreter:
    """Follows the chart's rules step by step; None instead of events says that the chart does not come to rest."""

    def __init__(
        self, states: dict[str, list[tuple[str, str]]], transitions: list[tuple[str, str, str, str]]
    ) -> None:
        self.states, self.transitions = states, transitions
        self.state, self.n = "START", 0

    def fire(self, event: str) -> list[str] | None:
        issued: list[str] = []
        for _ in range(40):
            fired = next(
                (
                    destination
                    for source, trigger, guard, destination in self.transitions
                    if source == self.state and trigger in ("", event) and GUARDS[guard](self.n)
                ),
                None,
            )
            if fired is None:
                return issued
            self.state, event = fired, ""
            for text, output in self.states[fired]:
                self.n = (TEXTS[text](self.n) + 2**31) % 2**32 - 2**31
                issued += [output] if output else []
        return None


@examples(150)
@given(
    st.fixed_dictionaries(dict.fromkeys(STATES, action_lists)),
    transition_lists,
    st.lists(st.sampled_from(["E", "F"]), max_size=6),
)
def test_generated_code_follows_the_rules(
    states: dict[str, list[tuple[str, str]]], transitions: list[tuple[str, str, str, str]], events: list[str]
) -> None:
    arrows = [
        (source, f"{trigger}[{guard or '1'}]" if trigger else guard or "1", destination)
        for source, trigger, guard, destination in transitions
    ]
    bench = Bench("T", chart("T", "E, F -> P(N), Q(N)", "-> N: DINT", {s: states[s] for s in STATES}, arrows))
    rules = Interpreter(states, transitions)
    for event in events:
        expected = rules.fire(event)
        if expected is None:
            return
        assert bench.fire(event) == expected
        assert (bench["$ECC"], bench["N"]) == (rules.state, rules.n)
