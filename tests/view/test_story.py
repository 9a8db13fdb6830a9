"""What a recording tells of a run: states of the controller, moments, what the arm is to do, what its twin says."""

from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from rerun.chunk import RrdReader

from dtwin.bus.twin_messages import UNITS, MonitoredUnit, MonitoringVerdict, UnitState
from dtwin.emulation.faults import parse_fault
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.parameters import PERIOD, PICKUP, PLACES, ArmParameters
from dtwin.run.cell import Cell
from dtwin.run.options import ControlOptions
from dtwin.run.prediction import OpenLoop, believed_by_controller
from dtwin.run.settings import CellSettings
from dtwin.signals import Event, Sensors, StepRecord, Truth, Voltages
from dtwin.task import DEFAULT_TASK
from dtwin.twin.kinematics import forward, joint_positions
from dtwin.view.layout import extent_of, live_extent
from dtwin.view.live import LiveView
from dtwin.view.monitoring import write_monitoring
from dtwin.view.series import PLOTS, bends
from dtwin.view.story import Story, marks
from dtwin.view.viewer import Detail
from dtwin.view.write import write_recording
from tests.view.test_write import MODEL, at, contents, ranges_of

AWAY = PLACES["green"].theta


def work() -> Log:
    """The arm rests for 0.5 s, a box waits for 0.5 s, is carried for 1 s and let go; the arm goes back."""
    run = RunLog()
    for tick in range(350):
        share = np.interp(tick, (100, 190, 250, 350), (0.0, 1.0, 1.0, 0.0))
        first, second, third = ((1 - share) * np.array(PICKUP.theta) + share * np.array(AWAY)).tolist()
        target = (first, second, third)
        held, waits = 100 <= tick < 200, 50 <= tick < 100
        t = PERIOD * tick
        run.append(
            StepRecord(
                Truth(t, target, (0.0, 0.0, 0.0), 0.9, 0.2 if held else 0.0),
                Sensors(tick, t, target, 0.9, waits, "green" if waits else ""),
                target,
                Voltages(tick, t, (0.0, 0.0, 0.0, 3.0), held),
            )
        )
    return run.freeze()


WORK = [(0, "waiting"), (50, "fetching"), (100, "carrying"), (251, "fetching")]


def test_the_state_follows_from_box_grip_and_path() -> None:
    assert [(tick, state) for tick, state, _ in Story().changes(work())] == WORK


@pytest.mark.parametrize("length", [1, 7, 50, 349])
def test_the_states_of_a_run_told_in_parts_are_those_of_the_whole(length: int) -> None:
    log, story = work(), Story()
    found = [
        (start + tick, state)
        for start in range(0, len(log), length)
        for tick, state, _ in story.changes(log.part(start, start + length))
    ]
    assert found == WORK


def test_a_stop_hides_what_the_arm_was_at_until_it_is_released() -> None:
    events = (
        Event(1.5, "stop", "safe stop: braking (monitoring: joint 2 failed)"),
        Event(1.7, "stop", "safe stop: standstill"),
        Event(2.0, "stop", "safe stop: released (operator: repaired)"),
        Event(3.0, "safe", "no valid command in time"),
        Event(3.2, "resumed", "commands have come back"),
    )
    changes = Story().changes(replace(work(), events=events))
    assert changes == [
        (0, "waiting", ""),
        (50, "fetching", ""),
        (100, "carrying", ""),
        (150, "stopped", events[0].text),
        (170, "stopped", events[1].text),
        (200, "carrying", ""),
        (251, "fetching", ""),
        (300, "stopped", events[3].text),
        (320, "fetching", ""),
    ]
    assert [mark.kind for mark in marks(events)] == ["stop"] * 3


def test_moments_are_faults_findings_and_stops_in_order_of_time() -> None:
    events = [
        Event(3.0, "monitor_failed", "joint 2"),
        Event(1.0, "arrived", "a box"),
        Event(2.0, "fault", "K2*=0.1@2 began"),
        Event(4.0, "monitor_failed", "joint 2"),
    ]
    found = marks(events)
    assert [(mark.time, mark.kind) for mark in found] == [(2.0, "fault"), (3.0, "finding"), (4.0, "finding")]
    assert len(marks([Event(0.1 * k, "fault", "again") for k in range(1000)])) == 20


def test_a_recording_shows_state_moments_and_path(tmp_path: Path) -> None:
    events = (
        Event(1.5, "fault", "K2*=0.1@1.5 began"),
        Event(2.0, "stop", "safe stop: braking\n(monitoring, [see](http://x))"),
    )
    log = replace(work(), events=events)
    write_recording(log, MODEL, tmp_path / "run.rrd")
    found = contents(tmp_path / "run.rrd")

    states = [(time / 1e7, state) for time, _, [state] in found["/controller/state"]["StateChange:state"]]
    assert states == [(0, "waiting"), (50, "fetching"), (100, "carrying"), (200, "stopped")]
    said = found["/status"]["TextDocument:text"]
    assert at(said, 199) == ["Controller: **carrying**"]
    assert at(said, 200) == [r"# ■ STOPPED: safe stop\: braking \(monitoring\, \[see\]\(http\:\/\/x\)\)"]

    for number, moment in enumerate((1_500_000_000, 2_000_000_000)):
        low, high = found[f"/marks/{number}"]["Scalars:scalars"]
        assert low[0] == high[0] == moment
        assert low[2][0] < -1e4 < 1e4 < high[2][0]

    arm = ArmParameters()
    paths = found["/cell/plan/path"]["LineStrips3D:strips"]
    assert [time for time, _, _ in paths] == [1_010_000_000, 2_510_000_000]
    for tick, (start, end) in {150: (PICKUP.theta, AWAY), 300: (AWAY, PICKUP.theta)}.items():
        [line] = at(paths, tick)
        for point, theta in ((line[0], start), (line[-1], end)):
            x, y, _ = forward(theta, arm)
            np.testing.assert_allclose(point, (x, 0.0, y), atol=0.01)
        np.testing.assert_allclose(at(found["/cell/plan/goal"]["Points3D:positions"], tick), [line[-1]], atol=1e-6)


def test_the_ghost_is_what_the_twin_of_the_controller_says(tmp_path: Path) -> None:
    cell = Cell(CellSettings(duration=3.0, control=ControlOptions().control(), faults=(parse_fault("K2*=0.5@1"),)))
    cell.run()
    log = cell.log.freeze()
    write_recording(log, MODEL, tmp_path / "run.rrd")
    found = contents(tmp_path / "run.rrd")
    t, angles = OpenLoop(believed_by_controller(log.metadata), every=4).add(log)
    for body, joint in (("link_2", 1), ("link_3", 2)):
        drawn = found[f"/cell/plan/ghost/{body}"]["Transform3D:translation"]
        assert [time for time, _, _ in drawn] == [round(1e9 * time) for time in t]
        expected = [joint_positions((a, b, c), ArmParameters())[joint] for a, b, c in angles.tolist()]
        np.testing.assert_allclose([place for _, _, [place] in drawn], [(x, 0.0, y) for x, y in expected], atol=1e-6)


def test_the_layout_holds_the_whole_run_and_every_plot_of_a_run() -> None:
    log = work()
    extent = extent_of(log, DEFAULT_TASK)
    start, end = extent.time.start.inner, extent.time.end.inner
    assert start is not None
    assert end is not None
    assert start.value < 0
    assert end.value > 3_490_000_000
    assert extent.angles == live_extent(DEFAULT_TASK).angles == (-4.0, 3.0)
    columns = dict(log.columns)
    columns["theta_2"] = log.columns["theta_2"] - 6.0
    far = extent_of(Log(MappingProxyType(columns)), DEFAULT_TASK)
    assert far.angles[0] == np.floor(columns["theta_2"].min()) < -6
    assert far.error == pytest.approx(10_500.0)
    assert extent.payload == live_extent(DEFAULT_TASK).payload == pytest.approx(0.315)
    columns["payload_mass"] = log.columns["payload_mass"] + 0.25
    assert extent_of(Log(columns), DEFAULT_TASK).payload == pytest.approx(0.525)
    columns["payload_mass"] = np.full(len(log), np.nan)
    assert extent_of(Log(columns), DEFAULT_TASK).payload == extent.payload


def test_the_shared_axis_is_in_the_blueprint(tmp_path: Path) -> None:
    write_recording(work(), MODEL, tmp_path / "run.rrd")
    reader = RrdReader(tmp_path / "run.rrd")
    [layout] = reader.blueprints()
    ranges = {
        chunk.entity_path
        for chunk in reader.stream(store=layout).to_chunks()
        if "TimeAxis:view_range" in chunk.to_record_batch().schema.names
    }
    assert ranges == {"/view/5c0dca6a-e63f-9cf7-f657-2602590474cc/TimeAxis"}


def test_a_run_drawn_in_parts_has_the_path_and_the_ghost_of_the_whole(tmp_path: Path) -> None:
    log = work()
    view = LiveView(MODEL, ArmParameters(), tmp_path / "live.rrd")
    for start in range(0, len(log), 30):
        view.add(log.part(start, start + 30))
    view.close()
    write_recording(log, MODEL, tmp_path / "whole.rrd")
    found = [contents(tmp_path / name) for name in ("live.rrd", "whole.rrd")]
    live, whole = (each["/cell/plan/path"]["LineStrips3D:strips"] for each in found)
    for tick in (240, 349):
        ends = [(at(rows, tick)[0][0], at(rows, tick)[0][-1]) for rows in (live, whole)]
        np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)
    for body in ("link_1", "link_2", "link_3"):
        for component in ("Transform3D:translation", "Transform3D:quaternion"):
            live, whole = (each[f"/cell/plan/ghost/{body}"][component] for each in found)
            assert [(time, value) for time, _, value in live] == [(time, value) for time, _, value in whole]
            assert len(live) == -(-len(log) // 4)


@dataclass(frozen=True)
class Opinion:
    """What a monitor makes of `work`: joint 2 fails at 2 s and recovers at 3 s."""

    predicted: NDArray[np.float64]
    deviation: NDArray[np.float64]
    statistic: NDArray[np.float64]
    verdicts: tuple[tuple[int, MonitoringVerdict], ...]
    events: tuple[Event, ...]
    threshold: float = 30.0


def test_a_failed_link_is_red_while_it_has_failed_and_its_name_stands_above(tmp_path: Path) -> None:
    def verdict(t: float, state: UnitState) -> MonitoringVerdict:
        units = {name: MonitoredUnit("nominal") for name in UNITS}
        units["joint 2"] = MonitoredUnit(state, text="voltage constant of joint 2" if state == "failed" else "")
        return MonitoringVerdict(t, units, (), (), 0, 0)

    log = work()
    spread = np.full((len(log), 3), 1e-3)
    verdicts = ((0, verdict(0.0, "nominal")), (200, verdict(2.0, "failed")), (300, verdict(3.0, "nominal")))
    opinion = Opinion(
        log.stack("measured"), spread, spread[:, 0], verdicts, (Event(2.0, "monitor_failed", "voltage constant"),)
    )
    write_monitoring(log, opinion, MODEL, tmp_path / "run.rrd")
    low, high = ranges_of(tmp_path / "run.rrd")["monitor/evidence"]
    assert low == 0.0 < opinion.threshold < high
    found = contents(tmp_path / "run.rrd")
    beam = found["/cell/visual_geometries/link_2/link_2_beam"]["Mesh3D:albedo_factor"]
    assert [(time / 1e7, value) for time, _, value in beam] == [(200, [0xEB322DFF]), (300, [0xFFFFFFFF])]
    assert "Mesh3D:albedo_factor" not in found.get("/cell/visual_geometries/link_1/link_1_beam", {})
    labels = found["/cell/verdicts/text"]["Points3D:labels"]
    assert [at(labels, tick) for tick in (0, 250, 300)] == [[""], ["joint 2: voltage constant"], [""]]
    assert found["/marks/0"]["Scalars:scalars"][0][0] == 2_000_000_000


def test_a_viewer_without_a_gpu_is_sent_few_messages(tmp_path: Path) -> None:
    log = replace(work(), events=(Event(1.5, "fault", "K2*=0.1@1.5 began"),))
    counts, found = {}, {}
    for name, sparse in (("all", False), ("sparse", True)):
        view = LiveView(MODEL, ArmParameters(), tmp_path / name, detail="sparse" if sparse else "full")
        for start in range(0, len(log), 50):
            part = log.part(start, start + 50)
            view.add(part if start == 100 else replace(part, events=()))
        view.close()
        chunks = [chunk for chunk in RrdReader(tmp_path / name).stream().to_chunks() if not chunk.is_static]
        counts[name] = len([chunk for chunk in chunks if "visual_geometries" not in chunk.entity_path])
        found[name] = contents(tmp_path / name)
    assert counts["sparse"] < 0.4 * counts["all"]
    states = [found[name]["/controller/state"]["StateChange:state"] for name in counts]
    assert [(time, value) for time, _, value in states[0]] == [(time, value) for time, _, value in states[1]]
    assert "/marks/0" in found["sparse"]
    tips = found["sparse"]["/cell/bodies/tip"]["Transform3D:translation"]
    assert len(tips) == 1 + len(log) // 10
    whole = found["all"]["/cell/bodies/tip"]["Transform3D:translation"]
    for tick in (0, 150, 340):
        np.testing.assert_allclose(at(tips, tick), at(whole, tick), atol=1e-6)


def test_a_recording_is_written_in_few_parts_and_shows_what_every_sample_would(tmp_path: Path) -> None:
    log = replace(work(), events=(Event(1.25, "arrived", "a blue box"), Event(1.55, "fault", "K2*=0.1@1.55 began")))
    counts, found = {}, {}
    details: tuple[Detail, ...] = ("full", "screen")
    for detail in details:
        view = LiveView(MODEL, ArmParameters(), tmp_path / detail, detail=detail)
        for start in range(0, len(log), 10):
            part = log.part(start, start + 10)
            t = part.columns["t"]
            view.add(replace(part, events=tuple(e for e in log.events if t[0] <= e.time < t[0] + 0.1)))
            if start == 150:
                assert "/marks/0" in contents(tmp_path / detail), "what is worth a look is in the file at once"
        view.close()
        chunks = [chunk for chunk in RrdReader(tmp_path / detail).stream().to_chunks() if not chunk.is_static]
        counts[detail] = len([chunk for chunk in chunks if "visual_geometries" not in chunk.entity_path])
        found[detail] = contents(tmp_path / detail)
    assert counts["screen"] < 0.25 * counts["full"]
    texts = [[value for _, _, value in found[detail]["/events"]["TextLog:text"]] for detail in details]
    assert texts[0] == texts[1]
    assert len(texts[0]) == len(log.events)
    for plot in PLOTS:
        full, screen = (found[detail][f"/{plot.entity}"]["Scalars:scalars"] for detail in details)
        times, lines = np.array([time for time, _, _ in screen]), np.array([value for _, _, value in screen])
        at_all = np.array([time for time, _, _ in full])
        for number, line in enumerate(np.array([value for _, _, value in full]).T):
            shown = np.interp(at_all, times, lines[:, number])
            assert np.abs(shown - line).max() <= 2.0 * plot.unseen + 1e-9


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=60), st.integers(2, 6))
def test_a_line_through_the_needed_ticks_passes_near_all_others(line: list[float], every: int) -> None:
    values = np.array(line)
    needed = np.flatnonzero(bends(values.reshape(-1, 1), every, 0.1))
    assert needed[0] == 0
    assert needed[-1] == len(values) - 1
    assert np.abs(np.interp(np.arange(len(values)), needed, values[needed]) - values).max() <= 0.2 + 1e-9


def test_a_recording_that_grew_opens_on_the_whole_run_in_the_end(tmp_path: Path) -> None:
    log, file = work(), tmp_path / "live.rrd"
    view = LiveView(MODEL, ArmParameters(), file)
    for start in range(0, len(log), 50):
        view.add(log.part(start, start + 50))
    view.close()
    reader = RrdReader(file)
    shown = [
        chunk.to_record_batch()["TimeAxis:view_range"].to_pylist()[0][0]
        for layout in reader.blueprints()
        for chunk in reader.stream(store=layout).to_chunks()
        if chunk.entity_path == "/view/5c0dca6a-e63f-9cf7-f657-2602590474cc/TimeAxis"
    ]
    extent = extent_of(log, DEFAULT_TASK)
    assert extent.time.start.inner is not None
    assert extent.time.end.inner is not None
    assert len(shown) == 2  # the first is that of the run while it goes on
    assert {"start": extent.time.start.inner.value, "end": extent.time.end.inner.value} in shown
