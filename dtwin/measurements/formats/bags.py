"""ROS 2 recordings: messages of joints in a rosbag2 folder or in an MCAP file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from dtwin.errors import RecordingError
from dtwin.measurements.doors import Table
from dtwin.measurements.formats.bag_types import DYNAMIC, EPISODES, GRIPS, JOINT_STATE, NUMBER
from dtwin.measurements.measurement import Array, Oddity
from dtwin.measurements.naming import EPISODE, GRIPPED, KINDS, TIME, UNITS, checked_joints, column_name

_NUMBERS: Final = {EPISODES: EPISODE, GRIPS: GRIPPED}
"""Topics of single numbers, which hold until the next one, with the names of their columns."""
_FIELDS: Final = ("position", "velocity", "effort")
_COMMANDED: Final = re.compile(r"command|cmd|target|desired|reference|goal", re.IGNORECASE)
"""What topics of commanded joint states are called."""
_SCALED: Final = {"temperature": "C", "motor": "rad"} | {
    name: UNITS[kind][1] for name, kind in KINDS.items() if kind is not None
}
"""Interfaces of ros2_control whose unit is known by their names."""


class _Message(NamedTuple):
    time: int
    message: Any


def read_bag(path: Path, wanted: Sequence[str] = ()) -> Table:
    """Reads the JointState messages of one topic, and what goes with them.

    It is the topic, and in it the message, that names the joints that are wanted, else most joints. Messages of the
    topic that name none of its joints, such as those of a gripper, are left out, and other topics are told.

    Columns are named as our own files name them: the stamp (s since the first message, that of the header, or of the
    recorder where the header has none), then position, velocity and effort of every joint that it names. The
    unit of an effort is not known, as some drivers give amperes there; torque, current, voltage and temperature of a
    topic of DynamicJointState have theirs, and count instead of it. A topic of JointState with a name such as
    /joint_commands gives the commanded positions. Of these other topics each row has the latest message before it. A
    message without one of the joints gives NaN.

    Args:
        path: the recording.
        wanted: names of the joints that are looked for; none where they are not known.

    Raises:
        RecordingError: rosbags is not installed, the recording is damaged, or it holds no JointState.
    """
    topics = _topics(path)
    states = {topic: messages for (topic, kind), messages in topics.items() if kind == JOINT_STATE}
    measured = {topic: messages for topic, messages in states.items() if not _COMMANDED.search(topic)} or states
    if not measured:
        held = ", ".join(sorted(f"{topic} ({kind})" for topic, kind in topics)) or "nothing"
        raise RecordingError(f"{path}: expected messages of {JOINT_STATE}, got {held}")
    topic, named = max(
        ((name, _joints(messages, wanted)) for name, messages in measured.items()),
        key=lambda each: (set(wanted) <= set(each[1]), len(each[1]), len(measured[each[0]])),
    )
    if not measured[topic]:
        raise RecordingError(f"{path}: topic {topic}: expected messages, got none")
    joints = checked_joints(f"{path}: topic {topic}", named)
    asked = set(wanted) if set(wanted) <= set(joints) and wanted else set(joints)
    rows = [row for row in measured[topic] if not asked.isdisjoint(row.message.name)]
    others = sorted(name for name in measured if name != topic)
    odd = tuple(Oddity(f"topic {name} has joints, too, and is not read", False) for name in others)
    times = np.array([row.time for row in rows], dtype=np.int64)
    columns: dict[str, Array] = {}
    for field in _FIELDS:
        columns |= _named(field, "rad", joints, [_state(row.message, field) for row in rows])
    commands = next((found for name, found in states.items() if name != topic and _COMMANDED.search(name)), None)
    if commands:
        held_rows = _held(times, commands)
        columns |= _named("command", "rad", joints, [_state(row, "position") for row in held_rows])
    columns |= _dynamic(topics, times, joints, columns)
    for said, name in _NUMBERS.items():
        if numbers := topics.get((said, NUMBER)):
            columns[name] = np.array(
                [np.nan if m is None else m.data for m in _held(times, numbers)], dtype=np.float64
            )
    return Table(f"{path} {topic}", {TIME: _stamps(rows)} | columns, np.arange(len(rows)), odd)


def _joints(messages: Sequence[_Message], wanted: Sequence[str]) -> tuple[str, ...]:
    """The names of the message that has those that are wanted, else most; of several the first."""
    names = {tuple(row.message.name): None for row in messages}
    return max(names, key=lambda each: (set(wanted) <= set(each), len(each)), default=())


def _topics(path: Path) -> dict[tuple[str, str], list[_Message]]:
    """Every topic of the recording with its type; messages of the types that are read."""
    try:
        from rosbags.highlevel import AnyReader, AnyReaderError
    except ImportError:
        raise RecordingError(f"{path}: expected rosbags to be installed: pip install 'dtwin[rosbag]'") from None
    try:
        with AnyReader([path]) as reader:
            found: dict[tuple[str, str], list[_Message]] = {(c.topic, c.msgtype): [] for c in reader.connections}
            wanted = [
                c
                for c in reader.connections
                if c.msgtype in (JOINT_STATE, DYNAMIC) or (c.topic in _NUMBERS and c.msgtype == NUMBER)
            ]
            for connection, time, raw in reader.messages(wanted) if wanted else ():
                message = reader.deserialize(raw, connection.msgtype)
                found[connection.topic, connection.msgtype].append(_Message(time, message))
            return found
    except (AnyReaderError, ValueError, KeyError, OSError) as error:
        raise RecordingError(f"{path}: expected a recording of ROS 2: {str(error).splitlines()[0][:80]}") from None


def _stamps(rows: Sequence[_Message]) -> Array:
    """Stamps since the first message, s."""
    stamps = [row.message.header.stamp for row in rows]
    heads = np.array([1_000_000_000 * stamp.sec + stamp.nanosec for stamp in stamps], dtype=np.int64)
    chosen = heads if heads.any() else np.array([row.time for row in rows], dtype=np.int64)
    return 1e-9 * (chosen - chosen[0]).astype(np.float64)


def _held(times: np.ndarray, messages: Sequence[_Message]) -> list[Any]:
    """For each row the latest message that came before or with it; None where there was none yet."""
    places = np.searchsorted(np.array([m.time for m in messages], dtype=np.int64), times, side="right") - 1
    return [None if place < 0 else messages[place].message for place in places.tolist()]


def _state(message: Any, field: str) -> dict[str, float]:
    """One field of a JointState, joint by joint; empty where the message leaves it empty."""
    return {} if message is None else dict(zip(message.name, getattr(message, field), strict=False))


def _named(quantity: str, unit: str, joints: Sequence[str], values: list[dict[str, float]]) -> dict[str, Array]:
    """The columns of one quantity; none of joints that never have a number."""
    unit = "?" if quantity == "effort" else unit
    found = {}
    for joint in joints:
        column = np.array([row.get(joint, np.nan) for row in values], dtype=np.float64)
        if np.isfinite(column).any():
            found[column_name(quantity, joint, unit)] = column
    return found


def _dynamic(
    topics: dict[tuple[str, str], list[_Message]], times: np.ndarray, joints: Sequence[str], columns: dict[str, Array]
) -> dict[str, Array]:
    """Interfaces whose unit is known; an effort among the columns that one of them tells better is taken out."""
    messages = next((found for (_, kind), found in topics.items() if kind == DYNAMIC), None)
    if not messages:
        return {}
    rows = [_interfaces(message) for message in _held(times, messages)]
    known: dict[str, dict[str, Array]] = {}
    for name, unit in _SCALED.items():
        known[name] = _named(name, unit, joints, [{j: v[name] for j, v in row.items() if name in v} for row in rows])
    effort = next((name for name in KINDS if len(known.get(name, {})) == len(joints)), None)
    if effort is not None:
        for joint in joints:
            columns.pop(column_name("effort", joint, "?"), None)
    kept = [effort, "temperature", "motor"]
    return {name: column for quantity in kept if quantity for name, column in known[quantity].items()}


def _interfaces(message: Any) -> dict[str, dict[str, float]]:
    """Values of a DynamicJointState by joint and interface."""
    if message is None:
        return {}
    pairs = zip(message.joint_names, message.interface_values, strict=False)
    return {joint: dict(zip(each.interface_names, each.values, strict=False)) for joint, each in pairs}
