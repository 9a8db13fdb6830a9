"""Places at which an arm does no work, because its links are not as long as those of the arm that was taught them."""

from __future__ import annotations

import math

from dtwin.emulation.boxes import REACH
from dtwin.parameters import ArmParameters
from dtwin.task import Task
from dtwin.twin.kinematics import forward


def out_of_place(task: Task, arm: ArmParameters) -> list[str]:
    """The places that the tip misses by more than boxes allow, one sentence each.

    The sequence leads the joints to the angles of each place; where the tip comes to then is for the links to say.

    Args:
        task: places with their angles.
        arm: arm that is led there.
    """
    missed = []
    for name, place in task.all_places.items():
        x, y, _ = forward(place.theta, arm)
        distance = math.hypot(x - place.x, y - place.y)
        if distance > REACH:
            missed.append(
                f"{name}: the tip of this arm misses the place by {1000 * distance:.0f} mm, expected at most"
                f" {1000 * REACH:.0f} mm: its angles belong to links of other lengths"
            )
    return missed
