"""The poses at which margins are measured: the places of the cell, and a sample of the whole workspace."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from dtwin.controller.motion import NAMES
from dtwin.parameters import Triple
from dtwin.simulation.figures import triple
from dtwin.simulation.places import angles_of

POSES: Final = 50
"""Number of poses."""
_SEED: Final = 13
"""Number of the random generator of the sample."""


class Pose(NamedTuple):
    """A pose of the arm: the name of a place, or the angles as text, and the angles in rad."""

    name: str
    theta: Triple


def places() -> list[Pose]:
    """The poses of the places of the cell."""
    return [Pose(name, angles_of(name)) for name in NAMES]


def poses(count: int = POSES) -> list[Pose]:
    """The places, then poses with joint angles uniform over a turn, up to a number of poses in all."""
    drawn = np.random.default_rng(_SEED).uniform(-math.pi, math.pi, (max(0, count - len(NAMES)), 3)).round(2)
    sample = [Pose("({:.2f}, {:.2f}, {:.2f}) rad".format(*row), triple(row)) for row in drawn.tolist()]
    return (places() + sample)[:count]
