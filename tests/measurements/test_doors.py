"""Files of other programs: one measurement, whatever file it lies in."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from dtwin.errors import RecordingError
from dtwin.measurements.doors import read_table
from dtwin.measurements.measurement import Measurement
from dtwin.measurements.reading import read_measurement
from tests.support.chains import drawn_arm, measured


@pytest.fixture(scope="module")
def truth(tmp_path_factory: pytest.TempPathFactory) -> Measurement:
    return measured(drawn_arm(tmp_path_factory.mktemp("arm"), 2, 8), 5.0, 5)


def arrays(truth: Measurement) -> dict[str, np.ndarray]:
    assert truth.v is not None
    assert truth.effort is not None
    return {"time": truth.t, "q": truth.q, "qd": truth.v, "tau_measured": truth.effort}


@pytest.mark.parametrize("ending", [".npz", ".mat", ".parquet"])
def test_arrays_are_read_from_every_kind_of_file(ending: str, truth: Measurement, tmp_path: Path) -> None:
    file = tmp_path / f"log{ending}"
    content = arrays(truth)
    if ending == ".npz":
        np.savez(file, allow_pickle=False, **content)
    elif ending == ".mat":
        scipy.io.savemat(file, {name: value.T for name, value in content.items()})  # matrices that lie on their side
    else:
        columns = {name: value.tolist() for name, value in content.items()}
        pq.write_table(pa.table(columns), file)
    found = read_measurement(file)
    assert truth.effort is not None
    assert found.effort is not None
    assert np.allclose(found.q, truth.q)
    assert np.allclose(found.effort, truth.effort)
    assert found.kind == "torque"


def lerobot(folder: Path, rows: int = 60) -> Path:
    names = ["pan.pos", "lift.pos"]
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    features = {"action": {"names": names}, "observation.state": {"names": names}, "timestamp": {"names": None}}
    (folder / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v3.0", "features": features}))
    k = np.arange(2 * rows)
    episode, frame = k // rows, k % rows
    state = np.stack([30.0 * np.sin(0.1 * k), 20.0 * np.cos(0.1 * k)], axis=1).astype(np.float32)
    table = {
        "action": [row.tolist() for row in np.roll(state, -2, axis=0)],
        "observation.state": [row.tolist() for row in state],
        "timestamp": (frame / 30.0).astype(np.float32),
        "episode_index": episode,
        "index": k,
    }
    pq.write_table(pa.table(table), folder / "data" / "chunk-000" / "file-000.parquet")
    return folder


def test_a_lerobot_data_set_is_read_episode_by_episode(tmp_path: Path) -> None:
    found = read_measurement(lerobot(tmp_path / "set"))
    assert found.starts == (0, 60)
    assert found.effort is None
    assert found.command is not None
    assert np.isclose(np.degrees(found.q[0, 1]), 20.0)
    assert found.joints == ("pan", "lift")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("log.bag", b"x", "expected a name that ends in"),
        ("log.parquet", b"PAR1", "expected a Parquet file"),
        ("log.npz", b"PK", "expected an NPZ file"),
        ("log.mat", b"x", "expected a MAT file"),
        ("log.csv", b"", "this is empty"),
        ("log.csv", b"\xff\xfe\x00", "expected text in UTF-8"),
    ],
)
def test_what_is_no_log_is_refused_by_name(name: str, content: bytes, said: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(content)
    with pytest.raises(RecordingError) as error:
        read_table(file)
    assert str(error.value).startswith(str(file))
    assert said in str(error.value)


def test_pickled_objects_are_never_loaded(tmp_path: Path) -> None:
    file = tmp_path / "log.npz"
    np.savez(file, q=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordingError, match="expected an NPZ file of numbers"):
        read_table(file)
