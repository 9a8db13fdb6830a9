"""The Rerun recording of a run: what was logged can be read back from the file."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from dtwin.errors import ModelError, NoSpaceError, RecordingError
from dtwin.logs.collecting import RunLog
from dtwin.logs.log import Log
from dtwin.parameters import PICKUP, PLACES, ROOT, ArmParameters, Colour, JointVector
from dtwin.signals import Event, Sensors, StepRecord, Truth, Voltages
from dtwin.view.write import write_recording
from tests.support.disks import full_disk

MODEL = ROOT / "models" / "arm.xml"
TICKS = 300

pytestmark = pytest.mark.filterwarnings("error::rerun.error_utils.RerunWarning")


def record(tick: int, colour: str, theta: JointVector, held: bool) -> StepRecord:
    t = 0.01 * tick
    measured = (theta[0] + 1e-3, theta[1], theta[2])
    target = (theta[0] + 2e-3, theta[1] - 1e-3, theta[2])
    return StepRecord(
        Truth(t, theta, (0.0, 0.0, 0.0), 0.4, 0.2 if held else 0.0),
        Sensors(tick, t, measured, 0.4, colour != "", colour),
        target,
        Voltages(tick, t, (1.0, -2.0, 3.0, -3.0), held),
    )


def run_to(place: Colour) -> Log:
    """A box waits for 1 s, is held for 1 s at the pickup point, then released at a place."""
    run = RunLog({"seed": 3})
    for tick in range(TICKS):
        theta = PICKUP.theta if tick < 150 else PLACES[place].theta
        run.append(record(tick, place if tick < 100 else "", theta, 100 <= tick < 200))
    run.add_events([Event(0.5, "arrived", "a box"), Event(2.0, "fault", "K2"), Event(2.5, "misplaced", "beside")])
    return run.freeze()


Row = tuple[int, bytes, Any]
"""A plant time (ns), a row id and a value."""
Contents = dict[str, dict[str, list[Row]]]


def contents(path: Path) -> Contents:
    """Every value logged on the plant's time line, by entity and component, in order of time and row id."""
    found: Contents = {}
    for chunk in RrdReader(path).stream().to_chunks():
        if chunk.is_static:
            continue
        assert chunk.timeline_names == ["plant_time"]
        batch = chunk.to_record_batch()
        times = batch["plant_time"].cast(pa.int64()).to_pylist()
        ids = batch["rerun.controls.RowId"].to_pylist()
        for name in batch.schema.names[2:]:
            values = batch[name].to_pylist()
            rows = [row for row in zip(times, ids, values, strict=True) if row[2] is not None]
            found.setdefault(chunk.entity_path, {}).setdefault(name, []).extend(rows)
    for components in found.values():
        for rows in components.values():
            rows.sort(key=lambda row: row[:2])
    return found


def at(rows: list[Row], tick: int) -> Any:
    """What the viewer shows at a tick: the last value up to then."""
    return [value for time, _, value in rows if time <= 10_000_000 * tick][-1]


def ranges_of(path: Path) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of every plot in the layout of a recording, by its origin.

    A plot without a fixed range is missing.
    """
    reader = RrdReader(path)
    [layout] = reader.blueprints()
    origins, ranges = {}, {}
    for chunk in reader.stream(store=layout).to_chunks():
        batch = chunk.to_record_batch()
        view = chunk.entity_path.split("/")[2:3]
        if "ViewBlueprint:space_origin" in batch.schema.names:
            origins[view[0]] = batch["ViewBlueprint:space_origin"].to_pylist()[0][0]
        if "ScalarAxis:range" in batch.schema.names:
            ranges[view[0]] = batch["ScalarAxis:range"].to_pylist()[0][0]
    return {origins[view].strip("/"): tuple(shown) for view, shown in ranges.items()}


@pytest.fixture(scope="module")
def log() -> Log:
    return run_to("red")


@pytest.fixture(scope="module")
def recording(log: Log, tmp_path_factory: pytest.TempPathFactory) -> Contents:
    path = tmp_path_factory.mktemp("recording") / "run.rrd"
    write_recording(log, MODEL, path)
    return contents(path)


@pytest.mark.parametrize("room", [0, 1000, 50_000])
def test_a_full_disk_leaves_nothing_and_does_not_hang(log: Log, tmp_path: Path, room: int) -> None:
    with full_disk(room), pytest.raises(NoSpaceError, match=r"run\.rrd: cannot be written"):
        write_recording(log, MODEL, tmp_path / "run.rrd")
    assert not list(tmp_path.iterdir())


def test_plots_hold_the_log_without_most_of_what_lies_between_equal_values(log: Log, recording: Contents) -> None:
    expected = {
        "/tracking_error": 1e3 * (log.stack("target") - log.stack("theta")),
        "/volts/motors": log.stack("volts"),
        "/gripper": log.columns["gripper"][:, None],
        "/payload": log.columns["payload_mass"][:, None],
    }
    for joint in (1, 2, 3):
        for kind in ("measured", "target"):
            expected[f"/angles/joint_{joint}/{kind}"] = log.columns[f"{kind}_{joint}"][:, None]
    for entity, values in expected.items():
        times, _, drawn = zip(*recording[entity]["Scalars:scalars"], strict=True)
        ticks = np.array(times) / 10_000_000
        lines = [np.interp(np.arange(TICKS), ticks, line) for line in np.array(drawn).T]
        assert np.array_equal(np.column_stack(lines), values), entity
        assert len(ticks) < TICKS / 5, entity
        assert np.diff(ticks).max() <= 10, entity


def test_plots_of_what_changes_at_every_tick_hold_every_tick(tmp_path: Path) -> None:
    run = RunLog()
    for tick in range(50):
        run.append(record(tick, "", (0.01 * tick, 0.0, 0.0), False))
    write_recording(run.freeze(), MODEL, tmp_path / "moving.rrd")
    rows = contents(tmp_path / "moving.rrd")["/angles/joint_1/measured"]["Scalars:scalars"]
    assert [value for _, _, value in rows] == [[0.01 * tick + 1e-3] for tick in range(50)]


def test_limits_span_the_run(recording: Contents) -> None:
    times, _, values = zip(*recording["/volts/limits"]["Scalars:scalars"], strict=True)
    assert times == (0, 2_990_000_000)
    assert values == ([8.0, -8.0], [8.0, -8.0])


def test_tip_is_drawn_at_the_places(recording: Contents) -> None:
    rows = recording["/cell/bodies/tip"]["Transform3D:translation"]
    # One pose from the loader, then every second tick.
    assert len(rows) == 1 + TICKS // 2
    for tick, place in ((0, PICKUP), (149, PICKUP), (299, PLACES["red"])):
        np.testing.assert_allclose(at(rows, tick), [(place.x, 0.0, place.y)], rtol=0, atol=1e-4)


def test_overridden_lengths_are_drawn(tmp_path: Path) -> None:
    run = RunLog()
    run.append(record(0, "", (0.0, 0.0, 0.0), False))
    write_recording(run.freeze(), MODEL, tmp_path / "long.rrd", ArmParameters(length=(0.2, 0.3, 0.1)))
    bodies = contents(tmp_path / "long.rrd")
    for name, reach in {"link_2": 0.2, "link_3": 0.5, "tip": 0.6}.items():
        np.testing.assert_allclose(
            at(bodies[f"/cell/bodies/{name}"]["Transform3D:translation"], 0), [(reach, 0.0, 0.0)], atol=1e-6
        )


def test_every_moving_body_has_a_pose_and_every_geom_a_shape(recording: Contents) -> None:
    for body in ("link_1", "link_2", "link_3", "jaw", "tip"):
        assert len(recording[f"/cell/bodies/{body}"]["Transform3D:quaternion"]) == 1 + TICKS // 2
    half = -PICKUP.theta[0] / 2
    drawn = at(recording["/cell/bodies/link_1"]["Transform3D:quaternion"], 100)
    np.testing.assert_allclose(drawn, [(0.0, np.sin(half), 0.0, np.cos(half))], atol=1e-6)
    assert {"/cell/bodies/conveyor", "/cell/bodies/red_belt", "/cell/trail"} <= recording.keys()


def test_every_visible_geom_is_drawn(log: Log, tmp_path: Path) -> None:
    file = tmp_path / "run.rrd"
    write_recording(log, MODEL, file)
    drawn = {chunk.entity_path.rpartition("/")[2] for chunk in RrdReader(file).stream().to_chunks()}
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    geoms = [model.geom(i) for i in range(model.ngeom)]
    visible = {geom.name for geom in geoms if geom.group[0] == 2 and geom.rgba[3] > 0}
    assert {"link_1_beam", "rack_column", "jaw_bar"} <= visible <= drawn


def test_a_box_waits_then_hangs_on_the_arm_then_lies_at_its_place(recording: Contents) -> None:
    def shown(name: str, component: str, tick: int) -> Any:
        return at(recording[f"/cell/boxes/{name}"][f"Boxes3D:{component}"], tick)

    red = [0xE0342EFF]
    for tick, seen in {0: "waiting", 99: "waiting", 100: "held", 199: "held", 200: "placed", 299: "placed"}.items():
        colours = {name: shown(name, "colors", tick) for name in ("waiting", "held", "placed")}
        assert colours == {name: red if name == seen else [] for name in colours}, tick
    place = PLACES["red"]
    np.testing.assert_allclose(shown("placed", "centers", 299), [(place.x, 0.0, place.y)], rtol=0, atol=1e-4)
    np.testing.assert_allclose(shown("held", "centers", 150), [(0.0, 0.0, 0.0)])
    labels = recording["/cell/counts"]["Points3D:labels"]
    assert at(labels, 199) == ["blue: 0", "red: 0", "green: 0"]
    assert at(labels, 200) == ["blue: 0", "red: 1", "green: 0"]


def test_lanes_show_which_box_is_where(recording: Contents) -> None:
    lanes = {
        name: [(time, value) for time, _, value in recording[f"/box/{name}"]["StateChange:state"]]
        for name in ("waiting", "held")
    }
    assert lanes == {
        "waiting": [(0, ["red"]), (1_000_000_000, ["none"])],
        "held": [(0, ["none"]), (1_000_000_000, ["red"]), (2_000_000_000, ["none"])],
    }


def test_events_are_text_with_levels(recording: Contents) -> None:
    events = recording["/events"]
    assert [value for _, _, value in events["TextLog:level"]] == [["INFO"], ["WARN"], ["ERROR"]]
    assert [(time, value) for time, _, value in events["TextLog:text"]] == [
        (500_000_000, ["a box"]),
        (2_000_000_000, ["K2"]),
        (2_500_000_000, ["beside"]),
    ]


def test_every_view_of_the_layout_has_something_to_show(log: Log, recording: Contents, tmp_path: Path) -> None:
    write_recording(log, MODEL, tmp_path / "run.rrd")
    reader = RrdReader(tmp_path / "run.rrd")
    [layout] = reader.blueprints()
    origins = set()
    for chunk in reader.stream(store=layout).to_chunks():
        batch = chunk.to_record_batch()
        if "ViewBlueprint:space_origin" in batch.schema.names:
            origins |= {value for values in batch["ViewBlueprint:space_origin"].to_pylist() for value in values}
    joints = {f"angles/joint_{joint}" for joint in (1, 2, 3)}
    expected = {"cell", "angles", "tracking_error", "volts", "gripper", "payload", "status"} | joints
    assert {origin.strip("/") for origin in origins} == {"", *expected}
    for origin in expected:
        assert any(entity == f"/{origin}" or entity.startswith(f"/{origin}/") for entity in recording), origin
    assert ranges_of(tmp_path / "run.rrd").keys() == expected - {"cell", "status"}


def test_equal_runs_have_equal_contents_and_recordings_of_others_stay_apart(tmp_path: Path) -> None:
    seen = []
    blue = run_to("blue")
    for name, run in {"a": blue, "b": run_to("blue"), "c": run_to("green"), "d": replace(blue, metadata={})}.items():
        path = tmp_path / f"{name}.rrd"
        write_recording(run, MODEL, path)
        values = {
            entity: {component: [(time, value) for time, _, value in rows] for component, rows in components.items()}
            for entity, components in contents(path).items()
        }
        seen.append((RrdReader(path).recordings()[0].recording_id, values))
    assert seen[0] == seen[1]
    assert seen[0][1] == seen[3][1]
    assert len({identity for identity, _ in seen}) == 3


def test_a_long_run_is_sent_in_parts_without_gap_or_overlap(log: Log, tmp_path: Path) -> None:
    ticks = 70_000
    columns = {name: np.resize(column, ticks) for name, column in log.columns.items()}
    columns["t"] = 0.01 * np.arange(ticks)
    write_recording(Log(columns), MODEL, tmp_path / "long.rrd")
    times: dict[str, list[Any]] = {"/cell/bodies/link_1": [], "/cell/trail": []}
    for chunk in RrdReader(tmp_path / "long.rrd").stream().to_chunks():
        if chunk.entity_path in times and not chunk.is_static:
            times[chunk.entity_path].append(chunk.to_record_batch()["plant_time"].cast(pa.int64()).to_numpy())
    for entity, found in times.items():
        assert len(found) > 1
        expected = 10_000_000 * np.arange(0, ticks, 2)
        assert np.array_equal(np.unique(np.concatenate(found)), expected), entity


def test_a_run_without_boxes_and_events_of_one_tick(tmp_path: Path) -> None:
    run = RunLog()
    run.append(record(0, "", (0.0, 0.0, 0.0), False))
    write_recording(run.freeze(), MODEL, tmp_path / "short.rrd")
    found = contents(tmp_path / "short.rrd")
    assert at(found["/cell/boxes/waiting"]["Boxes3D:centers"], 0) == []
    assert "/events" not in found


def test_writing_is_silent_and_leaves_only_the_file(
    log: Log, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_recording(log, MODEL, tmp_path / "run.rrd")
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] == ["run.rrd"]


def test_an_unwritable_path_and_an_empty_log_are_refused(log: Log, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no/run\.rrd: cannot be written: No such file or directory"):
        write_recording(log, MODEL, tmp_path / "no" / "run.rrd")
    with pytest.raises(RecordingError, match="at least one tick"):
        write_recording(RunLog().freeze(), MODEL, tmp_path / "run.rrd")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("<mujoco", "<mujoca"), "XML"),
        (('name="joint_2"', 'name="elbow"'), "expected a joint named 'joint_2', found elbow, gripper, joint_1"),
        (('name="box_held"', 'name="parcel"'), "expected a geom named 'box_held', found"),
    ],
)
def test_a_model_that_cannot_be_drawn(log: Log, tmp_path: Path, change: tuple[str, str], message: str) -> None:
    text = re.sub(r"<(actuator|sensor|keyframe)>.*</\1>", "", MODEL.read_text(), flags=re.DOTALL)
    model = tmp_path / "arm.xml"
    model.write_text(text.replace(*change))
    with pytest.raises(ModelError) as error:
        write_recording(log, model, tmp_path / "run.rrd")
    assert str(error.value).startswith(f"{model}: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)
    assert not (tmp_path / "run.rrd").exists()


def test_a_missing_model_is_named(log: Log, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match=r"absent\.xml"):
        write_recording(log, tmp_path / "absent.xml", tmp_path / "run.rrd")
