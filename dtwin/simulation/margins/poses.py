"""The poses at which margins are measured: the places of the cell, and a sample of the whole workspace."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from dtwin.parameters import JointVector, joint_vector
from dtwin.simulation.places import angles_of
from dtwin.task import DEFAULT_TASK, Task

POSES: Final = 50
"""Number of poses."""
_SEED: Final = 13
"""Number of the random generator of the sample."""


class Pose(NamedTuple):
    """A pose of the arm: the name of a place, or the angles as text, and the angles in rad."""

    name: str
    theta: JointVector


def places(task: Task = DEFAULT_TASK) -> list[Pose]:
    """The poses of the places of a task."""
    return [Pose(name, angles_of(name, task)) for name in task.all_places]


def poses(count: int = POSES, task: Task = DEFAULT_TASK) -> list[Pose]:
    """The places, then poses with joint angles uniform over a turn, up to a number of poses in all."""
    near = places(task)
    drawn = np.random.default_rng(_SEED).uniform(-math.pi, math.pi, (max(0, count - len(near)), 3)).round(2)
    sample = [Pose("({:.2f}, {:.2f}, {:.2f}) rad".format(*row), joint_vector(row)) for row in drawn.tolist()]
    return (near + sample)[:count]
