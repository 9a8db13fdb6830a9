"""Traces of networks: they are what the standard's readers read, and a replay finds the first event that differs."""

from __future__ import annotations

import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dtwin.controller.embedded import EmbeddedController
from dtwin.controller.runtime import Runtime, chosen, running
from dtwin.errors import FunctionBlockError
from dtwin.parameters import ROOT
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings, sequence_of
from iec61499 import model
from iec61499.library import Library
from iec61499.mapping import resource_network
from iec61499.native.resource import NativeResource
from iec61499.runtime.resource import Resource
from iec61499.trace.ctf import LAYOUTS, TEXT, EventKind, Field, TraceWriter, encoding, read_trace
from iec61499.trace.recorder import Recorder
from iec61499.trace.replay import Replay, replay
from tests.support.iec61499.c_harness import needs_compiler
from tests.support.iec61499.networks import Types, chart, network

SIZE = 50_000_000


@pytest.fixture(scope="module", params=["python", pytest.param("native", marks=needs_compiler)])
def traced(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The trace of 15 s of the cell."""
    folder = tmp_path_factory.mktemp("trace") / "cell"
    settings = CellSettings(15.0, 3)
    writer = TraceWriter(folder, {"system": "dtwin.sys"}, SIZE)
    with chosen(request.param):
        sequence = sequence_of(settings)
        cell = Cell(settings, EmbeddedController(settings.control, settings.blocks, sequence, writer=writer))
        plain = Cell(settings)
    cell.run()
    plain.run()
    writer.close()
    assert (cell.log.freeze().stack("volts") == plain.log.freeze().stack("volts")).all()
    return folder


def repeated(folder: Path, blocks: Path = ROOT / "fb", until: str = "") -> Replay:
    library = Library([blocks])
    return replay(read_trace(folder), resource_network(library.load_system(blocks / "dtwin.sys")), library, until)


def changed(tmp_path: Path, file: str, old: str, new: str) -> Path:
    """The library of the cell with one thing changed."""
    folder = tmp_path / "fb"
    shutil.copytree(ROOT / "fb", folder)
    text = (folder / file).read_text()
    assert text.count(old) >= 1
    (folder / file).write_text(text.replace(old, new, 1))
    return folder


def test_a_replay_is_equal_to_the_end(traced: Path) -> None:
    found = repeated(traced)
    assert found.stop is None
    assert found.constants == ()
    assert found.count > 15 * 100 * 10


def test_a_changed_constant_of_an_algorithm_is_found_at_its_first_event(traced: Path, tmp_path: Path) -> None:
    found = repeated(traced, changed(tmp_path, "COMPUTED_TORQUE_CONTROL_3.fbt", "9.81", "9.8101"))
    assert found.stop is not None
    # the controller computes with it, and the selector is the first that gets the voltages
    assert found.stop.event == "SELECTOR.REQ"
    assert " was " in found.stop.reason


def test_a_changed_parameter_is_named_and_found_at_its_first_event(traced: Path, tmp_path: Path) -> None:
    blocks = changed(tmp_path, "dtwin.sys", 'Name="LENGTH" Value="350"', 'Name="LENGTH" Value="351"')
    found = repeated(traced, blocks)
    assert [name for name, _, _ in found.constants] == ["TWIN.LENGTH"]
    assert found.stop is not None
    assert (found.stop.event, found.stop.reason) == ("TWIN.INIT", "LENGTH was 350, is 351")


def test_a_breakpoint_stops_where_a_chart_enters_a_state(traced: Path) -> None:
    blocks = Library([ROOT / "fb"])
    kind = blocks.find("PATH_PLANNER")
    assert isinstance(kind, model.BasicFBType)
    found = repeated(traced, until=f"PLANNER.{kind.states[1].name}")
    assert found.stop is not None
    assert found.stop.is_breakpoint
    assert found.stop.event.startswith("PLANNER.")
    with pytest.raises(FunctionBlockError, match="PLANNER has no state 'NOWHERE': expected one of START, "):
        repeated(traced, until="PLANNER.NOWHERE")


def test_an_event_too_many_or_too_few_is_found(tmp_path: Path) -> None:
    double = chart(
        "DOUBLE",
        "E(X) -> O(Q)",
        "X: DINT -> Q: DINT",
        {"START": [], "RUN": [("Q := 2 * X;", "O")]},
        [("START", "E", "RUN"), ("RUN", "1", "START")],
    )
    library = Types(double)
    blocks = "START: E_RESTART; A: DOUBLE; B: DOUBLE"
    writer = TraceWriter(tmp_path / "t", {}, SIZE)
    recorder = Recorder(writer)
    resource = Resource(network(blocks, "START.COLD -> A.E; A.O -> B.E", "A.Q -> B.X", {"A.X": "4"}), library)
    recorder.start(0, resource.states())
    resource.trace(recorder)
    resource.write("B.X", 3)
    resource.start()
    recorder.flush()
    trace = read_trace(tmp_path / "t")
    assert replay(trace, network(blocks, "START.COLD -> A.E; A.O -> B.E", "A.Q -> B.X", {"A.X": "4"}), library) == (
        Replay(3, (), None)
    )
    fewer = replay(trace, network(blocks, "START.COLD -> A.E", "", {"A.X": "4"}), library).stop
    assert fewer is not None
    assert (fewer.event, fewer.reason) == ("B.E", "nothing happens here now")
    other = replay(trace, network(blocks, "START.COLD -> B.E; B.O -> A.E", "", {"A.X": "4"}), library).stop
    assert other is not None
    assert (other.event, other.reason) == ("A.E", "B.E comes now")


def test_a_full_trace_keeps_the_latest_events_and_counts_the_others(tmp_path: Path) -> None:
    writer = TraceWriter(tmp_path / "t", {}, 4000)
    kind = writer.kind("A.B", (Field("X", "lreal_t"),))
    encode = encoder(kind, ["value"], "time, value")
    for number in range(100):
        writer.write(encode(number, float(number)), 1, number, number)
    writer.close()
    kept = [record[1] for record in read_trace(tmp_path / "t").records()]
    assert kept == list(range(writer.begins, 100))
    assert len(kept) == writer.written - writer.dropped
    (file,) = (tmp_path / "t").glob("events-*")
    assert 3000 < file.stat().st_size <= 4000


def test_a_trace_without_its_beginning_is_not_replayed(traced: Path, tmp_path: Path) -> None:
    shutil.copytree(traced, tmp_path / "t")
    (tmp_path / "t" / "events-0").rename(tmp_path / "t" / "events-1")
    with pytest.raises(FunctionBlockError, match="has lost its beginning"):
        repeated(tmp_path / "t")


def encoder(kind: EventKind, expressions: list[str], arguments: str) -> Callable[..., bytes]:
    """What gives the bytes of a record."""
    space: dict[str, object] = {}
    encode: Callable[..., bytes] = eval(f"lambda {arguments}: {encoding([(kind, expressions)], space)}", space)
    return encode


@given(st.data())
def test_every_record_reads_back(data: st.DataObject) -> None:
    bounds = {"b": 7, "h": 15, "i": 31, "q": 63}
    values: list[object] = []
    fields = []
    for number, kind in enumerate(data.draw(st.lists(st.sampled_from(sorted(LAYOUTS)), max_size=6))):
        code = LAYOUTS[kind][1]
        count = 1 if kind == TEXT else data.draw(st.sampled_from((1, 1, 3)))
        fields.append(Field(f"V{number}", kind, count))
        one: st.SearchStrategy[object]
        if kind == TEXT:
            one = st.text()
        elif code in "fd":
            one = st.floats(width=32 if code == "f" else 64, allow_nan=False)
        elif code == "?":
            one = st.booleans()
        else:
            bits = bounds[code.lower()]
            low, high = (-(1 << bits), (1 << bits) - 1) if code.islower() else (0, (2 << bits) - 1)
            one = st.integers(low, high)
        values += [data.draw(one) for _ in range(count)]
    kind_of = EventKind(7, "A.B", tuple(fields))
    places = iter(range(len(values)))
    expressions = []
    for field in fields:
        taken = [f"v[{next(places)}]" for _ in range(field.count)]
        expressions.append(taken[0] if field.count == 1 else f"*({', '.join(taken)},)")
    encoded = encoder(kind_of, expressions, "time, v")(123, values)
    assert encoded[:10] == struct.pack("<Hq", 7, 123)
    assert kind_of.decode(encoded, 10, 123) == ((7, 123, *values), len(encoded))


@pytest.mark.parametrize("change", [lambda data: data[:-3], lambda data: b"x" + data, lambda data: data + b"\0"])
def test_a_damaged_trace_is_an_error(traced: Path, tmp_path: Path, change: Callable[[bytes], bytes]) -> None:
    shutil.copytree(traced, tmp_path / "t")
    stream = tmp_path / "t" / "events-0"
    stream.write_bytes(change(stream.read_bytes()))
    with pytest.raises(FunctionBlockError, match="is no stream of events at byte"):
        list(read_trace(tmp_path / "t").records())


def test_a_folder_without_a_trace_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FunctionBlockError, match="holds no trace"):
        read_trace(tmp_path)
    with pytest.raises(FunctionBlockError, match="cannot be a new trace"):
        TraceWriter(tmp_path, {}, SIZE)


@pytest.mark.skipif(not shutil.which("babeltrace2"), reason="babeltrace2 is not installed")
def test_babeltrace_reads_it(traced: Path, tmp_path: Path) -> None:
    lines = shown(traced)
    assert len(lines) == sum(1 for _ in read_trace(traced).records())
    assert any('EMULATOR.IND: { QO = 1, STATUS = "OK", RD_1 = ' in line for line in lines)
    writer = TraceWriter(tmp_path / "full", {}, 4000)
    kind = writer.kind("A.B", (Field("X", "dint_t"),))
    encode = encoder(kind, ["value"], "time, value")
    for number in range(100):
        writer.write(encode(0, number), 1, 0, 0)
    writer.close()
    kept = range(writer.dropped, 100)
    assert [line.rpartition("{ ")[2] for line in shown(tmp_path / "full")] == [f"X = {number} }}" for number in kept]


def shown(folder: Path) -> list[str]:
    """The lines that babeltrace2 prints, which has nothing to complain of."""
    done = subprocess.run(["babeltrace2", folder], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    return done.stdout.splitlines()


@needs_compiler
def test_machine_code_records_the_same_events_with_the_same_data(tmp_path: Path) -> None:
    """Values of every kind that C records, texts with characters that are escaped, and several packets."""
    kinds = ("BOOL", "SINT", "INT", "LINT", "UINT", "UDINT", "ULINT", "BYTE", "LWORD", "REAL", "LREAL", "TIME")
    outputs = "; ".join([*(f"V_{kind}: {kind}" for kind in kinds), "S: STRING", "V: LREAL[3]"])
    source = chart(
        "SOURCE",
        f"E -> F({' '.join([*(f'V_{kind}' for kind in kinds), 'S', 'V'])})",
        f"-> {outputs}",
        {"START": [], "ON": [("V[1] := V[1] + 0.5; V_INT := V_INT - 1; V_TIME := T#3ms; S := 'ü$00\\$27';", "F")]},
        [("START", "E", "ON"), ("ON", "1", "START")],
    )
    sink = chart(
        "SINK", f"E({' '.join([*(f'V_{k}' for k in kinds), 'S', 'V'])}) -> ", f"{outputs} -> ", {"START": []}, []
    )
    data = "; ".join(f"A.{name} -> B.{name}" for name in [*(f"V_{kind}" for kind in kinds), "S", "V"])
    drawn = network("A: SOURCE; B: SINK; R: E_RESTART", "R.COLD -> A.E; A.F -> B.E", data)
    found = []
    for name in get_args(Runtime):
        writer = TraceWriter(tmp_path / name, {"system": "test"}, SIZE)
        with chosen(name):
            blocks = running(drawn, Types(source, sink), writer)
        assert isinstance(blocks, Resource | NativeResource)
        blocks.start()
        for number in range(7000):
            blocks.trigger("A.E")
            blocks.run_until_idle()
            if number == 5:
                blocks.write("A.V", [1.0, float("nan"), 3.0])
        writer.close()
        trace = read_trace(tmp_path / name)
        assert writer.written > 14000
        found.append([(trace.kinds[record[0]].name, repr(record[1:])) for record in trace.records()])
    assert found[0] == found[1]
