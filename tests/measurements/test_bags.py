"""Recordings of ROS 2."""

from pathlib import Path

import numpy as np
import pytest

from dtwin.errors import RecordingError
from dtwin.measurements.reading import read_measurement, table_of
from tests.support.chains import drawn_arm

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


def states(folder: Path, topics: dict[str, list[tuple[float, list[str], list[float]]]]) -> Path:
    """A bag with messages (time, names, positions) of several topics."""
    store, kind = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE), "sensor_msgs/msg/JointState"
    time, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    with rosbag2.Writer(folder, version=9, storage_plugin=rosbag2.StoragePlugin.MCAP) as writer:
        for topic, messages in topics.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for t, names, values in messages:
                ns = round(1e9 * t)
                stamp, none = header(time(ns // 10**9, ns % 10**9), ""), np.zeros(0)
                message = store.types[kind](stamp, names, np.array(values), none, none)
                writer.write(connection, ns, store.serialize_cdr(message, kind))
    return folder


def test_of_several_topics_that_of_the_arm_is_read_in_its_order(tmp_path: Path) -> None:
    """A gripper's topic has more messages, and its messages come in the arm's topic, too; another arm has as many."""
    arm = drawn_arm(tmp_path, 2, 8)
    times = [0.02 * k for k in range(100)]
    mine = [(t, ["joint_2", "finger", "joint_1"], [np.cos(t), 0.01, np.sin(t)]) for t in times]
    finger = [(t + 0.001, ["finger"], [0.02]) for t in times]
    both = sorted([*mine, *finger], key=lambda message: message[0] - 0.01 * len(message[1]))
    other = [(t, ["a", "b", "c"], [0.1, t, t]) for t in times]
    gripper = [(0.002 * k, ["finger"], [0.02]) for k in range(1000)]
    folder = states(tmp_path / "bag", {"/gripper": gripper, "/other": other, "/joint_states": both})
    found = read_measurement(folder, None, arm)
    assert found.joints == ("joint_1", "joint_2")
    assert np.allclose(found.q, np.stack([np.sin(times), np.cos(times)], axis=1))
    assert any("topic /gripper" in odd.what for odd in found.oddities)
