"""Stations of a line whose arm is another one than the thesis's."""

from __future__ import annotations

import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.model import ArmTuning
from dtwin.bus.chain.messages import JointCommands, JointSensors, JointTick, JointTicks
from dtwin.bus.line.plant import ArmSettings, JointSettings, PlantState, Settings, StationAbility, ZoneState
from dtwin.bus.line.topics import PLANT_SET_UP
from dtwin.bus.messages import FAULT, JOINT_SENSORS, Done, FaultRequest
from dtwin.bus.opening import open_peer
from dtwin.bus.session import Bus
from dtwin.errors import DtwinError, ParameterError
from dtwin.line.chain.cell import arm_cell, chain_settings
from dtwin.line.chain.station import ChainStation
from dtwin.line.file import line_of
from dtwin.line.floor import Floor
from dtwin.line.line import BoxClass, Line, Source
from dtwin.line.live.chain import ChainArmFollower
from dtwin.line.live.heard import check_zone_state
from dtwin.line.live.plant import LivePlant
from dtwin.line.records.kept import prepare, write
from dtwin.line.run import LineRun, LineSettings
from dtwin.line.station import FREE, HOLDING, EmulatedStation, settings_text
from dtwin.line.stations import replayed
from dtwin.line.twins import reorganisation
from dtwin.line.twins.chain import ChainNodeTwin
from dtwin.line.twins.nodes import node_of
from dtwin.line.twins.rehearsal import rehearsed
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.parameters import ROOT, ArmParameters
from tests.support.ports import free_port
from tests.support.waiting import until

SORT = """
pick = [0.3, 0.0, 0.2]
height = 0.1
mass = [0.15, 0.3]
[places]
blue = [0.0, 0.0, 0.4]
red = [-0.3, 0.0, 0.1]
green = [-0.2, 0.0, 0.3]
"""
CELL = 'arm = "planar-2r"\nmachine = "4"\nsort = "sort.toml"\nlate = 1\n'


def mixed(folder: Path, cell: str = CELL, sort: str = SORT, extra: str = "") -> str:
    """The usual line, in which station a2 has another arm."""
    (folder / "sort.toml").write_text(sort)
    (folder / "planar.toml").write_text(cell)
    text = (ROOT / "lines" / "default.toml").read_text()
    file = folder / "mixed.toml"
    file.write_text(text.replace('node = "a2_dock"\n', f'node = "a2_dock"\ncell = "planar.toml"\n{extra}'))
    return str(file)


@pytest.fixture
def line(tmp_path: Path) -> Line:
    return line_of(mixed(tmp_path))


def station_of(line: Line) -> ChainStation:
    plan = next(station for station in line.stations if station.name == "a2")
    cell = arm_cell(plan)
    assert cell is not None
    return ChainStation(chain_settings(plan, cell))


def twin_of(line: Line) -> ChainNodeTwin:
    found = node_of(line, next(station for station in line.stations if station.name == "a2"))
    assert isinstance(found, ChainNodeTwin)
    return found


def test_boxes_pass_a_line_with_two_kinds_of_arms_and_the_log_is_that_of_the_arm_alone(
    line: Line, tmp_path: Path
) -> None:
    run = LineRun(line, LineSettings(130.0, "off", threads=4))
    run.run()
    assert (run.plant.lost, run.plant.collisions) == (0, 0)
    marked = [event.box for event in run.course.events if event.kind == "done" and event.who == "a2"]
    assert len(marked) >= 3
    assert run.plant.left
    write(run, prepare(tmp_path / "kept").parent)
    ours = run.emulated["a2"]
    plan = next(station for station in line.stations if station.name == "a2")
    alone = replayed(plan, ours.inputs, 13_000)
    alone.write_log(tmp_path / "alone.parquet")
    assert (tmp_path / "alone.parquet").read_bytes() == (tmp_path / "kept" / "a2.parquet").read_bytes()
    assert pq.read_table(tmp_path / "alone.parquet").num_rows == 13_000
    twin = twin_of(line)
    usual = twin.times
    assert isinstance(ours, ChainStation)
    twin.watch(ours.log, FREE)
    at = {kind: [e.time for e in run.course.events if e.who == "a2" and e.kind == kind] for kind in ("work", "done")}
    carried = [done - held for held, done in zip(at["work"], at["done"], strict=False)]
    place = next(operation.place for operation in line.operations if line.assignment[operation.name] == "a2")
    assert twin.times.carry[place] == pytest.approx(np.median(carried), abs=0.1)
    assert abs(twin.times.carry[place] - usual.carry[place]) > 0.1, "what it really took counts more than a rehearsal"
    assert usual.carry[place] == pytest.approx(np.median(carried), abs=0.5), (
        "the rehearsed arm waits by friction, too"
    )
    points = ours.points(100)
    assert points.joints.shape == (130, 4, 3)
    lengths = np.linalg.norm(np.diff(points.joints[:, 1:], axis=1), axis=2)
    np.testing.assert_allclose(lengths, np.broadcast_to([0.3, 0.25], lengths.shape), atol=1e-12)


def test_a_box_that_was_taken_away_leaves_no_other_one_at_its_place(line: Line) -> None:
    station = station_of(line)
    station.advance(300)
    station.give("bring", 0.2, "red")
    station.advance(40)  # on its way down
    station.give("take")
    assert station.advance(10).arm == FREE
    station.give("bring", 0.2, "blue")
    events = []
    for _ in range(200):
        report = station.advance(10)
        events += [(event.kind, event.text) for event in report.events]
    assert [kind for kind, _ in events] == ["picked", "delivered"]
    assert report.arm == FREE


def test_a_stopped_arm_keeps_its_box_and_finishes_it_once_it_is_released(line: Line) -> None:
    station = station_of(line)
    station.advance(300)
    station.give("bring", 0.2, "blue")
    while station.advance(10).arm != HOLDING:
        pass
    station.give("failed")
    report = station.advance(500)
    assert (report.arm, bool(report.stop)) == (HOLDING, True)
    station.give("release")
    report = station.advance(500)
    assert (report.arm, report.stop) == (FREE, 0)


def test_how_long_work_takes_is_rehearsed_with_the_arm_that_the_controller_believes_in(line: Line) -> None:
    twin = twin_of(line)
    assert set(twin.times.carry) == {"blue", "red", "green"}
    assert all(0.3 < value < 10.0 for value in (twin.times.grip, *twin.times.carry.values()))
    assert rehearsed(replace(twin.plan, name="other", machine="7", seed=9), line.source.usual) == twin.times


def test_what_a_weaker_drive_can_still_hold_follows_from_the_weights_at_its_places(tmp_path: Path) -> None:
    weak = (ROOT / "arms" / "planar-2r.toml").read_text().replace("limit = 24.0", "limit = 6.0")
    (tmp_path / "weak.toml").write_text(weak)
    (tmp_path / "planar-2r.xml").write_text((ROOT / "arms" / "planar-2r.xml").read_text())
    sort = SORT.replace("[0.3, 0.0, 0.2]", "[0.1, 0.0, 0.4]").replace("[-0.3, 0.0, 0.1]", "[-0.45, 0.0, 0.1]")
    twin = twin_of(line_of(mixed(tmp_path, CELL.replace("planar-2r", "weak.toml"), sort)))
    found = {size: twin.judged(ChainFinding(1.0, "K1", size)) for size in (0.02, 0.3, 0.55, 0.99)}
    assert (found[0.02].ability, found[0.02].places) == ("all", ("blue", "red", "green"))
    assert (found[0.3].ability, found[0.3].places) == ("some places", ("blue", "green"))
    assert "it cannot hold 0.21 kg at red" in found[0.3].why
    assert [found[size].ability for size in (0.55, 0.99)] == ["nothing", "nothing"]
    assert "replace the drive of shoulder" in found[0.99].why, "the blocks count on no drive as weak as that"
    assert twin.judged(ChainFinding(1.0, "lock2", 0.0)).ability == "nothing"
    assert twin.judged(ChainFinding(1.0, "push1", 3.0)).ability == "all"


def test_a_weak_drive_leaves_an_arm_slower_or_with_lighter_boxes(tmp_path: Path) -> None:
    weak = (ROOT / "arms" / "planar-2r.toml").read_text().replace("limit = 24.0", "limit = 5.6")
    (tmp_path / "weak.toml").write_text(weak)
    (tmp_path / "planar-2r.xml").write_text((ROOT / "arms" / "planar-2r.xml").read_text())
    sort = SORT.replace("[0.15, 0.3]", "[0.1, 0.25]")
    plan = twin_of(line_of(mixed(tmp_path, CELL.replace("planar-2r", "weak.toml"), sort))).plan
    cell = arm_cell(plan)
    assert cell is not None
    classes = (BoxClass("heavy", 0.21), BoxClass("light", 0.1))
    twin = ChainNodeTwin(plan, cell, Source("source", 12.0, 0.1, 0.21, (0.1, 0.21), classes))
    found = (("K1", 0.05), ("K2", 0.3), ("K2", 0.5))
    slower, able, lighter = (twin.judged(ChainFinding(1.0, *each)) for each in found)
    assert (slower.ability, slower.lighter) == ("slower", ())
    assert (able.ability, able.lighter) == ("all", ()), "a healthy one takes as long for heavy boxes"
    assert (lighter.ability, lighter.places) == ("lighter boxes", ("blue",))
    assert dict(lighter.lighter) == {"red": 0.1, "green": 0.1}
    assert lighter.settings is not None
    assert lighter.settings.text().startswith("blocks that count on 50 % of the torque of joint 2, and")
    assert "instead of" in slower.why


def test_another_arm_takes_no_settings_of_the_usual_kind(line: Line) -> None:
    usual = settings_text(ArmSettings(2.0, ArmParameters()))
    with pytest.raises(DtwinError, match="expected those of an arm of n joints"):
        station_of(line).give("settings", text=usual)
    other = settings_text(JointSettings(ArmTuning(), Adjustment.none(2)))
    with pytest.raises(DtwinError, match="expected those of an arm of the usual kind"):
        EmulatedStation(line.stations[0]).give("settings", text=other)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (JointSettings(ArmTuning(speed=1.5), Adjustment.none(2)), "tuning: speed: expected 0.1 to 1"),
        (JointSettings(ArmTuning(), Adjustment.none(3)), "offset: expected 2 values, one of each joint, got 3"),
        (JointSettings(ArmTuning(), replace(Adjustment.none(2), strength=(0.1, 1.0))), "strength of joint 1"),
    ],
)
def test_settings_out_of_range_reach_no_blocks(line: Line, settings: JointSettings, words: str) -> None:
    station = station_of(line)
    with pytest.raises(DtwinError, match=words):
        station.give("settings", text=settings_text(settings))
    assert (station.settings, station.inputs) == (None, [])


def test_settings_of_another_kind_of_arm_than_a_station_has_are_foreign(line: Line) -> None:
    zone = line.zones[0]
    usual = ArmSettings(2.0, ArmParameters())
    other = JointSettings(ArmTuning(speed=0.5), Adjustment.none(2))
    fast = JointSettings(ArmTuning(speed=2.0), Adjustment.none(2))

    def told(first: Settings | None, second: Settings | None) -> ZoneState:
        able = (StationAbility("a1", "slower", (), "", first), StationAbility("a2", "slower", (), "", second))
        return ZoneState("a", 1.0, able)

    check_zone_state(zone, told(usual, other))
    with pytest.raises(ParameterError, match="station a1: settings: expected those of its kind of arm"):
        check_zone_state(zone, told(other, None))
    with pytest.raises(ParameterError, match="station a2: settings: expected those of its kind of arm"):
        check_zone_state(zone, told(None, usual))
    with pytest.raises(ParameterError, match="station a2: tuning: speed: expected"):
        check_zone_state(zone, told(None, fast))


def test_a_weak_arm_follows_its_path_again_with_the_settings_of_its_twin_and_without_a_jolt(line: Line) -> None:
    twin, station = twin_of(line), station_of(line)
    able = twin.judged(ChainFinding(1.0, "K1", 0.5))
    assert isinstance(able.settings, JointSettings)
    assert able.settings.adjustment.strength == (0.5, 1.0)
    assert able.times is not None
    station.advance(500)
    station.give("fault", text="K1*=0.5@5")
    station.advance(200)
    assert _away(station, 500) > 0.01, "it sags until its integral part holds it"
    station.give("settings", text=settings_text(able.settings))
    station.advance(100)
    assert _away(station, 700) < 0.012, "what the integral part held is not added to what is known now"
    station.give("bring", 0.2, "red")
    while station.advance(10).arm != FREE:
        pass
    assert _away(station, 800) < 0.05
    station.give("release")
    assert station.settings is None


def _away(station: ChainStation, first: int) -> float:
    """Largest distance of an arm from its path since a tick, rad."""
    seen = station.log.since(first)
    return float(np.abs(seen.target - seen.q).max())


def test_what_settings_are_in_force_is_what_the_twin_knows_of_the_arm(line: Line) -> None:
    twin, station = twin_of(line), station_of(line)
    settings = twin.judged(ChainFinding(1.0, "K1", 0.5)).settings
    station.advance(300)
    twin.watch(station.log, FREE, settings=settings)
    assert twin.capability.why.startswith("other settings are in force")
    assert twin.capability.settings == settings
    further = twin.judged(ChainFinding(1.0, "K1", 0.1)).settings
    assert isinstance(further, JointSettings)
    assert further.adjustment.strength == pytest.approx((0.45, 1.0)), "a finding is on top of what is known"
    station.advance(300)
    twin.watch(station.log, FREE, settings=settings)
    assert twin.rests
    twin.repaired()
    assert (twin.capability.ability, twin.capability.settings) == ("all", None)


@pytest.mark.thorough  # that a lock leaves nothing is judged above, and work moves away in tests/line/test_live.py
def test_work_moves_away_from_another_arm_that_fails_and_comes_back(
    line: Line, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reorganisation, "LOOKS", (300.0,))  # a second look is not what this asks for
    run = LineRun(line, LineSettings(300.0, "act", (("a2", "lock2@120-220"),)))
    run.run()
    said = [(decision.what, decision.assignment.get("mark")) for decision in run.course.decisions]
    assert ("set-up", "a2") in said
    assert any(what == "set-up" and at != "a2" for what, at in said)
    assert (run.plant.lost, run.plant.collisions) == (0, 0)
    assert run.rate(220.0) > 0.0


@pytest.mark.parametrize(
    ("cell", "sort", "extra", "words"),
    [
        (CELL.replace('sort = "sort.toml"\n', ""), SORT, "", r"expected a sorting task \(sort\)"),
        (CELL, SORT.replace("blue", "azure"), "", r"operations.deburr.place, for zones.a.stations.a2: .*'blue'"),
        (CELL, SORT.replace("red", "azure"), "", r"operations.mark.place, for zones.a.stations.a2: .*'red'"),
        (CELL, SORT.replace("0.3]\n[", "0.2]\n["), "", r"source.mass: expected at most 0.2 kg"),
        (CELL, SORT.replace("-0.3, 0.0", "-0.9, 0.0"), "", r"red: arm planar-2r: the tool does not reach"),
        (CELL.replace("planar-2r", "planar-9r"), SORT, "", "planar-9r"),
        (CELL, SORT, 'faults = ["K7*=0.1@30"]\n', r"expected a joint from 1 to 2, got 7"),
        (CELL, SORT, 'machine = "coulomb"\n', r"expected ideal, nominal, a number up to 1000000000"),
    ],
)
def test_a_cell_that_cannot_be_a_station_is_refused(
    tmp_path: Path, cell: str, sort: str, extra: str, words: str
) -> None:
    with pytest.raises(DtwinError, match=words):
        line_of(mixed(tmp_path, cell, sort, extra))


def test_faults_of_another_arm_are_checked_as_its_own(line: Line) -> None:
    with pytest.raises(DtwinError, match="expected a joint from 1 to 2, got 3"):
        LineRun(line, LineSettings(10.0, "off", (("a2", "K3*=0.1@5"),)))
    floor = Floor(line)
    floor.inject("a2", "friction1*=2@5-6", 100.0)
    assert floor.due_repairs() == []


def test_another_arm_of_a_running_line_is_seen_like_that_of_its_cell(line: Line) -> None:
    meet, over = f"tcp/127.0.0.1:{free_port()}", threading.Event()
    seen: list[JointSensors] = []
    plan = next(station for station in line.stations if station.name == "a2")
    cell = arm_cell(plan)
    assert cell is not None
    with Bus(open_peer(meet), "line", "line") as bus, Bus(open_peer(meet), "line", "line") as other:
        arm = other.beside("a2")
        arm.subscribe(JOINT_SENSORS, JointSensors, seen.append)
        follower = ChainArmFollower(arm, chain_settings(plan, cell), lambda own, ticks: own.take(ticks))
        plant = LivePlant(Floor(line), (), bus, time.monotonic)

        def work() -> None:
            while not over.is_set():
                plant.step()
                plant.serve(0.005)

        thread = threading.Thread(target=work)
        thread.start()
        try:
            until(lambda: len(seen) > 300, "samples come")
            done = arm.ask(FAULT, FaultRequest(("K2*=0.5",)), Done)
            assert done.text.startswith("K2*=0.5@")
            with pytest.raises(DtwinError, match="expected K2"):
                arm.ask(FAULT, FaultRequest(("m1*=2",)), Done)
            until(lambda: len(follower.log) > 500, "ticks come, too")
            assert other.ask(PLANT_SET_UP, None, PlantState).time > 3.0
        finally:
            over.set()
            thread.join()
    numbers = [sample.sequence for sample in seen]
    assert numbers == sorted(set(numbers))
    first = follower.log.forgotten
    stretch = follower.log.since(first)
    assert stretch.q.shape == (len(follower.log) - first, 2)
    assert all(len(sample.theta) == 2 for sample in seen)


def test_a_log_of_what_is_heard_begins_anew_after_lost_ticks(line: Line) -> None:
    twin = twin_of(line)
    cell = arm_cell(twin.plan)
    assert cell is not None
    with Bus(open_peer(f"tcp/127.0.0.1:{free_port()}"), "line", "a2") as bus:
        follower = ChainArmFollower(bus, chain_settings(twin.plan, cell), lambda own, ticks: None)

        def ticks(first: int, count: int, joints: int = 2) -> tuple[JointTick, ...]:
            q = (0.1,) * joints
            return tuple(
                JointTick(JointSensors(n, 0.01 * n, q), JointCommands(n, 0.01 * n, q, q))
                for n in range(first, first + count)
            )

        follower.take(ticks(0, 10))
        with pytest.raises(ParameterError, match="tick: expected 2 joints, got 3"):
            follower._check(JointTicks(ticks(10, 10, joints=3)))
        follower.take(ticks(25, 10))
        assert (follower.log.forgotten, len(follower.log)) == (25, 35)
        follower.forget(0.05)
        assert follower.log.forgotten == 30
        assert len(follower.log.since(0).t) == 5
        follower.take(ticks(0, 3))
        assert (follower.log.forgotten, len(follower.log)) == (0, 3)
