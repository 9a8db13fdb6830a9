"""Places at which an arm does no work: its links do not lead there, or its drives do not hold a box there."""

from __future__ import annotations

import math

from dtwin.parameters import VOLTAGE_LIMIT, ArmParameters
from dtwin.run.cell_file import holding
from dtwin.task import REACH, Task
from dtwin.twin.kinematics import forward


def out_of_place(task: Task, arm: ArmParameters) -> list[str]:
    """The places that the arm cannot reach, or not with the heaviest box, one sentence each.

    The sequence leads the joints to the angles of each place. Where the tip comes to then is for the links to say,
    and whether the joints stay there for the drives.

    Args:
        task: places with their angles, and boxes.
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
            continue
        load = task.boxes.heaviest
        volts, joint = max((abs(needed), j) for j, needed in enumerate(holding(place.theta, arm, load), 1))
        if volts > VOLTAGE_LIMIT:
            missed.append(
                f"{name}: joint {joint} of this arm would need {volts:.1f} V to hold {load:g} kg there, expected at"
                f" most {VOLTAGE_LIMIT:g} V"
            )
    return missed
