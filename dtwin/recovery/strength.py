"""Where an arm can still hold a box: the voltages that its motors need at rest at the places of the cell."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from dtwin.parameters import VOLTAGE_LIMIT, ArmParameters, scaled
from dtwin.task import DEFAULT_TASK, Task
from dtwin.twin.dynamics import gravity

RESERVE: Final = 0.05
"""share of the voltage limit that a motor at rest has to have left, for noise and for what the model does not know"""


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


def beyond_strength(arm: ArmParameters, payload: float, usual: Mapping[str, float]) -> list[str]:
    """The names of the places at which the arm cannot be held with RESERVE, nor with what the healthy arm has left.

    Args:
        arm, payload: as for `holding`.
        usual: what the healthy arm needs with its heaviest box, see `holding`.
    """
    return [name for name, share in holding(arm, payload).items() if share > max(1.0 - RESERVE, usual[name])]
