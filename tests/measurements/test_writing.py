"""What is written is read back: by us without a map, and by the libraries of other programs."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import dtwin
from dtwin.cli import main
from dtwin.errors import RecordingError
from dtwin.measurements.measurement import Array, Effort, Measurement
from dtwin.measurements.reading import read_measurement
from dtwin.measurements.writing import ENDINGS, write_measurement
from tests.support.chains import motion_of

NAMES = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=12)
"""Names of joints, also such as a;b, velocity or "q [rad]"."""
KINDS: list[Effort | None] = ["torque", "current", "voltage", None]


@st.composite
def measurements(draw: st.DrawFn) -> Measurement:
    """Motions with any of the quantities that a log may have, of one episode or of several."""
    n = draw(st.integers(1, 4))
    joints = tuple(draw(st.lists(NAMES, min_size=n, max_size=n, unique=True)))
    t, q, v, _ = motion_of(n, 2.0, 50.0, draw(st.integers(0, 99)))
    generator = np.random.default_rng(draw(st.integers(0, 99)))

    def some(values: Array) -> Array | None:
        return values if draw(st.booleans()) else None

    effort = some(generator.normal(size=q.shape))
    kind = draw(st.sampled_from(KINDS)) if effort is not None else None
    starts: tuple[int, ...] = (0,)
    episodes = None
    if draw(st.booleans()):
        episodes = np.repeat([3, 7], [60, len(t) - 60])
        starts = (0, 60)
        if draw(st.booleans()):
            t = np.concatenate([t[:60], t[: len(t) - 60]])
    warm = some(np.round(generator.uniform(20.0, 60.0, q.shape), 1))
    held = generator.uniform(size=len(t)) < 0.5 if draw(st.booleans()) else None
    return Measurement(
        "drawn", joints, t, q, some(v), effort, kind, some(q + 0.01), warm, starts, episodes, gripped=held
    )


def same(one: Measurement, other: Measurement, exact: bool) -> None:
    """Whether two measurements hold the same; stamps of ROS are whole nanoseconds."""
    assert other.joints == one.joints
    assert other.kind == one.kind
    assert other.starts == one.starts
    assert np.allclose(other.t, one.t, rtol=0.0, atol=0.0 if exact else 1e-9)
    for name in ("q", "v", "effort", "command", "temperature", "gripped"):
        expected, got = getattr(one, name), getattr(other, name)
        assert (expected is None) == (got is None), name
        if expected is not None:
            assert np.array_equal(got, expected), name
    if one.episodes is not None:
        assert other.episodes is not None
        assert np.array_equal(other.episodes, one.episodes)


@pytest.mark.parametrize("ending", ENDINGS)
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(measurement=measurements())
def test_what_is_written_is_read_back_without_a_map(ending: str, measurement: Measurement, tmp_path: Path) -> None:
    if ending == ".mcap":
        pytest.importorskip("rosbags")
    file = tmp_path / f"log{ending}"
    write_measurement(measurement, file)
    same(measurement, read_measurement(file), ending != ".mcap")
    assert [path.name for path in tmp_path.iterdir()] == [file.name]


def drawn(**other: Any) -> Measurement:
    t, q, v, _ = motion_of(2, 2.0, 50.0, 1)
    content: dict[str, Any] = {
        "v": v,
        "effort": 3.0 * q,
        "kind": "current",
        "command": q + 0.1,
        "temperature": q + 40.0,
    }
    return Measurement("drawn", ("lift", "turn"), t, q, **(content | other))


def test_files_name_their_units(tmp_path: Path) -> None:
    units = {"position": "rad", "velocity": "rad", "current": "A", "command": "rad", "temperature": "C"}
    columns = (f"{quantity}.{joint} [{unit}]" for quantity, unit in units.items() for joint in ("lift", "turn"))
    expected = ["t [s]", *columns]
    write_measurement(drawn(), tmp_path / "log.csv")
    write_measurement(drawn(), tmp_path / "log.parquet")
    with (tmp_path / "log.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == expected
    assert pq.read_schema(tmp_path / "log.parquet").names == expected
    assert float(rows[2][1]) == drawn().q[1, 0]


def test_the_mcap_library_reads_joint_states(tmp_path: Path) -> None:
    reader = pytest.importorskip("mcap.reader")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    pytest.importorskip("rosbags")
    measurement, file = drawn(kind="torque"), tmp_path / "log.mcap"
    write_measurement(measurement, file)
    with file.open("rb") as stream:
        found: dict[str, list[Any]] = {}
        for _, channel, _, message in reader.make_reader(
            stream, decoder_factories=[decoder.DecoderFactory()]
        ).iter_decoded_messages():
            found.setdefault(channel.topic, []).append(message)
    states = found["/joint_states"]
    assert [m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in states] == pytest.approx(measurement.t)
    assert list(states[0].name) == ["lift", "turn"]
    assert np.array_equal([m.position for m in states], measurement.q)
    assert measurement.v is not None
    assert np.array_equal([m.velocity for m in states], measurement.v)
    assert measurement.effort is not None
    assert np.array_equal([m.effort for m in states], measurement.effort)
    assert measurement.command is not None
    assert np.array_equal([m.position for m in found["/joint_commands"]], measurement.command)
    warm = [[each.values[1] for each in m.interface_values] for m in found["/dynamic_joint_states"]]
    assert measurement.temperature is not None
    assert np.array_equal(warm, measurement.temperature)


def test_a_joint_state_has_no_amperes(tmp_path: Path) -> None:
    """Its effort is a torque by definition: currents are written where they are called so."""
    highlevel = pytest.importorskip("rosbags.highlevel")
    file = tmp_path / "log.mcap"
    write_measurement(drawn(), file)
    with highlevel.AnyReader([file]) as reader:
        messages = [
            (connection.topic, reader.deserialize(raw, connection.msgtype))
            for connection, _, raw in reader.messages()
        ]
    state = next(message for topic, message in messages if topic == "/joint_states")
    assert len(state.effort) == 0
    dynamic = next(message for topic, message in messages if topic == "/dynamic_joint_states")
    assert dynamic.interface_values[0].interface_names == ["current", "temperature"]


@pytest.mark.parametrize(
    ("name", "other", "said"),
    [
        ("log.xlsx", {}, "expected a name that ends in"),
        ("missing/log.csv", {}, "cannot be written"),
        ("log.csv", {"joints": ("a", "a")}, "joint 'a': expected it once"),
        ("log.mcap", {"joints": ("a", "b\n")}, "can be printed on one line"),
    ],
)
def test_what_cannot_be_written_is_refused_and_leaves_nothing(
    name: str, other: dict[str, Any], said: str, tmp_path: Path
) -> None:
    measurement = drawn()
    joints = other.get("joints", measurement.joints)
    spoiled = Measurement("drawn", joints, measurement.t, measurement.q)
    with pytest.raises(RecordingError, match=said):
        write_measurement(spoiled, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_a_recording_of_a_percentage_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    with pytest.raises(RecordingError, match="positions are percent"):
        write_measurement(drawn(), tmp_path / "log.mcap", "percent")
    assert not list(tmp_path.iterdir())


def test_the_command_converts_a_foreign_log_with_its_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    t, q, _, _ = motion_of(2, 3.0, 50.0, 1)
    log, columns = tmp_path / "foreign.csv", tmp_path / "map.toml"
    rows = [",".join(f"{value:.9f}" for value in row) for row in np.column_stack([1e3 * t, np.degrees(q), 5.0 * q])]
    log.write_text("ms,a,b,x,y\n" + "\n".join(rows))
    columns.write_text(
        'time = "ms"\ntime_unit = "ms"\n[position]\ncolumns = ["a", "b"]\nunit = "deg"\n'
        '[effort]\ncolumns = ["x", "y"]\nunit = "mA"\n'
    )
    for ending in ENDINGS:
        out = tmp_path / f"out{ending}"
        assert main(["log", "convert", str(log), str(out), "--columns", str(columns)]) == 0
        assert f"written: {out}" in capsys.readouterr().out
        found = read_measurement(out)
        assert found.joints == ("a", "b")
        assert found.kind == "current"
        assert np.allclose(found.q, q, atol=1e-9)
        assert found.effort is not None
        assert np.allclose(found.effort, 0.005 * q, atol=1e-9)


def test_the_command_writes_nothing_of_a_log_that_cannot_be_read(tmp_path: Path) -> None:
    out = tmp_path / "out.csv"
    out.write_text("as before")
    assert main(["log", "convert", str(tmp_path / "none.csv"), str(out)]) == 2
    assert out.read_text() == "as before"


def test_a_log_of_the_cell_is_written_as_it_was_measured(tmp_path: Path) -> None:
    run = dtwin.Cell(seed=1, noise=0.001, noise_kind="gaussian").run(seconds=2)
    run.save(tmp_path / "run.parquet")
    assert main(["log", "convert", str(tmp_path / "run.parquet"), str(tmp_path / "out.csv")]) == 0
    found = read_measurement(tmp_path / "out.csv")
    assert found.kind == "voltage"
    assert np.array_equal(found.q, run.log.stack("measured"))  # what was true is written nowhere else
