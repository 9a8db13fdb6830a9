"""A measurement as a recording of ROS 2: one MCAP file."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from dtwin.measurements.formats.bag_types import (
    COMMANDS,
    DYNAMIC,
    EPISODES,
    GRIPS,
    INTERFACES,
    JOINT_STATE,
    NUMBER,
    STATES,
    typestore,
)
from dtwin.measurements.measurement import Array, Measurement
from dtwin.measurements.naming import UNITS

_SECOND: Final = 1_000_000_000


def write_bag(measurement: Measurement, path: Path) -> None:
    """Writes one MCAP file.

    /joint_states has positions, velocities, and an effort that is a torque, or of which nobody knows what it is;
    /dynamic_joint_states what JointState has no word or unit for: torque, current, voltage, temperature, and
    positions of the motors; /joint_commands the commanded positions; /episode the number of the episode, and
    /gripped whether the gripper is closed, whenever it changes. The stamps of the headers are those of the
    measurement; the times of the recording go on where stamps begin again.

    Raises:
        RecordingError: rosbags is not installed.
        OSError: the file cannot be written.
    """
    store = typestore(path)
    from rosbags.rosbag2 import StoragePlugin, Writer

    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".dtwin") as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            opened: dict[str, Any] = {}
            for topic, kind, time, message in _messages(measurement, store):
                if topic not in opened:
                    opened[topic] = writer.add_connection(topic, kind, typestore=store)
                writer.write(opened[topic], time, store.serialize_cdr(message, kind))
        os.replace(next(bag.glob("*.mcap")), path)


def _messages(measurement: Measurement, store: Any) -> Iterator[tuple[str, str, int, Any]]:
    """Topic, type, time of the recording in ns, and message, row by row."""
    names = list(measurement.joints)
    header, stamp = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    state, empty = store.types[JOINT_STATE], np.zeros(0)
    effort = measurement.effort if measurement.kind in ("torque", None) else None
    stamps = np.rint(measurement.t * _SECOND).astype(np.int64)
    extra = _interfaces(measurement)
    numbers = {EPISODES: measurement.episodes, GRIPS: measurement.gripped}
    before: dict[str, int] = {}

    def at(values: Array | None, row: int) -> Array:
        return empty if values is None else values[row]

    for row, time in enumerate(_times(stamps, measurement.step).tolist()):
        head = header(stamp(*map(int, divmod(int(stamps[row]), _SECOND))), "")
        for topic, values in numbers.items():
            if values is not None and int(values[row]) != before.get(topic):
                before[topic] = int(values[row])
                yield topic, NUMBER, time, store.types[NUMBER](before[topic])
        message = state(head, names, measurement.q[row], at(measurement.v, row), at(effort, row))
        yield STATES, JOINT_STATE, time, message
        if measurement.command is not None:
            yield COMMANDS, JOINT_STATE, time, state(head, names, measurement.command[row], empty, empty)
        if extra:
            value = store.types["control_msgs/msg/InterfaceValue"]
            each = [value(list(extra), np.array([v[row, j] for v in extra.values()])) for j in range(len(names))]
            yield INTERFACES, DYNAMIC, time, store.types[DYNAMIC](head, names, each)


def _interfaces(measurement: Measurement) -> dict[str, Array]:
    """What ros2_control calls interfaces, (N, n) each, by their names."""
    found = {}
    if measurement.effort is not None and measurement.kind is not None:
        found[UNITS[measurement.kind][0]] = measurement.effort
    if measurement.temperature is not None:
        found["temperature"] = measurement.temperature
    if measurement.motor is not None:
        found["motor"] = measurement.motor
    return found


def _times(stamps: np.ndarray, step: float) -> np.ndarray:
    """Times of the recording, ns: rising, also where stamps begin again, and not below 0."""
    steps = np.diff(stamps)
    again = max(1, round(step * _SECOND))
    first = max(0, int(stamps[0])) if len(stamps) else 0
    return first + np.concatenate([[0], np.cumsum(np.where(steps > 0, steps, again))]).astype(np.int64)
