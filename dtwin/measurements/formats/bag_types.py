"""The messages of ROS 2 that a recording of joints is made of."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

from dtwin.errors import RecordingError

JOINT_STATE: Final = "sensor_msgs/msg/JointState"
DYNAMIC: Final = "control_msgs/msg/DynamicJointState"
NUMBER: Final = "std_msgs/msg/Int64"
STATES: Final = "/joint_states"
COMMANDS: Final = "/joint_commands"
INTERFACES: Final = "/dynamic_joint_states"
EPISODES: Final = "/episode"
GRIPS: Final = "/gripped"
_VALUES: Final = "control_msgs/msg/InterfaceValue"
_DEFINITIONS: Final = {
    _VALUES: "string[] interface_names\nfloat64[] values\n",
    DYNAMIC: ("std_msgs/Header header\nstring[] joint_names\ncontrol_msgs/InterfaceValue[] interface_values\n"),
}
"""What ros2_control publishes beside JointState, whose effort has no unit and no company."""


def typestore(path: Path) -> Any:
    """The types, for reading and writing.

    Raises:
        RecordingError: rosbags is not installed.
    """
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise RecordingError(f"{path}: expected rosbags to be installed: pip install 'dtwin[rosbag]'") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in _DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store
