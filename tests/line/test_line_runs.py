"""A line at work: nothing is lost, whatever it is set up for; its blocks do the same on one resource and on many."""

import itertools
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import msgspec
import numpy as np
import pytest

from dtwin.commands.line.run import DEMO
from dtwin.controller.ports import BLOCKS
from dtwin.emulation.boxes import Box, Deliveries
from dtwin.emulation.emulation import Emulation
from dtwin.errors import DtwinError
from dtwin.line.control import Control, Devices, OneResource
from dtwin.line.file import line_of
from dtwin.line.floor import check_boxes
from dtwin.line.line import Line
from dtwin.line.plant import Plant
from dtwin.line.records.kept import HISTORY, kept, prepare, read, write
from dtwin.line.records.report import page, summary
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.served import Served
from dtwin.line.station import EmulatedStation, Input, TimedStation, WorkTimes
from dtwin.line.system import system
from dtwin.line.twins.decisions import Decision
from dtwin.line.twins.overall import changed
from dtwin.line_file import LineFile
from dtwin.parameters import ROOT
from iec61499.deploy.system_file import system_text
from tests.support.lockstep import own_ports
from tests.support.waiting import connected

LINE = line_of("default")
PLACES = ("blue", "red", "green")
TIMES = WorkTimes(0.5, dict.fromkeys(PLACES, 2.8), dict.fromkeys(PLACES, 2.3))


def possible(names: tuple[str, ...]) -> bool:
    """Whether the stations of the operations can do them, and no box has to go back a zone."""
    try:
        LINE.check_assignment(dict(zip(LINE.assignment, names, strict=True)))
    except DtwinError:
        return False
    return True


WAYS = [
    dict(zip(LINE.assignment, names, strict=True))
    for names in itertools.product(*(LINE.able(name) for name in LINE.assignment))
    if possible(names)
]


def timed(line: Line) -> Plant:
    return Plant(line, {station.name: TimedStation(TIMES) for station in line.stations})


def worked(plant: Plant, control: Control, seconds: int) -> None:
    for _ in range(10 * seconds):
        plant.advance()
        control.step(plant)
        check_boxes(plant)


def test_blocks_on_one_resource_and_on_many_devices_do_the_same() -> None:
    one, many = timed(LINE), timed(LINE)
    for plant, control in ((one, Control(LINE, OneResource(LINE))), (many, Control(LINE, Devices(LINE)))):
        control.set_up(LINE.assignment)
        worked(plant, control, 40)
    assert one.drain() == many.drain()
    assert [vehicle.driven for vehicle in one.vehicles.values()] == [v.driven for v in many.vehicles.values()]
    assert one.vehicles["a_agv1"].driven > 0


@pytest.mark.parametrize("seed", [0, 4, 21])  # in 4 and 21 an arm takes a box that a vehicle was sent for
def test_no_box_is_lost_and_none_stands_for_ever_whatever_the_line_is_set_up_for(seed: int) -> None:
    generator = np.random.default_rng(seed)
    plant, control = timed(LINE), Control(LINE, OneResource(LINE))
    control.set_up(LINE.assignment)
    for _ in range(12):
        worked(plant, control, int(generator.integers(5, 40)))
        control.set_up(WAYS[int(generator.integers(len(WAYS)))])
    control.set_up(LINE.assignment)
    for _ in range(4):
        before = len(plant.left)
        worked(plant, control, 150)
        assert len(plant.left) > before
    assert (plant.lost, plant.collisions) == (0, 0)


@pytest.mark.parametrize("station", ["a2", "b1"])
def test_what_passes_after_a_set_up_does_not_depend_on_when_it_came(station: str) -> None:
    others = next(way for way in WAYS if station not in way.values() and changed(LINE.assignment, way) == 1)
    rates = []
    for seconds in (80, 97, 131):
        plant, control = timed(LINE), Control(LINE, OneResource(LINE))
        control.set_up(LINE.assignment)
        worked(plant, control, seconds)
        while not control.set_up(others):
            worked(plant, control, 1)
        worked(plant, control, 100)
        before = len(plant.left)
        worked(plant, control, 500)
        left = [time for _, time in plant.left[before:]]
        rates.append((len(left) - 1) / (left[-1] - left[0]))
    assert min(rates) > 0.97 * max(rates)


def test_a_vehicle_waits_for_the_box_that_it_has_brought_no_longer_than_its_patience() -> None:
    left, longest = {}, {}
    for patience in (0.0, 2.0, 10.0):
        zones = [replace(z, vehicles=tuple(replace(v, patience=patience) for v in z.vehicles)) for z in LINE.zones]
        line = replace(LINE, zones=tuple(zones))
        plant, control = timed(line), Control(line, OneResource(line))
        control.set_up(line.assignment)
        waits: list[bool] = []
        for _ in range(3000):
            plant.advance()
            control.step(plant)
            idle = [vehicle for vehicle in plant.vehicles.values() if not vehicle.box and not vehicle.action]
            waits.append(any(vehicle.path == ["a2_dock"] for vehicle in idle))
        left[patience] = len(plant.left)
        longest[patience] = max(len(list(group)) for waiting, group in itertools.groupby(waits) if waiting) / 10.0
    assert left[10.0] > left[0.0], "a way around the track takes longer"
    assert longest[0.0] < 1.0
    assert 2.0 <= longest[2.0] < 3.0, "its patience ends before the arm has finished"
    assert longest[2.0] < longest[10.0] <= 10.0
    assert longest[10.0] < 6.0, "it goes as soon as the box is finished"


@pytest.mark.parametrize("seconds", [42, 61, 65])
def test_vehicles_do_not_touch_when_their_control_begins_anew(seconds: int) -> None:
    plant, control = timed(LINE), Control(LINE, OneResource(LINE))
    control.set_up(LINE.assignment)
    worked(plant, control, seconds)
    assert any(not vehicle.standing for vehicle in plant.vehicles.values())
    for _ in range(5):  # nobody answers
        plant.advance()
    control = Control(LINE, OneResource(LINE))
    control.set_up(LINE.assignment)
    worked(plant, control, 200)
    before = len(plant.left)
    worked(plant, control, 150)
    assert (plant.lost, plant.collisions) == (0, 0)
    assert len(plant.left) > before


def test_a_zone_refuses_a_set_up_in_which_its_boxes_could_not_leave() -> None:
    control = Control(LINE, OneResource(LINE))
    assert control.set_up(LINE.assignment)
    control.blocks.exchange("A_PLANT", (0, 0, 1))  # what follows from later samples counts
    control.blocks.exchange("A1_PLANT", (0, 0, 602, 0, 0, 2))  # box 6 is finished here, its operation 2 is next
    control.blocks.exchange("A2_PLANT", (502, 0, 403, 0, 0, 2))  # box 5 waits here, box 4 is finished
    assert not control.set_up({"deburr": "a1", "mark": "a1", "test": "a2", "pack": "b2"})
    assert control.set_up({"deburr": "a1", "mark": "a2", "test": "b2", "pack": "b2"})


def test_a_box_that_waits_can_be_taken_away() -> None:
    station = EmulatedStation(LINE.stations[0])
    station.give("bring", 0.2, "blue")
    station.advance(2)
    station.give("take")
    events = station.advance(2).events
    assert [event.kind for event in events] == ["taken_away"]
    assert station.advance(800).arm == 0


def test_deliveries_are_refused_where_boxes_come_by_themselves() -> None:
    with pytest.raises(DtwinError, match="expected a cell with deliveries"):
        Emulation().bring(Box(0.2, "blue"))
    with pytest.raises(DtwinError, match="expected a cell to which boxes come by themselves"):
        Emulation(deliveries=Deliveries()).state()
    with pytest.raises(DtwinError, match="expected a box for"):
        EmulatedStation(LINE.stations[0]).apply(Input(0, "bring", 0.2, "pink"))


def test_a_run_is_kept_and_shown(tmp_path: Path) -> None:
    settings = LineSettings(duration=12.0, twins="off", faults=(("a2", "K2*=0.1@2-9"),))
    runs = []
    for name, threads in (("one", 1), ("other", 3)):
        folder = tmp_path / name
        run = LineRun(LINE, replace(settings, threads=threads), prepare(folder))
        run.run()
        write(run, folder)
        runs.append(run)
        assert read(folder) == msgspec.json.decode(msgspec.json.encode(kept(run)), type=type(kept(run)))
        repaired = LineFile(folder / HISTORY, Decision, "a decision of the line").entries()
        assert [(d.who, d.what, d.station) for d in repaired] == [("operator", "repair", "a2")]
    for file in ("course.json", HISTORY, "a1.parquet", "a2.parquet"):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes()
    found = kept(runs[0])
    assert summary(found)["lost"] == 0
    text = page(found)
    assert text.count("<svg") == 3
    assert "the arm is repaired and released" in text
    with pytest.raises(DtwinError, match="expected a new or an empty folder"):
        prepare(tmp_path / "one")
    (tmp_path / "one" / "course.json").write_text("{}")
    with pytest.raises(DtwinError, match="expected the course of a line"):
        read(tmp_path / "one")


def test_arms_that_work_ahead_do_the_same() -> None:
    line = replace(LINE, source=replace(LINE.source, every=12.0))
    settings = LineSettings(90.0, "off", (("a1", "lock2@40.2-70"), ("a2", "K2*=0.1@30")), threads=2)
    ahead, stepwise = LineRun(line, settings), LineRun(line, settings)
    ahead.run()
    while not stepwise.over:
        stepwise.step()
    assert {"stopped", "unloaded", "work", "done"} <= {event.kind for event in ahead.course.events}
    assert ahead.course == stepwise.course
    for name, station in ahead.emulated.items():
        other = stepwise.emulated[name]
        assert station.inputs == other.inputs
        assert isinstance(station, EmulatedStation)
        assert isinstance(other, EmulatedStation)
        one, two = station.log.freeze(), other.log.freeze()
        assert one.events == two.events
        assert {key: column.tobytes() for key, column in one.columns.items()} == {
            key: column.tobytes() for key, column in two.columns.items()
        }


@pytest.mark.thorough
def test_work_moves_when_an_arm_fails_and_comes_back_when_it_is_repaired() -> None:
    run = LineRun(LINE, DEMO)
    run.run()
    (text,) = [text for _, text in DEMO.faults]
    begins, ends = 144.5, 270.0
    assert f"@{begins}-{ends:g}" in text
    set_ups = [decision for decision in run.course.decisions if decision.what == "set-up"]
    assert [decision.assignment["mark"] == "a2" for decision in set_ups] == [False, True]
    assert begins < set_ups[0].time < begins + 5
    assert ends < set_ups[1].time < ends + 5
    held = next(e for e in run.course.events if e.kind == "stopped" and e.who == "a2")
    assert held.box > 0
    assert held.box in [number for number, _ in run.plant.left]
    assert (run.plant.lost, run.plant.collisions) == (0, 0)
    other = set_ups[0].assignment["mark"]
    marked = [e.time for e in run.course.events if e.kind == "work" and e.who == other and e.text == "mark"]
    assert marked
    assert min(marked) > begins


@pytest.mark.thorough
def test_blocks_on_devices_that_are_processes_do_the_same(tmp_path: Path) -> None:
    whole = own_ports(system(LINE))
    (tmp_path / "line.sys").write_text(system_text(whole))
    command = [sys.executable, "-m", "dtwin", "fb", "run", "--all", str(tmp_path / "line.sys")]
    plants = []
    with subprocess.Popen([*command, "--blocks", str(BLOCKS)], stdout=subprocess.DEVNULL, cwd=ROOT) as devices:
        try:
            with connected(lambda: Served(LINE, whole)) as blocks:
                plants.append(timed(LINE))
                control = Control(LINE, blocks)
                control.set_up(LINE.assignment)
                worked(plants[0], control, 60)
        finally:
            devices.terminate()
    plants.append(timed(LINE))
    control = Control(LINE, OneResource(LINE))
    control.set_up(LINE.assignment)
    worked(plants[1], control, 60)
    served, here = plants
    assert served.drain() == here.drain()
    assert [v.driven for v in served.vehicles.values()] == [v.driven for v in here.vehicles.values()]


def test_blocks_that_are_not_served_are_told() -> None:
    with pytest.raises(DtwinError, match="127"):
        Served(LINE, own_ports(system(LINE)))


def test_a_file_is_no_folder_of_a_run(tmp_path: Path) -> None:
    (tmp_path / "run").touch()
    for place in ("run", "run/inside"):
        with pytest.raises(DtwinError, match="expected a new or an empty folder, got a file"):
            prepare(tmp_path / place)
