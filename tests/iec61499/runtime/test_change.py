"""A resource that is changed step by step is as one that begins with the last network, and does no work twice."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499 import model
from iec61499.runtime.entries import Entries, EntryGenerator
from iec61499.runtime.linking.linker import Linker, link
from iec61499.runtime.linking.netlist import Netlist, Terminal
from iec61499.runtime.operation import Operation
from iec61499.runtime.resource import Resource
from iec61499.standard.notation import interface
from tests.support.iec61499.networks import Types, chart, connections, network

ADDER = chart(
    "ADDER",
    "REQ(X) -> CNF(Y)",
    "X, K: LINT -> Y: LINT",
    {"IDLE": [], "ADD": [("Y := X + K + 1;", "CNF")]},
    [("IDLE", "REQ", "ADD"), ("ADD", "1", "IDLE")],
)
PAIR = model.CompositeFBType(
    model.TypeHeader("PAIR"),
    interface("REQ(X) -> CNF(Y)", "X: LINT -> Y: LINT"),
    replace(
        network("A: ADDER; B: ADDER", parameters={"B.K": "3"}),
        events=connections("REQ -> A.REQ; A.CNF -> B.REQ; B.CNF -> CNF"),
        data=connections("X -> A.X; A.Y -> B.X; B.Y -> Y"),
    ),
)
AREA = model.SubApplicationType(
    model.TypeHeader("AREA"),
    PAIR.interface,
    replace(
        network("A: ADDER; B: PAIR"),
        events=connections("REQ -> A.REQ; A.CNF -> B.REQ; B.CNF -> CNF"),
        data=connections("X -> A.X; A.Y -> B.X; B.Y -> Y"),
    ),
)
LIBRARY = Types(ADDER, PAIR, AREA)
EVENTS = {"ADDER": ("REQ", "CNF"), "PAIR": ("REQ", "CNF"), "AREA": ("REQ", "CNF"), "F_MOVE": ("REQ", "CNF")}
DATA = {"ADDER": ("X", "Y"), "PAIR": ("X", "Y"), "AREA": ("X", "Y"), "F_MOVE": ("IN", "OUT")}
USUAL = {"N0": "ADDER", "N1": "F_MOVE", "N2": "AREA", "N3": "PAIR", "N4": "ADDER", "N5": "PAIR"}
NAMES = tuple(USUAL)
PAIRS = [(a, b) for a in NAMES for b in NAMES if a < b]


@st.composite
def networks(draw: st.DrawFn) -> model.FBNetwork:
    """Up to six blocks in any order, connected without a loop; most are of the type that they are in others."""
    names = draw(st.permutations(NAMES))[: draw(st.integers(3, 6))]
    kinds = {name: USUAL[name] for name in names}
    constants = {}
    if draw(st.integers(0, 3)) == 0:
        kinds[names[0]] = draw(st.sampled_from(list(EVENTS)))
    if kinds[names[1]] == "ADDER" and draw(st.booleans()):
        constants[f"{names[1]}.K"] = "10"
    pairs = [pair for pair in PAIRS if set(pair) <= set(names)]
    events = draw(st.lists(st.sampled_from(pairs), unique=True))
    data = draw(st.lists(st.sampled_from(pairs), unique_by=lambda pair: pair[1], min_size=1))
    return replace(
        network("; ".join(f"{n}: {kinds[n]}" for n in names), parameters=constants),
        events=tuple(model.Connection(f"{a}.{EVENTS[kinds[a]][1]}", f"{b}.{EVENTS[kinds[b]][0]}") for a, b in events),
        data=tuple(model.Connection(f"{a}.{DATA[kinds[a]][1]}", f"{b}.{DATA[kinds[b]][0]}") for a, b in data),
    )


def drawn(netlist: Netlist) -> tuple[object, ...]:
    """What a netlist says, without the numbers of its nodes."""

    def named(port: Terminal) -> tuple[str, str, bool]:
        return netlist.nodes[port.node].name, port.name, port.inner

    return (
        [(node.name, node.type, node.parameters) for node in netlist.nodes.values()],
        [(named(wire.source), named(wire.destination)) for wire in netlist.events],
        [(named(port), named(wire.source)) for port, wire in netlist.data.items()],
    )


@given(st.lists(networks(), min_size=2, max_size=5))
def test_a_changed_netlist_is_that_of_the_last_network(steps: list[model.FBNetwork]) -> None:
    linker = Linker(LIBRARY.find)
    for step in steps:
        assert drawn(linker.link(step)) == drawn(link(step, LIBRARY.find))


@given(st.lists(networks(), min_size=2, max_size=5), st.booleans())
def test_a_changed_resource_does_what_the_last_network_does(steps: list[model.FBNetwork], forces: bool) -> None:
    changed = Resource(steps[0], LIBRARY)
    for step in steps[1:]:
        changed.change(step)
    last = Resource(steps[-1], LIBRARY)
    blocks = {block.name: block.type_name for block in steps[-1].blocks if block.type_name != "AREA"}
    first = next(iter(blocks), "")
    if forces and first:
        port = f"{first}.{DATA[blocks[first]][1]}"
        for resource in (changed, last):
            resource.change(steps[-1], Operation(forced={port: 77}))
    for resource in (changed, last):
        resource.reset()
        for name, kind in blocks.items():
            resource.trigger(f"{name}.{EVENTS[kind][0]}")
            resource.run_until_idle()
    assert changed.names() == last.names()
    assert changed.states() == last.states()


def test_what_stays_is_not_linked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    few = network("A: ADDER; B: PAIR; C: F_MOVE", "A.CNF -> B.REQ", "A.Y -> B.X; B.Y -> C.IN")
    more = network(
        "A: ADDER; B: PAIR; C: F_MOVE; D: ADDER",
        "A.CNF -> B.REQ; B.CNF -> D.REQ",
        "A.Y -> B.X; B.Y -> C.IN; B.Y -> D.X",
    )
    linker = Linker(LIBRARY.find)
    before, after = linker.link(few), linker.link(more)
    assert [after.nodes[number] for number in before.nodes] == list(before.nodes.values())
    assert all(after.data[port] is wire for port, wire in before.data.items())
    resource = Resource(few, LIBRARY)
    generated = []
    original = EntryGenerator.entries

    def entries(self: EntryGenerator, number: int, known: Entries | None) -> Entries:
        generated.append(number)
        return original(self, number, known)

    monkeypatch.setattr(EntryGenerator, "entries", entries)
    resource.change(more)
    assert len(generated) == 1


def test_a_change_that_fails_leaves_no_trace() -> None:
    steps = [
        network("A: ADDER; C: F_MOVE", "A.CNF -> C.REQ", "A.Y -> C.IN"),
        network("A: ADDER; C: F_MOVE; S: F_CONCAT", "", "C.OUT -> S.IN1; S.OUT -> A.X"),
        network("A: ADDER; C: F_MOVE; B: ADDER", "A.CNF -> C.REQ; C.CNF -> B.REQ", "A.Y -> C.IN; C.OUT -> B.X"),
    ]
    resource = Resource(steps[0], LIBRARY)
    with pytest.raises(FunctionBlockError):
        resource.change(steps[1])
    resource.write("A.X", 4)
    resource.trigger("A.REQ")
    resource.run_until_idle()
    assert resource.read("C.OUT") == 5
    resource.change(steps[2])
    resource.trigger("A.REQ")
    resource.run_until_idle()
    assert resource.read("B.Y") == 6


def test_a_second_source_is_refused_by_a_change_too_but_not_the_same_connection_once_more() -> None:
    once = network("A: ADDER; B: ADDER; C: ADDER", "", "A.Y -> B.X")
    resource = Resource(once, LIBRARY)
    resource.change(replace(once, data=once.data * 2))
    two = network("A: ADDER; B: ADDER; C: ADDER", "", "A.Y -> B.X; C.Y -> B.X")
    with pytest.raises(FunctionBlockError, match="already has a source"):
        resource.change(two)
