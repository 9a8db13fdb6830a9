"""ROS 2 recordings: JointState messages of a rosbag2 folder or of an MCAP file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from dtwin.errors import RecordingError
from dtwin.measurements.doors import Table
from dtwin.measurements.measurement import Array

_TYPE: Final = "sensor_msgs/msg/JointState"
_FIELDS: Final = ("position", "velocity", "effort")


def read_bag(path: Path) -> Table:
    """Reads the JointState messages of the topic that has most of them.

    Columns are stamp (s, that of the header, or of the recorder where the header has none), then position.NAME,
    velocity.NAME and effort.NAME of every joint that the first message names. A message without one of these joints
    gives NaN.

    Raises:
        RecordingError: rosbags is not installed, the recording is damaged, or it holds no JointState.
    """
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
    except ImportError:
        raise RecordingError(f"{path}: expected rosbags to be installed: pip install 'dtwin[rosbag]'") from None
    try:
        with AnyReader([path]) as reader:
            found = [connection for connection in reader.connections if connection.msgtype == _TYPE]
            if not found:
                topics = ", ".join(sorted(f"{c.topic} ({c.msgtype})" for c in reader.connections)) or "nothing"
                raise RecordingError(f"{path}: expected messages of {_TYPE}, got {topics}")
            topic = max(found, key=lambda connection: connection.msgcount).topic
            messages = [
                (time, reader.deserialize(raw, connection.msgtype))
                for connection, time, raw in reader.messages([c for c in found if c.topic == topic])
            ]
    except (AnyReaderError, ValueError, KeyError, OSError) as error:
        raise RecordingError(f"{path}: expected a recording of ROS 2: {str(error).splitlines()[0][:80]}") from None
    if not messages:
        raise RecordingError(f"{path}: topic {topic}: expected messages, got none")
    columns = {"stamp": _stamps(messages)}
    for field in _FIELDS:
        columns |= dict(_field(field, [message for _, message in messages]))
    return Table(f"{path} {topic}", columns, np.arange(len(messages)))


def _stamps(messages: list[tuple[int, Any]]) -> Array:
    """Stamps since the first message, s."""
    stamps = [message.header.stamp for _, message in messages]
    heads = np.array([1_000_000_000 * stamp.sec + stamp.nanosec for stamp in stamps], dtype=np.int64)
    chosen = heads if heads.any() else np.array([time for time, _ in messages], dtype=np.int64)
    return 1e-9 * (chosen - chosen[0]).astype(np.float64)


def _field(field: str, messages: list[Any]) -> Iterator[tuple[str, Array]]:
    """The columns of one field; none where the messages leave it empty."""
    values = [dict(zip(message.name, getattr(message, field), strict=False)) for message in messages]
    for name in messages[0].name:
        column = np.array([row.get(name, np.nan) for row in values], dtype=np.float64)
        if np.isfinite(column).any():
            yield f"{field}.{name}", column
