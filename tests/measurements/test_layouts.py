"""Layouts of other programs: right numbers in the arm's order, or a refusal that says where."""

import datetime as dt
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from dtwin.arm.chain import Arm
from dtwin.errors import RecordingError
from dtwin.measurements.columns import ColumnMap, Role
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from tests.support.chains import drawn_arm, measured

ORDER = [2, 0, 1]
"""Another order of the joints."""
START = 1_714_557_600


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    return drawn_arm(tmp_path_factory.mktemp("arm"), 3, 8)


@pytest.fixture(scope="module")
def truth(arm: Arm) -> Measurement:
    return measured(arm, 5.0, 5)


def head(form: str, *words: str) -> list[str]:
    """Names of the columns of three quantities (or of those that are given) of three joints."""
    return [form.format(word=word, k=k, j=k + 1) for word in words for k in range(3)]


def numbers(
    truth: Measurement, *, degrees: bool = False, effort: float = 1.0, order: list[int] | None = None
) -> np.ndarray:
    assert truth.v is not None
    assert truth.effort is not None
    angle = 180.0 / np.pi if degrees else 1.0
    kept = order or [0, 1, 2]
    return np.hstack([angle * truth.q[:, kept], angle * truth.v[:, kept], effort * truth.effort[:, kept]])


def text(
    names: list[str],
    t: list[str],
    values: np.ndarray,
    mark: str = ",",
    comma: bool = False,
    above: str = "",
    end: str = "",
) -> str:
    rows = [[stamp, *(f"{value:.7f}" for value in row)] for stamp, row in zip(t, values.tolist(), strict=True)]
    lines = [mark.join(names)] + [mark.join(f.replace(".", ",") if comma else f for f in row) + end for row in rows]
    return above + "\n".join(lines) + "\n"


def seconds(truth: Measurement) -> list[str]:
    return [f"{t:.4f}" for t in truth.t]


def clocks(truth: Measurement, form: str, zone: dt.tzinfo | None = None) -> list[str]:
    start = dt.datetime.fromtimestamp(START, dt.UTC)
    return [(start + dt.timedelta(seconds=t)).astimezone(zone or dt.UTC).strftime(form) for t in truth.t.tolist()]


Make = Callable[[Measurement], str]
PLAIN = ["t", *head("{word}{k}", "q", "qd", "tau")]
STAMPED = ["timestamp", *PLAIN[1:]]
TEXTS: dict[str, Make] = {
    "decimal commas between tabs": lambda m: text(PLAIN, seconds(m), numbers(m), "\t", True),
    "bars": lambda m: text(PLAIN, seconds(m), numbers(m), "|"),
    "a delimiter at the end of rows": lambda m: text(PLAIN, seconds(m), numbers(m), end=","),
    "words above the header": lambda m: text(PLAIN, seconds(m), numbers(m), above="Robot: X\nRate: 100 Hz\n"),
    "a header in a comment": lambda m: text(["# t", *PLAIN[1:]], seconds(m), numbers(m)),
    "a row of units": lambda m: text(PLAIN, seconds(m), numbers(m, degrees=True, effort=1e3)).replace(
        "\n", "\ns" + 3 * ",deg" + 3 * ",deg/s" + 3 * ",mNm" + "\n", 1
    ),
    "units in brackets": lambda m: text(
        ["Time (ms)", *head("Joint {j} {word}", "Position (deg)", "Velocity (deg/s)", "Torque (mNm)")],
        [f"{1e3 * t:.1f}" for t in m.t],
        numbers(m, degrees=True, effort=1e3),
    ),
    "numbers in brackets": lambda m: text(["time", *head("{word}[{k}]", "q", "dq", "tau_J")], seconds(m), numbers(m)),
    "joint by joint": lambda m: text(
        ["t", *(f"j{k}.{word}" for k in range(3) for word in ("pos", "vel", "torque"))],
        seconds(m),
        numbers(m)[:, [k + 3 * word for k in range(3) for word in range(3)]],
    ),
    "joints in another order": lambda m: text(
        ["t", *(f"joint_{k + 1}_{word}" for word in ("position", "velocity", "torque") for k in ORDER)],
        seconds(m),
        numbers(m, order=ORDER),
    ),
    "topics in names": lambda m: text(
        ["__time", *(f"/states/joint_{k + 1}/{word}" for word in ("position", "velocity", "torque") for k in ORDER)],
        [f"{START + t:.4f}" for t in m.t],
        numbers(m, order=ORDER),
    ),
    "stamps with a zone": lambda m: text(
        STAMPED, clocks(m, "%Y-%m-%dT%H:%M:%S.%f+02:00", dt.timezone(dt.timedelta(hours=2))), numbers(m)
    ),
    "stamps without a zone": lambda m: text(STAMPED, clocks(m, "%Y-%m-%d %H:%M:%S.%f"), numbers(m)),
    "stamps over midnight": lambda m: text(
        ["time", *PLAIN[1:]],
        clocks(m, "%H:%M:%S.%f", dt.timezone(dt.timedelta(hours=13, minutes=59, seconds=58))),
        numbers(m),
    ),
    "nanoseconds since 1970": lambda m: text(
        STAMPED, [str(START * 10**9 + round(1e9 * t)) for t in m.t.tolist()], numbers(m)
    ),
    "seconds and nanoseconds": lambda m: text(
        ["stamp.sec", "stamp.nanosec", *PLAIN[1:]],
        [f"{START + round(1e2 * t) // 100},{round(1e2 * t) % 100 * 10_000_000}" for t in m.t.tolist()],
        numbers(m),
    ),
    "words for what is missing": lambda m: (
        text(PLAIN, seconds(m), numbers(m)).replace(",", ", ").replace(f"{m.q[7, 1]:.7f}", "NA")
    ),
}


def same(found: Measurement, truth: Measurement) -> None:
    assert truth.effort is not None
    assert found.effort is not None
    assert found.kind == "torque"
    assert np.allclose(found.t - found.t[0], truth.t, atol=1e-6)
    assert np.allclose(found.q, truth.q, atol=1e-4)
    assert np.allclose(found.effort, truth.effort, atol=1e-4)


@pytest.mark.parametrize("layout", TEXTS)
def test_a_text_of_another_program_gives_the_numbers_in_it(
    layout: str, arm: Arm, truth: Measurement, tmp_path: Path
) -> None:
    (tmp_path / "log.csv").write_text(TEXTS[layout](truth))
    same(read_measurement(tmp_path / "log.csv", None, arm), truth)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_a_text_may_be_encoded_otherwise(encoding: str, arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    names = ["t", *head("q{j} [°]", ""), *head("qd{j} [°/s]", ""), *head("tau{j} [Nm]", "")]
    (tmp_path / "log.csv").write_text(text(names, seconds(truth), numbers(truth, degrees=True), ";", True), encoding)
    same(read_measurement(tmp_path / "log.csv", None, arm), truth)


REFUSED: dict[str, tuple[Make, str]] = {
    "commas for thousands": (
        lambda m: text(PLAIN, seconds(m), numbers(m), ";").replace(f"{m.q[9, 0]:.7f}", "1,234.5"),
        r"column q0, row 9: expected one decimal sign in the whole file",
    ),
    "degrees that are called radians": (
        lambda m: text(
            ["t", *head("q{j}_rad", ""), *head("tau{j}", "")],
            seconds(m),
            numbers(m, degrees=True)[:, [0, 1, 2, 6, 7, 8]],
        ),
        r"column q1_rad, row \d+: expected -3 to 3",
    ),
    "one joint in other units": (
        lambda m: text(["t", "q1 [deg]", "q2 [rad]", "q3 [deg]", *PLAIN[4:]], seconds(m), numbers(m)),
        r"column q2 \[rad\]: expected one unit for all columns of position",
    ),
    "ticks of an unknown encoder": (
        lambda m: text(["t", *head("q{j} [ticks]", ""), *PLAIN[4:]], seconds(m), numbers(m)),
        r"column q1 \[ticks\]: ticks: expected how many a turn",
    ),
    "minutes": (
        lambda m: text(["t [min]", *PLAIN[1:]], seconds(m), numbers(m)),
        r"column t \[min\]: expected stamps in s, ms, us or ns, got 'min'",
    ),
    "days": (
        lambda m: text(PLAIN, [f"{738000.5 + t / 86400.0:.12f}" for t in m.t.tolist()], numbers(m)),
        r"column t, row 0: a row every 1\.\d+e-07 s: expected at least 1e-5 s",
    ),
    "stamps of two kinds": (
        lambda m: text(
            STAMPED, clocks(m, "%Y-%m-%dT%H:%M:%S.%fZ")[:250] + clocks(m, "%H:%M:%S.%f")[250:], numbers(m)
        ),
        r"row 250: column timestamp: expected a number",
    ),
    "a row for each joint": (
        lambda m: "time,joint,position,torque\n" + "".join(f"{t:.2f},{k},0.1,2.0\n" for t in m.t for k in range(3)),
        r"expected 3 columns of positions, one for each joint: .* are joint, position",
    ),
    "nanoseconds that are called seconds": (
        lambda m: text(
            ["t [s]", *PLAIN[1:]], [str(START * 10**9 + round(1e9 * t)) for t in m.t.tolist()], numbers(m)
        ),
        r"column t \[s\], row 0: expected stamps below 1e15 s",
    ),
}


@pytest.mark.parametrize("layout", REFUSED)
def test_a_text_that_may_mean_something_else_is_refused_where_it_is(
    layout: str, arm: Arm, truth: Measurement, tmp_path: Path
) -> None:
    make, said = REFUSED[layout]
    (tmp_path / "log.csv").write_text(make(truth))
    with pytest.raises(RecordingError, match=said):
        read_measurement(tmp_path / "log.csv", None, arm)


def test_columns_of_another_rate_are_drawn_through_and_told(arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    rows = text(PLAIN, seconds(truth), numbers(truth)).splitlines()
    rows[1:] = [row if k % 5 == 0 else ",".join(row.split(",")[:7]) + ",,," for k, row in enumerate(rows[1:])]
    (tmp_path / "log.csv").write_text("\n".join(rows))
    found = read_measurement(tmp_path / "log.csv", None, arm)
    assert truth.effort is not None
    assert found.effort is not None
    assert len(found) == 496  # nothing is known after the last value
    assert np.allclose(found.effort[::5], truth.effort[:496:5], atol=1e-4)
    assert any("values come every 5 rows" in odd.what for odd in found.oddities)


def test_a_counter_of_16_bits_may_begin_again(arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    """At the joint that is 1 rad: nothing but the number of ticks tells it from motion."""
    ticks = np.round(truth.q * 101.0 * 4096.0 / (2.0 * np.pi)).astype(np.int64)
    wrapped = (ticks + 2**15) % 2**16 - 2**15
    assert (wrapped != ticks).any()
    names = ["t", *head("q{k}", ""), *PLAIN[7:]]
    (tmp_path / "log.csv").write_text(text(names, seconds(truth), np.hstack([wrapped, numbers(truth)[:, 6:]])))
    role = Role(tuple(names[1:4]), "tick", gear=(101.0, 101.0, 101.0))
    columns = ColumnMap(role, "t", effort=Role(tuple(names[4:]), "N m"))
    found = read_measurement(tmp_path / "log.csv", columns, arm)
    turns = np.round((found.q - truth.q)[0] / (2.0 * np.pi * 2**16 / 4096.0 / 101.0))
    assert np.allclose(found.q - turns * 2.0 * np.pi * 2**16 / 4096.0 / 101.0, truth.q, atol=1e-4)
    assert any("counter" in odd.what for odd in found.oddities)


def test_a_position_that_jumps_is_told_and_no_motion(arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    values = numbers(truth)
    values[200:, 0] += 0.8
    (tmp_path / "log.csv").write_text(text(PLAIN, seconds(truth), values))
    found = read_measurement(tmp_path / "log.csv", None, arm)
    assert found.starts == (0, 200)
    assert any("a position jumps by" in odd.what and odd.row == 200 and not odd.repaired for odd in found.oddities)


def test_columns_that_do_not_belong_together_are_no_single_joint(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_text("t,left pos,angle of wheel\n" + "".join(f"{k},{k},{k}\n" for k in range(30)))
    with pytest.raises(RecordingError, match="columns of positions that do not belong together"):
        read_measurement(tmp_path / "log.csv")


def test_small_angles_of_a_lerobot_set_are_doubted(tmp_path: Path) -> None:
    names = ["pan.pos", "lift.pos"]
    (tmp_path / "meta").mkdir()
    (tmp_path / "data").mkdir()
    features = {"observation.state": {"names": names}, "timestamp": {"names": None}}
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"features": features}))
    k = np.arange(60)
    state = np.stack([np.sin(0.1 * k), np.cos(0.1 * k)], axis=1).tolist()
    table = pa.table({"observation.state": state, "timestamp": k / 30.0, "episode_index": 0 * k})
    pq.write_table(table, tmp_path / "data" / "a.parquet")
    pq.write_table(table.slice(0, 0), tmp_path / "data" / "b.parquet")  # an episode without rows
    assert any("taken for degrees" in odd.what and not odd.repaired for odd in read_measurement(tmp_path).oddities)
    (tmp_path / "data" / "b.parquet").write_bytes(b"PAR1")
    with pytest.raises(RecordingError, match=r"b\.parquet: expected a Parquet file"):
        read_measurement(tmp_path)


@pytest.mark.parametrize("kind", ["structures", "words", "decimals", "records", "dates", "struct"])
def test_arrays_may_lie_in_others(kind: str, arm: Arm, truth: Measurement, tmp_path: Path) -> None:
    assert truth.effort is not None
    q, tau, ns = truth.q, truth.effort, np.round(1e9 * truth.t).astype(np.int64)
    file = tmp_path / (
        "log.npz" if kind in ("records", "dates") else "log.mat" if kind == "struct" else "log.parquet"
    )
    if kind == "structures":
        state = [{"position": a, "torque": b} for a, b in zip(q.tolist(), tau.tolist(), strict=True)]
        pq.write_table(pa.table({"t": truth.t, "state": state}), file)
    elif kind == "words":
        stamps = clocks(truth, "%Y-%m-%dT%H:%M:%S.%fZ")
        pq.write_table(pa.table({"timestamp": stamps, "q": q.tolist(), "tau": tau.tolist()}), file)
    elif kind == "decimals":
        angles = {f"q{k}": pa.array(q[:, k]).cast(pa.decimal128(20, 9), safe=False) for k in range(3)}
        times = pa.array(ns, pa.duration("ns"))
        pq.write_table(pa.table({"time": times, **angles, "tau": tau.tolist()}), file)
    elif kind == "records":
        records = np.zeros(len(ns), dtype=[("t", "f8"), ("q", "f8", (3,)), ("tau", "f8", (3,))])
        records["t"], records["q"], records["tau"] = truth.t, q, tau
        np.savez(file, allow_pickle=False, data=records)
    elif kind == "dates":
        np.savez(file, allow_pickle=False, t=np.datetime64(START, "s") + ns.astype("m8[ns]"), q=q, tau=tau)
    else:
        scipy.io.savemat(file, {"log": {"t": truth.t, "q": q, "tau": tau}})
    same(read_measurement(file, None, arm), truth)


def test_an_array_of_another_length_is_told(truth: Measurement, tmp_path: Path) -> None:
    assert truth.effort is not None
    np.savez(tmp_path / "log.npz", allow_pickle=False, t=truth.t, q=truth.q, tau=truth.effort[:-1])
    found = read_measurement(tmp_path / "log.npz")
    assert any("arrays without 500 rows are left out: tau (499, 3)" in odd.what for odd in found.oddities)


def columns(folder: Path, *names: str, **others: list[str]) -> Path:
    """A log of a joint that swings for 3 s, with columns of words beside it."""
    t = np.arange(300) * 0.01
    file = folder / "log.csv"
    rows = [[f"{s:.2f}", f"{np.sin(s):.5f}", f"{np.cos(s):.5f}"] for s in t]
    head = ",".join([*names, *others])
    lines = [",".join([*row, *(words[k] for words in others.values())]) for k, row in enumerate(rows)]
    file.write_text("\n".join([head, *lines]) + "\n")
    return file


def test_columns_of_words_are_left_out_and_told(tmp_path: Path) -> None:
    file = columns(tmp_path, "t", "q1", "tau1", mode=["AUTO"] * 290 + ["7"] * 10, state=["run"] * 300)
    found = read_measurement(file)
    assert found.q.shape == (300, 1)
    assert [odd.what for odd in found.oddities] == ["columns without numbers are left out: mode, state"]


def test_stamps_in_words_are_the_time_whatever_their_column_is_called(tmp_path: Path) -> None:
    start = dt.datetime(2026, 3, 29, 1, 59, 58)
    days = [(start + dt.timedelta(seconds=0.01 * k)).isoformat() for k in range(300)]
    found = read_measurement(columns(tmp_path, "row", "q1", "tau1", recorded=days))
    assert found.t[-1] == pytest.approx(2.99)


@pytest.mark.parametrize("name", ["Zeit in s", "datetime", "time [s]", "zeit_s"])
def test_other_names_of_the_time(tmp_path: Path, name: str) -> None:
    assert read_measurement(columns(tmp_path, name, "q1", "eff1")).t[-1] == pytest.approx(2.99)


def test_what_is_missing_is_said_with_what_is_there(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"in a map of columns \(--columns\); the file has turn, q1, tau1"):
        read_measurement(columns(tmp_path, "turn", "q1", "tau1"))
    few = tmp_path / "few.csv"
    for rows in (1, 2):
        few.write_text("t,q1\n" + "".join(f"{k},0.1\n" for k in range(rows)))
        with pytest.raises(RecordingError, match=f"expected at least 20 rows, got {rows}"):
            read_measurement(few)


def test_recordings_of_ros_are_among_what_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "log.json").write_text("{}")
    with pytest.raises(RecordingError, match=r"\.mcap or \.db3, or the folder of a LeRobot data set or of a rosbag2"):
        read_measurement(tmp_path / "log.json")
