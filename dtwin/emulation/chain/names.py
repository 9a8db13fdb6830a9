"""Names of what an MJCF file has; what has none is called by its number."""

from __future__ import annotations

import mujoco


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body, such as body 3 where it has none."""
    return str(model.body(body).name) or f"body {body}"


def joint_name(model: mujoco.MjModel, number: int) -> str:
    """Name of a joint, such as joint_3 where it has none."""
    return str(model.joint(number).name) or f"joint_{number + 1}"


def actuator_name(model: mujoco.MjModel, k: int) -> str:
    """Name of an actuator, or its number from 1 on."""
    return str(model.actuator(k).name) or f"{k + 1}"
