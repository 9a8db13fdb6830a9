"""Boxes that are told apart by their masses: a weak arm keeps those that it can still hold."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dtwin.errors import DtwinError
from dtwin.line.control import Control, Devices, OneResource
from dtwin.line.file import FOLDER, line_of, load
from dtwin.line.floor import check_boxes
from dtwin.line.line import BoxClass, Line
from dtwin.line.plant import LineEvent, Plant
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import FREE, EmulatedStation, Station, TimedStation
from dtwin.line.stations import emulated, replayed
from dtwin.line.twins import reorganisation, zone
from dtwin.line.twins.ability import Capability
from dtwin.line.twins.decisions import Mode
from dtwin.line.twins.guard import Guard, Hands
from dtwin.line.twins.node import NodeTwin
from dtwin.line.twins.rehearsal import first_round, rehearsed
from dtwin.line.twins.zone import ZoneTwin
from dtwin.monitoring.kinds import parse_fault_id
from dtwin.monitoring.verdict import Finding, finding
from evidence.line.best import busiest, possible
from evidence.line.otherwise import Otherwise

PLAIN = line_of("default")
LINE = Otherwise(every=12.0, light=0.1).applied(PLAIN)
PLACES = ("blue", "red", "green")
WEAK = Capability("lighter boxes", (), "weak", lighter=tuple((place, 0.1) for place in PLACES))
SHARED = {**LINE.assignment, "mark.heavy": "a1"}


def found(fault: str, size: float) -> Finding:
    return finding(parse_fault_id(fault), 1.0, 1.5, size)


def test_a_line_of_one_class_is_as_it_was() -> None:
    assert [job.name for job in PLAIN.jobs] == [operation.name for operation in PLAIN.operations]
    assert list(PLAIN.assignment) == [job.name for job in PLAIN.jobs]
    assert possible(PLAIN, "", "a2") == possible(PLAIN, "")


def test_an_operation_stands_for_all_its_jobs() -> None:
    assert LINE.assignment == {
        f"{name}.{kind}": station for name, station in PLAIN.assignment.items() for kind in ("heavy", "light")
    }
    assert LINE.whole({"mark": "a1", "mark.light": "a2"}) == {"mark.heavy": "a1", "mark.light": "a2"}
    assert LINE.loads(SHARED, "a2") == {("red", 0.1)}
    with pytest.raises(DtwinError, match="expected a station of one zone for all of mark"):
        LINE.check_assignment({**LINE.assignment, "mark.light": "b1"})


def test_twins_know_of_a_box_what_a_scale_reads() -> None:
    """The mass itself only the emulation knows."""
    source = LINE.source
    assert [source.weighed(mass) for mass in (0.1, 0.21)] == pytest.approx([0.1, 0.21])
    assert source.weighed(0.1526) == pytest.approx(0.155)
    assert source.weighed(source.classes[0].heaviest - 1e-4) <= source.classes[0].heaviest


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ("classes = { light = 0.1, heavy = 0.2 }", "expected 0.21 kg at least, the heaviest box, got 0.2"),
        ("classes = { heavy = 0.3 }", "source.classes: expected 2 to 3, got 1"),
        ("masses = [0.1]\nmass = [0.1, 0.2]", "expected these or mass, not both"),
    ],
)
def test_classes_that_fit_no_box_are_refused(tmp_path: Path, source: str, said: str) -> None:
    text = (FOLDER / "default.toml").read_text().splitlines()
    text = [source if line.startswith("mass = ") else line for line in text]
    (tmp_path / "line.toml").write_text("\n".join(text))
    with pytest.raises(DtwinError, match=said):
        load(tmp_path / "line.toml")


def test_a_file_lists_masses_and_classes(tmp_path: Path) -> None:
    text = (FOLDER / "default.toml").read_text()
    own = "masses = [0.08, 0.2, 0.12]\nclasses = { light = 0.1, middle = 0.15, heavy = 0.25 }"
    text = "\n".join(own if line.startswith("mass = ") else line for line in text.splitlines())
    (tmp_path / "line.toml").write_text(text)
    source = load(tmp_path / "line.toml").source
    assert [source.kind(mass) for mass in source.masses] == [2, 0, 1]
    assert (source.lightest, source.heaviest) == (0.08, 0.2)


def worked(line: Line, blocks: OneResource | Devices) -> tuple[Plant, list[LineEvent]]:
    """What a line does in five minutes whose arms only take time, and which is set up anew after two."""
    times = rehearsed(line.stations[0])
    stations: dict[str, Station] = {station.name: TimedStation(times) for station in line.stations}
    plant, control = Plant(line, stations), Control(line, blocks)
    control.set_up(line.assignment)
    for cycle in range(3000):
        plant.advance()
        control.step(plant)
        if cycle == 1200:
            assert control.set_up(SHARED)
    check_boxes(plant)
    return plant, plant.drain()


def test_the_blocks_bring_every_box_to_the_station_of_its_class_from_a_set_up_on() -> None:
    plant, events = worked(LINE, OneResource(LINE))
    marked = {(event.box % 2, event.who) for event in events if event.kind == "work" and event.text == "mark"}
    late = {
        (event.box % 2, event.who)
        for event in events
        if event.kind == "work" and event.text == "mark" and event.time > 180.0
    }
    assert marked == {(1, "a2"), (0, "a2"), (0, "a1")}, "boxes of odd numbers are light"
    assert late == {(1, "a2"), (0, "a1")}
    assert len(plant.left) > 8
    assert (plant.lost, plant.collisions) == (0, 0)
    assert worked(LINE, Devices(LINE))[1] == events, "the same on devices of their own"


def test_what_a_weak_arm_can_hold_is_said_by_class() -> None:
    plan = LINE.stations[1]
    able = NodeTwin(plan, LINE.source).judged(found("K3", -0.6))
    assert (able.ability, able.places, dict(able.lighter)) == ("lighter boxes", (), dict.fromkeys(PLACES, 0.1))
    assert able.holds(("red", 0.1))
    assert not able.holds(("red", 0.2))
    assert able.settings is not None
    alone = NodeTwin(plan, PLAIN.source).judged(found("K3", -0.6))
    assert (alone.ability, alone.places, alone.lighter) == ("lighter boxes", (), ())
    assert not alone.holds(("red", 0.19)), "nobody tells which boxes are light"
    some = NodeTwin(plan, LINE.source).judged(found("K2", -0.3))
    assert (some.ability, set(some.places), some.lighter) == (
        "lighter boxes",
        {"blue"},
        (("red", 0.1), ("green", 0.1)),
    )


def test_a_zone_shares_an_operation_only_with_an_arm_that_holds_no_more() -> None:
    nodes = {station.name: NodeTwin(station, LINE.source) for station in LINE.zones[0].stations}
    both = ZoneTwin(LINE, 0, nodes)
    assert len(both.assignments(("deburr", "mark"))) == 4
    nodes["a2"].capability = replace(WEAK, times=rehearsed(LINE.stations[1]))
    ways = both.assignments(("deburr", "mark"))
    assert len(ways) == 4
    assert all(way["mark.heavy"] == way["deburr.heavy"] == "a1" for way in ways)
    assert {way["mark.light"] for way in ways} == {"a1", "a2"}


def test_the_best_knows_lighter_boxes_and_what_the_busiest_arm_can_do() -> None:
    ways = possible(LINE, "", "a2")
    assert SHARED in ways
    times = {station.name: rehearsed(station) for station in LINE.stations}
    one = busiest(LINE, times, LINE.assignment)
    assert one == pytest.approx(3600.0 / (times["a1"].grip + times["a1"].carry["red"] + times["a1"].back["red"]))
    assert busiest(LINE, times, SHARED) == pytest.approx(one / 1.5), "a1 has all boxes of one, half of another"


def see(node: Any, found: list[Any]) -> None:
    """Lets the twin of an arm find something, or nothing, whatever it watches."""
    node.watch = lambda *given: found


def looked(mode: Mode, works: tuple[str, float] | None) -> tuple[list[str], list[str], Guard, dict[str, NodeTwin]]:
    """What a watch has done about an arm that holds light boxes alone, and the reasons that it gives."""
    did: list[str] = []
    node = NodeTwin(LINE.stations[1], LINE.source)
    hands = Hands(
        lambda station, state, why: did.append(f"stop {state}"),
        lambda station, settings, why: did.append("settings"),
        lambda station: {("red", 0.21), ("red", 0.1)},
        lambda station: works,
        lambda station: 0,
        lambda decision: did.append(decision.what),
    )
    nodes = {"a2": node}
    guard = Guard(nodes, mode, hands)
    see(node, [found("K3", -0.6)])
    node.capability = node.judged(found("K3", -0.6))
    return did, guard.look("a2", None, FREE, 0, 10.0), guard, nodes


def test_a_weak_arm_goes_on_unless_it_has_a_box_that_it_cannot_hold() -> None:
    did, reasons, guard, nodes = looked("act", ("red", 0.1))
    assert (did, reasons) == (["finding"], ["a2 can do lighter boxes"])
    assert guard.capability("a2").holds(("red", 0.1))
    nodes["a2"].rests = True
    see(nodes["a2"], [])
    guard.look("a2", None, FREE, 0, 11.0)
    assert did == ["finding", "settings", "settings"]
    did, reasons, _, _ = looked("act", ("red", 0.2))
    assert (did, reasons) == (["finding", "stop failed", "stop"], ["a2 can do nothing"])
    did, reasons, _, _ = looked("propose", None)
    assert (did, reasons) == (["finding", "proposal"], ["a2 can do lighter boxes"])


def test_a_weak_arm_is_stopped_when_a_heavy_box_comes_after_all() -> None:
    did, _, guard, nodes = looked("propose", None)
    see(nodes["a2"], [])
    guard._hands = replace(guard._hands, works=lambda station: ("red", 0.2))
    assert guard.look("a2", None, FREE, 0, 11.0) == ["a2 can do nothing"]
    assert did[-2:] == ["stop failed", "stop"]
    assert "it was to bring 0.2 kg to red" in guard.capability("a2").why


def test_a_line_gives_a_weak_arm_its_light_boxes_and_brings_the_heavy_ones_elsewhere(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(
        zone, "simulated", lambda line, times: 100.0 + len(set(line.assignment.values()) & {"a1", "a2"})
    )
    monkeypatch.setattr(reorganisation, "LOOKS", (300.0,))  # a second look is not what this asks for
    run = LineRun(LINE, LineSettings(125.0, "act", (("a2", "K3*=0.4@56"),)))
    run.run()
    said = [(decision.who, decision.what) for decision in run.course.decisions]
    assert said == [("monitor of a2", "finding"), ("twin of a2", "settings"), ("overall twin", "set-up")]
    why = "a2 can do lighter boxes: deburr.light from a1 to a2, mark.heavy from a2 to a1"
    assert why in run.course.decisions[-1].why
    assert run.work.assignment == {**SHARED, "deburr.light": "a2"}
    after = [event for event in run.course.events if event.kind == "work" and event.time > 66.0]
    assert {event.box % 2 for event in after if event.who == "a2"} == {1}
    assert {(event.box % 2, event.who) for event in after if event.text == "mark"} == {(1, "a2"), (0, "a1")}
    assert (run.plant.lost, run.plant.collisions) == (0, 0)
    ours = run.emulated["a2"]
    assert isinstance(ours, EmulatedStation)
    replayed(LINE.stations[1], ours.inputs, 12_500).write_log(tmp_path / "alone.parquet")
    ours.write_log(tmp_path / "ours.parquet")
    assert (tmp_path / "alone.parquet").read_bytes() == (tmp_path / "ours.parquet").read_bytes()


def test_boxes_of_a_class_have_its_mass_and_are_known_by_it() -> None:
    assert LINE.classes == (BoxClass("heavy", 0.21), BoxClass("light", 0.1))
    run = LineRun(LINE, LineSettings(20.0, "off"))
    run.run()
    assert [box.mass for box in run.plant.boxes.values()][:2] == [0.1, 0.21]


def test_twins_rehearse_usual_boxes_of_each_class_also_with_an_arm_that_has_changed() -> None:
    """Blocks count on one mass, so that others reach their place later: measured with the emulated arm itself."""
    assert LINE.source.usual == pytest.approx((0.21, 0.1))
    assert PLAIN.source.usual == pytest.approx((0.2,))
    node = NodeTwin(LINE.stations[1], LINE.source)
    times = node.times
    for kind, mass in enumerate(LINE.source.usual):
        done = first_round(emulated(LINE.stations[1]), "red", mass)
        assert done is not None
        assert times.carried("red", kind) == pytest.approx(done.carry, abs=0.05)
    assert times.carried("red", 1) > times.carried("red", 0) + 0.1
    weak = node.judged(found("K3", -0.6)).times
    assert weak is not None
    assert {kind for _, kind in weak.classes} == {1}, "it holds light boxes alone"
