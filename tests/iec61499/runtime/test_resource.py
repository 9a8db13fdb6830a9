"""Networks: order of events, composites, subapplications, snapshots, and what is wrong in a network."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.errors import FunctionBlockError
from iec61499 import model
from iec61499.deploy.lua_export import export_type
from iec61499.library import Library
from iec61499.native.layout import network_layout
from iec61499.native.unit import unit_of
from iec61499.runtime import resource as runtime
from iec61499.runtime.resource import Resource
from iec61499.standard.notation import function, interface
from tests.support.iec61499.networks import Types, chart, connections, network

LOG = chart(
    "LOG",
    "E(X), RESET ->",
    "X: STRING -> TEXT: STRING",
    {"START": [], "ADD": [("TEXT := CONCAT(TEXT, X);", "")], "CLEAR": [("TEXT := '';", "")]},
    [("START", "E", "ADD"), ("ADD", "1", "START"), ("START", "RESET", "CLEAR"), ("CLEAR", "1", "START")],
)
NAME = chart(
    "NAME",
    "E(X) -> O(Q)",
    "X: STRING -> Q: STRING",
    {"START": [], "SAY": [("Q := X;", "O")]},
    [("START", "E", "SAY"), ("SAY", "1", "START")],
)
DOUBLE = chart(
    "DOUBLE",
    "E(X) -> O(Q)",
    "X: DINT -> Q: DINT",
    {"START": [], "RUN": [("Q := 2 * X;", "O")]},
    [("START", "E", "RUN"), ("RUN", "1", "START")],
)


def started(net: model.FBNetwork, *types: model.LibraryElement) -> Resource:
    resource = Resource(net, Types(*types))
    resource.start()
    return resource


def test_events_are_delivered_first_in_first_out() -> None:
    # A and B each lead to further blocks, which come after both
    names = "ABCDF"
    order = chart(
        "ORDER",
        "A, B, C, D, F ->",
        "-> TEXT: STRING",
        {"START": [], **{f"S{n}": [(f"TEXT := CONCAT(TEXT, '{n}');", "")] for n in names}},
        [("START", n, f"S{n}") for n in names] + [(f"S{n}", "1", "START") for n in names],
    )
    wires = (
        "START.COLD -> A.E; START.COLD -> B.E; A.O -> ALL.A; A.O -> C.E; A.O -> D.E; B.O -> ALL.B; B.O -> F.E;"
        "C.O -> ALL.C; D.O -> ALL.D; F.O -> ALL.F"
    )
    blocks = "START: E_RESTART; ALL: ORDER; " + "; ".join(f"{n}: NAME" for n in names)
    assert started(network(blocks, wires), NAME, order).read("ALL.TEXT") == "ABCDF"


def test_fan_out_follows_the_order_of_the_connections() -> None:
    for wires, text in (("A.O -> L.E; A.O -> L.RESET", ""), ("A.O -> L.RESET; A.O -> L.E", "a")):
        blocks = "START: E_RESTART; A: NAME; L: LOG"
        resource = started(network(blocks, f"START.COLD -> A.E; {wires}", "A.Q -> L.X", {"A.X": "'a'"}), NAME, LOG)
        assert resource.read("L.TEXT") == text


def composite(*, inner: str = "DOUBLE") -> model.CompositeFBType:
    return model.CompositeFBType(
        model.TypeHeader("TWICE"),
        interface("E(X), IGNORED -> O(Q), P", "X: DINT -> Q: DINT"),
        model.FBNetwork(
            (model.Block("FIRST", inner), model.Block("SECOND", "DOUBLE")),
            (),
            connections("E -> FIRST.E; FIRST.O -> SECOND.E; SECOND.O -> O; E -> P"),
            connections("X -> FIRST.X; FIRST.Q -> SECOND.X; SECOND.Q -> Q"),
        ),
    )


def test_composite_passes_events_and_data() -> None:
    resource = started(
        network(
            "START: E_RESTART; C: TWICE; D: DOUBLE; N: E_CTU",
            "START.COLD -> C.E; C.O -> D.E; C.P -> N.CU",
            "C.Q -> D.X",
            {"C.X": "5"},
        ),
        composite(),
        DOUBLE,
    )
    assert resource.names() == ("START", "C", "C.FIRST", "C.SECOND", "D", "N")
    assert [resource.read(name) for name in ("C.FIRST.Q", "C.SECOND.Q", "C.Q", "D.Q")] == [10, 20, 20, 40]
    assert resource.read("N.CV") == 1


def test_blocks_inside_see_what_the_composite_has_sampled() -> None:
    # IGNORED has no WITH: the composite's X, and with it the inner one, keeps its value
    outer = model.CompositeFBType(
        model.TypeHeader("C"),
        interface("TAKE(X), RUN -> O(Q)", "X: DINT -> Q: DINT"),
        model.FBNetwork(
            (model.Block("D", "DOUBLE"),), (), connections("RUN -> D.E; D.O -> O"), connections("X -> D.X; D.Q -> Q")
        ),
    )
    wires = "S.IND -> C.RUN; T.IND -> C.TAKE; START.COLD -> S.INIT; START.COLD -> T.INIT"
    given = {"S.QI": "TRUE", "S.ID": "'S'", "T.QI": "TRUE", "T.ID": "'T'"}
    resource = started(
        network("START: E_RESTART; S: SUBSCRIBE_0; T: SUBSCRIBE_1; C: C", wires, "T.RD_1 -> C.X", given),
        outer,
        DOUBLE,
    )

    def deliver(name: str, *values: int) -> int:
        resource.port(name).deliver(values)
        resource.run_until_idle()
        return int(resource.read("C.Q"))

    assert deliver("S") == 0
    assert deliver("T", 7) == 0
    assert deliver("S") == 14


def test_nested_composites() -> None:
    kinds: list[model.LibraryElement] = [DOUBLE, composite()]
    for depth in range(3):
        inner = kinds[-1].header.name
        kinds.append(
            model.CompositeFBType(
                model.TypeHeader(f"LEVEL{depth}"),
                interface("E(X) -> O(Q)", "X: DINT -> Q: DINT"),
                model.FBNetwork(
                    (model.Block("I", inner),),
                    (),
                    connections("E -> I.E; I.O -> O"),
                    connections("X -> I.X; I.Q -> Q"),
                ),
            )
        )
    resource = started(network("START: E_RESTART; C: LEVEL2", "START.COLD -> C.E", "", {"C.X": "3"}), *kinds)
    assert resource.read("C.Q") == 12
    assert resource.read("C.I.I.I.SECOND.Q") == 12


def test_a_type_that_contains_itself_is_refused() -> None:
    with pytest.raises(FunctionBlockError, match="contains itself"):
        Resource(network("C: TWICE"), Types(composite(inner="TWICE"), DOUBLE))


SUBAPPLICATION = model.SubApplicationType(
    model.TypeHeader("SUB"),
    interface("E -> O, THROUGH", "X: DINT; Y: DINT -> Q: DINT; SAME: DINT"),
    model.FBNetwork(
        (model.Block("D", "DOUBLE"), model.Block("D2", "DOUBLE")),
        (),
        connections("E -> D.E; E -> D2.E; D.O -> O; E -> THROUGH"),
        connections("X -> D.X; Y -> D2.X; D.Q -> Q; X -> SAME"),
    ),
)


def test_subapplications_disappear() -> None:
    sub = model.SubApplication("S", "SUB", parameters=(model.Parameter("Y", "11"),))
    outer = network(
        "START: E_RESTART; SRC: DOUBLE; SEE: DOUBLE; N: E_CTU",
        "START.COLD -> SRC.E; SRC.O -> S.E; S.O -> SEE.E; S.THROUGH -> N.CU",
        "SRC.Q -> S.X; S.SAME -> SEE.X",
        {"SRC.X": "3"},
    )
    net = model.FBNetwork(outer.blocks, (sub,), outer.events, outer.data)
    resource = started(net, SUBAPPLICATION, DOUBLE)
    assert resource.names() == ("START", "SRC", "SEE", "N", "S.D", "S.D2")
    values = [resource.read(name) for name in ("S.D.Q", "S.D2.Q", "SEE.Q", "N.CV")]
    assert values == [12, 22, 12, 1]


def test_untyped_subapplication() -> None:
    sub = model.SubApplication("S", "", SUBAPPLICATION.interface, SUBAPPLICATION.network)
    outer = network("START: E_RESTART", "START.COLD -> S.E")
    resource = started(model.FBNetwork(outer.blocks, (sub,), outer.events, ()), DOUBLE)
    assert resource.read("S.D.Q") == 0


def test_endless_loop_is_named() -> None:
    resource = Resource(
        network(
            "START: E_RESTART; A: E_MERGE; B: E_SPLIT; N: E_CTU",
            "START.COLD -> A.EI1; A.EO -> B.EI; B.EO1 -> A.EI2;B.EO2 -> N.R",
        ),
        Library(),
    )
    with pytest.raises(FunctionBlockError, match=r"endless loop of events: B\.EI -> A\.EI2 -> N\.R$"):
        resource.start()
    assert resource.is_idle


def test_an_error_inside_a_block_names_it() -> None:
    block = chart(
        "T",
        "E ->",
        "I: INT -> A: INT[3]",
        {"START": [], "S": [("A[I] := 1;", "")]},
        [("START", "E", "S"), ("S", "1", "START")],
    )
    with pytest.raises(FunctionBlockError, match=r"ARRAYS\.E: .*7"):
        started(network("START: E_RESTART; ARRAYS: T", "START.COLD -> ARRAYS.E", "", {"ARRAYS.I": "7"}), block)


def test_arrays_are_copied_by_value() -> None:
    fill = chart(
        "FILL",
        "E -> O(A)",
        "-> A: INT[3]",
        {"START": [], "S": [("A[0] := A[0] + 1;", "O")], "T": [("A[1] := 9;", "")]},
        [("START", "E", "S"), ("S", "1", "T"), ("T", "1", "START")],
    )
    keep = chart(
        "KEEP",
        "E(A) ->",
        "A: INT[3] -> B: INT[3]",
        {"START": [], "S": [("B := A;", "")]},
        [("START", "E", "S"), ("S", "1", "START")],
    )
    resource = started(
        network("START: E_RESTART; F: FILL; K: KEEP", "START.COLD -> F.E; F.O -> K.E", "F.A -> K.A"), fill, keep
    )
    assert resource.read("K.B") == [1, 0, 0]
    assert resource.read("F.A") == [1, 9, 0]
    resource.start()
    assert resource.read("K.B") == [2, 9, 0]


@pytest.mark.parametrize(
    ("source", "data_type", "value", "expected"),
    [("INT", "LREAL", 3, 3.0), ("REAL", "LREAL", 0.5, 0.5), ("USINT", "UINT", 200, 200), ("BOOL", "BYTE", True, 1)],
)
def test_connections_widen(source: str, data_type: str, value: object, expected: object) -> None:
    give = chart(
        "GIVE",
        "E(X) -> O(Q)",
        f"X: {source} -> Q: {source}",
        {"START": [], "S": [("Q := X;", "O")]},
        [("START", "E", "S"), ("S", "1", "START")],
    )
    take = chart("TAKE", "E(X) ->", f"X: {data_type} ->", {"START": []}, [])
    resource = Resource(
        network("START: E_RESTART; G: GIVE; T: TAKE", "START.COLD -> G.E; G.O -> T.E", "G.Q -> T.X"),
        Types(give, take),
    )
    resource.write("G.X", value)
    resource.start()
    assert resource.read("T.X") == expected
    assert type(resource.read("T.X")) is type(expected)


@pytest.mark.parametrize(
    ("blocks", "events", "data", "parameters", "message"),
    [
        ("A: E_SWICH", "", "", {}, "unknown block type E_SWICH: expected E_SWITCH"),
        ("A: E_SR", "A.EO -> B.EI", "", {}, r"1: connection A.EO -> B.EI: unknown block B: expected A"),
        ("A: E_SR", "A.EO -> A.T", "", {}, "A has no event input T: expected S or R"),
        ("A: E_SR", "A.S -> A.R", "", {}, r"A has no event output S \(it is another kind of port\): expected EO"),
        ("A: E_SR; B: E_PERMIT", "A.EO -> B.PERMIT", "", {}, r"B has no event input PERMIT \(it is another kind"),
        ("A: E_SR; B: E_PERMIT", "", "A.EO -> B.PERMIT", {}, r"A has no data output EO \(it is another kind of port"),
        ("A: E_SR; B: E_SR; C: E_PERMIT", "", "A.Q -> C.PERMIT; B.Q -> C.PERMIT", {},
         r"2: C.PERMIT already has a source in line 1"),
        ("A: E_CTU; B: E_PERMIT", "", "A.CV -> B.PERMIT", {}, "1: connection A.CV -> B.PERMIT: UINT does not fit"),
        ("A: E_SR", "A.EO -> A.S; A.EO -> A.S", "", {}, "2: A.EO is already connected to A.S in line 1"),
        ("A: E_CTU; B: E_PERMIT", "", "A.Q.X -> B.PERMIT", {}, r"Q.X \(connections of members of structures are not"),
        ("A: E_CTU", "EI -> A.CU", "", {}, "EI names no block: expected A.PORT"),
        ("A: E_CTU", "", "", {"A.CV": "1"}, "A has no data input CV: expected PV"),
        ("A: E_CTU", "", "", {"A.PV": "-1"}, "-1 is out of the range of UINT"),
        ("A: E_CTU", "", "", {"A.PV": "blue"}, "'blue' is not a UINT"),
    ],
)  # fmt: skip
def test_networks_that_are_wrong(
    blocks: str, events: str, data: str, parameters: dict[str, str], message: str
) -> None:
    with pytest.raises(FunctionBlockError, match=message):
        Resource(network(blocks, events, data, parameters), Library())


def test_reading_and_writing() -> None:
    resource = started(network("START: E_RESTART; N: E_CTU; S: F_STRING_TO_DINT; R: F_LREAL_TO_DINT"))
    resource.write("N.PV", 3)
    resource.write("S.IN", "12")
    resource.write("R.IN", 1)
    assert [resource.read(name) for name in ("N.PV", "S.IN", "R.IN", "N.$ECC")] == [3, "12", 1.0, "START"]
    for name, value, message in (
        ("N.PV", -1, "N.PV: expected 0 to 65535 for UINT, got -1"),
        ("N.PV", True, "expected a value of UINT, got True"),
        ("N.PV", 1.5, "expected a value of UINT, got 1.5"),
        ("R.IN", "1", "expected a value of LREAL"),
        ("S.IN", 1, "expected a value of STRING"),
        ("N.Q", 1, "expected a value of BOOL"),
        ("N.PW", 1, "N has no variable 'PW': expected PV"),
        ("M.PV", 1, "unknown block 'M': expected"),
        ("PV", 1, "unknown block ''"),
    ):
        with pytest.raises(FunctionBlockError, match=message):
            resource.write(name, value)
    with pytest.raises(FunctionBlockError, match="S does not communicate"):
        resource.port("S")


def machine() -> Resource:
    """Counters, a train of events and a latch, driven by a cycle."""
    return started(
        network(
            "START: E_RESTART; CYCLE: E_CYCLE; TRAIN: E_TRAIN; N: E_CTU; ADD: F_ADD; T: E_T_FF; WAIT: E_DELAY",
            "START.COLD -> CYCLE.START; CYCLE.EO -> N.CU; N.CUO -> ADD.REQ; ADD.CNF -> T.CLK; T.EO -> TRAIN.START;"
            "TRAIN.EO -> WAIT.START; WAIT.EO -> N.CU",
            "N.CV -> ADD.IN1; ADD.OUT -> TRAIN.N",
            {"CYCLE.DT": "T#10ms", "TRAIN.DT": "T#3ms", "ADD.IN2": "UINT#2", "WAIT.DT": "T#4ms"},
        )
    )


@given(st.lists(st.integers(0, 50_000_000), max_size=6), st.integers(0, 60_000_000))
def test_a_restored_resource_repeats_itself(before: list[int], after: int) -> None:
    resource, other = machine(), machine()
    for duration in before:
        resource.advance(duration)
    saved = resource.snapshot()
    resource.advance(after)
    reached = resource.snapshot()
    resource.restore(saved)
    assert resource.snapshot() == saved
    resource.advance(after)
    assert resource.snapshot() == reached
    # another resource of the same network takes over
    other.restore(saved)
    other.advance(after)
    assert other.snapshot() == reached


@given(st.lists(st.integers(1, 30_000_000), min_size=1, max_size=8))
def test_time_may_be_cut_anywhere(cuts: list[int]) -> None:
    at_once, in_pieces = machine(), machine()
    at_once.advance(sum(cuts))
    for cut in cuts:
        in_pieces.advance(cut)
    assert at_once.snapshot() == in_pieces.snapshot()


def test_reset_goes_back_to_the_beginning() -> None:
    resource = machine()
    resource.advance(50_000_000)
    assert resource.read("N.CV") > 0
    resource.reset()
    assert resource.read("N.CV") == 0
    assert resource.next_timer() is None
    assert resource.read("ADD.IN2") == 2


def test_a_snapshot_is_refused_while_events_wait() -> None:
    resource = started(
        network(
            "START: E_RESTART; S: SUBSCRIBE_0; N: E_CTU",
            "START.COLD -> S.INIT; S.IND -> N.CU",
            "",
            {"S.QI": "TRUE", "S.ID": "'x'"},
        )
    )
    resource.port("S").deliver(())
    with pytest.raises(FunctionBlockError, match="events wait"):
        resource.snapshot()
    resource.run_until_idle()
    assert resource.snapshot() == resource.snapshot()


def test_activation_limit_allows_long_chains() -> None:
    count = 2000
    wires = [
        "START.COLD -> M0.EI1",
        *(f"M{i}.EO -> M{i + 1}.EI1" for i in range(count - 1)),
        f"M{count - 1}.EO -> N.CU",
    ]
    blocks = "; ".join(["START: E_RESTART", "N: E_CTU", *(f"M{i}: E_MERGE" for i in range(count))])
    assert count < runtime.ACTIVATION_LIMIT
    assert started(network(blocks, "; ".join(wires))).read("N.CV") == 1


def test_resources_of_one_library_do_not_share_state() -> None:
    library = Types(DOUBLE)
    net = network("START: E_RESTART; D: DOUBLE; N: E_CTU", "START.COLD -> D.E; D.O -> N.CU")
    first, second = Resource(net, library), Resource(net, library)
    first.write("D.X", 4)
    first.start()
    assert [first.read("D.Q"), first.read("N.CV")] == [8, 1]
    assert [second.read("D.Q"), second.read("N.CV")] == [0, 0]


def test_texts_read_the_clock_of_their_resource() -> None:
    now = function(
        "NOW", "", "-> T: TIME; X: BOOL; D: DWORD", "T := NOW_MONOTONIC(); X := TIME() = T; D := T_PLC_US();"
    )
    made = network(
        "START: E_RESTART; E: E_DELAY; N: NOW", "START.COLD -> E.START; E.EO -> N.REQ", "", {"E.DT": "T#3ms"}
    )
    resource = Resource(made, Types(now))
    resource.start()
    resource.advance(10_000_000)
    assert [resource.read(f"N.{name}") for name in "TXD"] == [3_000_000, True, 3000]
    with pytest.raises(FunctionBlockError, match="a number in Lua holds integers of 53 bit"):
        export_type(now)
    with pytest.raises(FunctionBlockError, match="C: NOW_MONOTONIC is not supported"):
        unit_of(network_layout(network("N: NOW"), Types(now)), "unit")


def test_random_numbers_follow_from_their_seed() -> None:
    made = network("A: FB_RANDOM; B: FB_RANDOM", "", "", {"A.SEED": "7", "B.SEED": "8"})
    resource = Resource(made, Library())
    drawn: dict[str, list[float]] = {"A": [], "B": []}
    for _ in range(2):
        for name in drawn:
            resource.trigger(f"{name}.INIT")
            for _ in range(500):
                resource.trigger(f"{name}.REQ")
                resource.run_until_idle()
                drawn[name].append(resource.read(f"{name}.VAL"))
    assert drawn["A"][:500] == drawn["A"][500:]
    assert drawn["A"] != drawn["B"]
    for values in drawn.values():
        assert 0 <= min(values) < 0.05
        assert 0.95 < max(values) < 1
        assert sum(values) / 1000 == pytest.approx(0.5, abs=0.05)
