"""Recordings of ROS 2."""

from pathlib import Path

import numpy as np
import pytest

from dtwin.errors import RecordingError
from dtwin.measurements.reading import read_measurement, table_of

rosbag2 = pytest.importorskip("rosbags.rosbag2")
typesys = pytest.importorskip("rosbags.typesys")


def recorded(folder: Path, kind: str = "sensor_msgs/msg/JointState") -> Path:
    """A bag of 2 s at 50 Hz, in which the driver names its joints in another order every second time."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    time, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for k in range(100):
            stamp = header(time(k // 50, (k % 50) * 20_000_000), "")
            if kind.endswith("Header"):
                message = stamp
            else:
                names = ["a", "b"] if k % 2 else ["b", "a"]
                values = {"a": np.sin(0.1 * k), "b": np.cos(0.05 * k)}
                speeds = {"a": 5.0 * np.cos(0.1 * k), "b": -2.5 * np.sin(0.05 * k)}
                position, velocity = (np.array([column[n] for n in names]) for column in (values, speeds))
                message = store.types[kind](stamp, names, position, velocity, 3.0 * position)
            writer.write(connection, 20_000_000 * k, store.serialize_cdr(message, kind))
    return folder


def test_joint_states_are_read_from_folder_and_file(tmp_path: Path) -> None:
    folder = recorded(tmp_path / "bag")
    (file,) = folder.glob("*.mcap")
    for path in (folder, file):
        table = table_of(path)
        assert np.allclose(table.columns["position.a [rad]"], np.sin(0.1 * np.arange(100)))
        found = read_measurement(path)
        assert found.joints == ("b", "a")
        assert found.v is not None
        assert found.effort is not None
        assert found.kind is None  # the unit of an effort in JointState is the driver's: some give amperes
        assert np.allclose(found.effort, 3.0 * found.q)


def test_other_recordings_are_refused_with_what_they_hold(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"expected messages of .*JointState, got /joint_states"):
        read_measurement(recorded(tmp_path / "bag", "std_msgs/msg/Header"))
    damaged = tmp_path / "damaged.mcap"
    damaged.write_bytes(b"\x89MCAP0\r\n" + bytes(40))
    with pytest.raises(RecordingError, match=r"damaged\.mcap: expected a recording of ROS 2"):
        read_measurement(damaged)
