"""Every event block of IEC 61499-1, annex A, against its description."""

from __future__ import annotations

import pytest

from iec61499.library import Library
from iec61499.runtime.resource import Resource
from iec61499.standard.catalogue import find_standard, standard_names
from tests.support.iec61499.networks import Bench, network


def test_split_issues_its_outputs_in_order() -> None:
    assert Bench("E_SPLIT").fire("EI") == ["EO1", "EO2"]
    assert Bench("E_SPLIT_5").fire("EI") == ["EO1", "EO2", "EO3", "EO4", "EO5"]


@pytest.mark.parametrize(("kind", "count"), [("E_MERGE", 2), ("E_MERGE_7", 7)])
def test_merge_passes_every_input(kind: str, count: int) -> None:
    bench = Bench(kind)
    assert [bench.fire(f"EI{i}") for i in range(1, count + 1)] == [["EO"]] * count


def test_switch_and_select_follow_g() -> None:
    switch, select = Bench("E_SWITCH"), Bench("E_SELECT")
    assert switch.fire("EI", G=False) == ["EO0"]
    assert switch.fire("EI", G=True) == ["EO1"]
    assert select.fire("EI0", G=False) == ["EO"]
    assert select.fire("EI1", G=False) == []
    assert select.fire("EI0", G=True) == []
    assert select.fire("EI1", G=True) == ["EO"]


def test_permit_blocks_unless_permitted() -> None:
    bench = Bench("E_PERMIT")
    assert bench.fire("EI", PERMIT=False) == []
    assert bench.fire("EI", PERMIT=True) == ["EO"]


@pytest.mark.parametrize("order", [("EI1", "EI2"), ("EI2", "EI1")])
def test_rendezvous_waits_for_both(order: tuple[str, str]) -> None:
    first, second = order
    bench = Bench("E_REND")
    assert bench.fire(first) == []
    assert bench.fire(first) == []
    assert bench.fire(second) == ["EO"]
    # the rendezvous is over: a new one needs both again
    assert bench.fire(second) == []
    assert bench.fire("R") == []
    assert bench.fire(first) == []
    assert bench.fire(second) == ["EO"]


@pytest.mark.parametrize("kind", ["E_SR", "E_RS"])
def test_bistable_tells_changes_only(kind: str) -> None:
    bench = Bench(kind)
    assert bench.fire("R") == []
    assert bench.fire("S") == ["EO"]
    assert bench["Q"] is True
    assert bench.fire("S") == []
    assert bench.fire("R") == ["EO"]
    assert bench["Q"] is False


def test_flip_flops() -> None:
    latch, toggle = Bench("E_D_FF"), Bench("E_T_FF")
    assert latch.fire("CLK", D=False) == []
    assert latch.fire("CLK", D=True) == ["EO"]
    assert latch["Q"] is True
    assert latch.fire("CLK", D=True) == []
    assert toggle.fire("CLK") == ["EO"]
    assert toggle["Q"] is True
    assert toggle.fire("CLK") == ["EO"]
    assert toggle["Q"] is False


def test_generic_latch_takes_the_type_it_is_connected_to() -> None:
    bench = Bench("E_D_FF_ANY", probe="D: STRING")
    assert bench.fire("CLK", D="blue") == ["EO"]
    assert bench["Q"] == "blue"
    assert bench.fire("CLK", D="blue") == []


def test_edges() -> None:
    values = [False, True, True, False, False, True]
    rising, falling = Bench("E_R_TRIG"), Bench("E_F_TRIG")
    assert [len(rising.fire("EI", QI=value)) for value in values] == [0, 1, 0, 0, 0, 1]
    assert [len(falling.fire("EI", QI=value)) for value in values] == [0, 0, 0, 1, 0, 0]


def test_counter_up() -> None:
    bench = Bench("E_CTU", parameters={"PV": "2"})
    assert bench.fire("CU") == ["CUO"]
    assert (bench["CV"], bench["Q"]) == (1, False)
    assert bench.fire("CU") == ["CUO"]
    assert (bench["CV"], bench["Q"]) == (2, True)
    assert bench.fire("R") == ["RO"]
    assert (bench["CV"], bench["Q"]) == (0, False)


def test_counter_stops_at_its_largest_value() -> None:
    bench = Bench("E_CTU")
    bench.resource.write("DUT.CV", 65535)
    assert bench.fire("CU") == []
    assert bench["CV"] == 65535


def test_counter_down() -> None:
    bench = Bench("E_CTD", parameters={"PV": "2"})
    assert bench.fire("CD") == []
    assert bench.fire("LD") == ["LDO"]
    assert [bench.fire("CD") for _ in range(3)] == [["CDO"], ["CDO"], []]
    assert (bench["CV"], bench["Q"]) == (0, True)


def test_counter_both_ways() -> None:
    bench = Bench("E_CTUD", parameters={"PV": "2"})
    assert bench.fire("CD") == []
    assert bench.fire("LD") == ["LDO"]
    assert (bench["CV"], bench["QU"], bench["QD"]) == (2, True, False)
    assert bench.fire("CD") == ["CO"]
    assert bench.fire("CD") == ["CO"]
    assert (bench["CV"], bench["QU"], bench["QD"]) == (0, False, True)
    assert bench.fire("CU") == ["CO"]
    assert bench.fire("R") == ["RO"]
    assert (bench["CV"], bench["QU"], bench["QD"]) == (0, False, True)


def test_demultiplexer_and_multiplexer() -> None:
    four, three, from_which = Bench("E_DEMUX"), Bench("E_DEMUX_3"), Bench("E_MUX_3")
    assert [four.fire("EI", K=k) for k in range(5)] == [["EO0"], ["EO1"], ["EO2"], ["EO3"], []]
    assert [three.fire("EI", K=k) for k in range(4)] == [["EO1"], ["EO2"], ["EO3"], []]
    for number, event in enumerate(("EI1", "EI2", "EI3")):
        assert from_which.fire(event) == ["EO"]
        assert from_which["K"] == number


def test_delay_ignores_a_second_start() -> None:
    bench = Bench("E_DELAY", parameters={"DT": "T#10ms"})
    bench.fire("START")
    assert bench.advance(6) == []
    bench.fire("START")
    assert bench.advance(3.999) == []
    assert bench.advance(0.001) == ["EO"]
    assert bench.advance(100) == []


def test_retriggered_delay_begins_anew() -> None:
    bench = Bench("E_RDELAY", parameters={"DT": "T#10ms"})
    bench.fire("START")
    bench.advance(6)
    bench.fire("START")
    assert bench.advance(9.999) == []
    assert bench.advance(0.001) == ["EO"]


@pytest.mark.parametrize("kind", ["E_DELAY", "E_RDELAY", "E_CYCLE", "E_TRAIN"])
def test_stop_cancels(kind: str) -> None:
    parameters = {"DT": "T#10ms"} | ({"N": "3"} if kind == "E_TRAIN" else {})
    bench = Bench(kind, parameters=parameters)
    bench.fire("STOP")
    bench.fire("START")
    bench.advance(9)
    bench.fire("STOP")
    assert bench.advance(100) == []
    bench.fire("START")
    assert bench.advance(10) == ["EO"]


def test_cycle_does_not_drift() -> None:
    bench = Bench("E_CYCLE", parameters={"DT": "T#10ms"})
    bench.fire("START")
    assert bench.advance(9.999999) == []
    assert bench.advance(0.000001) == ["EO"]
    # one long step gives what many short ones give
    assert len(bench.advance(995)) == 99
    assert bench.resource.next_timer() == 1_010_000_000


@pytest.mark.parametrize("kind", ["E_CYCLE", "E_DELAY", "E_RDELAY"])
@pytest.mark.parametrize("time", ["T#0s", "T#1ns", "T#1us", "-T#1s"])
def test_no_time_is_shorter_than_a_tick_of_1_ms_as_in_forte(kind: str, time: str) -> None:
    bench = Bench(kind, parameters={"DT": time.replace("-T#", "T#-")})
    bench.fire("START")
    assert bench.advance(0.999999) == []
    assert bench.advance(0.000001) == ["EO"]
    assert len(bench.advance(100)) == (100 if kind == "E_CYCLE" else 0)


def test_train_counts_its_events() -> None:
    bench = Bench("E_TRAIN", parameters={"DT": "T#10ms", "N": "3"})
    bench.fire("START")
    seen = []
    for _ in range(5):
        seen.append((bench.advance(10), bench["CV"]))
    assert seen == [(["EO"], 0), (["EO"], 1), (["EO"], 2), ([], 2), ([], 2)]


@pytest.mark.parametrize("kind", ["E_TRAIN", "E_TABLE", "E_N_TABLE"])
def test_no_events_are_no_event(kind: str) -> None:
    delays = "T#10ms" if kind == "E_TRAIN" else "[T#10ms, T#10ms, T#10ms, T#10ms]"
    bench = Bench(kind, parameters={"DT": delays, "N": "0"})
    bench.fire("START")
    assert bench.advance(100) == []
    bench.fire("START", N=1)
    assert len(bench.advance(100)) == 1


def test_a_train_of_none_ends_the_one_that_runs() -> None:
    bench = Bench("E_TRAIN", parameters={"DT": "T#10ms", "N": "3"})
    bench.fire("START")
    assert bench.advance(10) == ["EO"]
    bench.fire("START", N=0)
    assert bench.advance(100) == []


def test_table_takes_its_delays_in_turn() -> None:
    bench = Bench("E_TABLE", parameters={"DT": "[T#10ms, T#20ms, T#30ms, T#40ms]", "N": "3"})
    bench.fire("START")
    assert [len(bench.advance(10)) for _ in range(8)] == [1, 0, 1, 0, 0, 1, 0, 0]
    assert bench["CV"] == 2


def test_table_with_an_output_each() -> None:
    bench = Bench("E_N_TABLE", parameters={"DT": "[T#1ms, T#1ms, T#1ms, T#1ms]", "N": "4"})
    bench.fire("START")
    assert [bench.advance(1) for _ in range(5)] == [["EO0"], ["EO1"], ["EO2"], ["EO3"], []]


def test_restart_is_cold_then_warm() -> None:
    blocks = "START: E_RESTART; COLD: E_CTU; WARM: E_CTU; STOP: E_CTU"
    wires = "START.COLD -> COLD.CU; START.WARM -> WARM.CU; START.STOP -> STOP.CU"
    resource = Resource(network(blocks, wires), Library())

    def counts() -> list[int]:
        return [resource.read(f"{name}.CV") for name in ("COLD", "WARM", "STOP")]

    resource.start()
    assert counts() == [1, 0, 0]
    resource.stop()
    assert counts() == [1, 0, 1]
    resource.start()
    assert counts() == [1, 1, 1]
    resource.reset()
    assert counts() == [0, 0, 0]
    resource.start()
    assert counts() == [1, 0, 0]


def test_stop_cancels_pending_timers() -> None:
    wires = "START.COLD -> CYCLE.START; CYCLE.EO -> COUNT.CU; START.WARM -> CYCLE.START"
    resource = Resource(
        network("START: E_RESTART; CYCLE: E_CYCLE; COUNT: E_CTU", wires, "", {"CYCLE.DT": "T#1ms"}), Library()
    )
    resource.start()
    resource.advance(3_000_000)
    resource.stop()
    resource.advance(3_000_000)
    assert resource.read("COUNT.CV") == 3
    resource.start()
    resource.advance(1_000_000)
    assert resource.read("COUNT.CV") == 4


def test_a_loop_through_no_delay_takes_a_tick_a_round() -> None:
    wires = "START.COLD -> WAIT.START; WAIT.EO -> WAIT.START; WAIT.EO -> COUNT.CU"
    parameters = {"COUNT.PV": "9"}
    resource = Resource(network("START: E_RESTART; WAIT: E_DELAY; COUNT: E_CTU", wires, "", parameters), Library())
    resource.start()
    resource.advance(5_000_000)
    assert resource.read("COUNT.CV") == 5


def test_every_listed_block_is_found() -> None:
    for name in standard_names():
        made = name.replace("_n_m", "_2_3").replace("_n", "_3").replace("F_X_TO_Y", "F_INT_TO_LREAL")
        made = made.replace("FB_CTU_X", "FB_CTU_DINT").replace("X2X", "INT2INT")
        made = made.replace("X_FROM_Y", "DWORD_FROM_BYTES").replace("X_INTO_Y", "WORD_INTO_BOOLS")
        block = find_standard(made)
        assert block is not None, made
        assert block.header.name == made


@pytest.mark.parametrize("name", ["E_SPLIT_1", "E_SPLIT_0", "E_SPLIT_999", "SERVER_1_101", "F_INT_TO_COLOUR", "E_"])
def test_names_that_are_no_block(name: str) -> None:
    assert find_standard(name) is None


def test_t_ff_sr_tells_of_changes_alone() -> None:
    bench = Bench("E_T_FF_SR")
    seen = [(bench.fire(event), bench["Q"]) for event in ("R", "S", "S", "CLK", "CLK", "R", "R", "CLK")]
    changes = [
        (["EO"], True),
        ([], True),
        (["EO"], False),
        (["EO"], True),
        (["EO"], False),
        ([], False),
        (["EO"], True),
    ]
    assert seen == [([], False), *changes]


def test_demux_8_counts_its_outputs_from_0() -> None:
    bench = Bench("E_DEMUX8")
    assert [bench.fire("EI", K=k) for k in range(9)] == [*([f"EO{k}"] for k in range(8)), []]
