"""Where an arm can still hold a box: the voltages that its motors need at rest at the places of the cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from dtwin.parameters import VOLTAGE_LIMIT, ArmParameters, scaled
from dtwin.task import DEFAULT_TASK, Task
from dtwin.twin.dynamics import gravity

RESERVE: Final = 0.05
"""share of the voltage limit that a motor at rest has to have left, for noise and for what the model does not know"""


def usual_boxes(task: Task) -> tuple[float, float]:
    """Masses of the usual box and of the heaviest one, kg."""
    return task.boxes.middle, task.boxes.heaviest


def holding(arm: ArmParameters, payload: float, task: Task = DEFAULT_TASK) -> dict[str, float]:
    """Share of the voltage limit that the motor with the least left needs to hold the arm at each place, by its name.

    Coulomb friction, which would help, does not count.

    Args:
        arm: arm as it is known.
        payload: mass of the held box, kg, 0 for none.
        task: says where the places are.
    """
    vector, strongest = np.array(scaled(arm, "mu", 0.0).vector()), VOLTAGE_LIMIT * np.array(arm.voltage_constant)
    return {
        name: float(np.abs(gravity(np.array(place.theta), vector, payload, False) / strongest).max())
        for name, place in task.all_places.items()
    }


@dataclass(frozen=True)
class Strength:
    """What the healthy arm of a cell needs to hold its heaviest box, by which a changed one is judged.

    Attributes:
        usual: share of the voltage limit at each place, by its name; see `holding`.
        task: task of the cell, which says where the places are.
    """

    usual: Mapping[str, float]
    task: Task

    @classmethod
    def of(cls, healthy: ArmParameters, heaviest: float, task: Task = DEFAULT_TASK) -> Strength:
        """That of a healthy arm with its heaviest box (kg)."""
        return cls(holding(healthy, heaviest, task), task)

    def beyond(self, arm: ArmParameters, payload: float) -> list[str]:
        """The names of the places at which an arm cannot be held with RESERVE, nor with what the healthy has left.

        Args:
            arm, payload: as for `holding`.
        """
        shares = holding(arm, payload, self.task)
        return [name for name, share in shares.items() if share > max(1.0 - RESERVE, self.usual[name])]
