"""The state of an emulated cell, and what others need to move its plant."""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from dtwin.emulation.boxes import BoxesState
from dtwin.emulation.contact.boxes import BodiesState
from dtwin.emulation.encoders import EncodersState
from dtwin.emulation.plant import PlantState
from dtwin.signals import CellDrives, Sensors


class EmulationState(msgspec.Struct, frozen=True):
    """All that the further course of a cell depends on, beside the settings that it was made with.

    Attributes:
        sensors: sample that the cell gives now.
        gripped: whether the last command said that the box is held.
        faults: all faults, those that were added to the running cell too.
        plant: state of arm and gripper.
        encoders: state of the encoders.
        boxes: state of the boxes.
        bodies: state of their bodies, None without contact.
        commanded: voltages of the last command, V.
    """

    sensors: Sensors
    gripped: bool
    faults: tuple[str, ...]
    plant: PlantState
    encoders: EncodersState
    boxes: BoxesState
    bodies: BodiesState | None = None
    commanded: CellDrives = (0.0, 0.0, 0.0, 0.0)


class Free(NamedTuple):
    """What it takes to move the plant for at most N ticks.

    Attributes:
        step, model, data: addresses of `mj_step` and of its arguments.
        q, w, control: (4,), angles (rad), velocities (rad/s) and voltages (V).
        read: (8,), angles and velocities as they were read last.
        substeps: number of integration steps in a tick.
        steps: number of integration steps so far.
        due: number of steps at which something happens to the cell.
        rate: integration steps in a second.
        payload: mass at the tip, kg.
        limits: (4,), largest sum of absolute commands (V), largest sum of the state, and the angles between which the
            gripper moves (rad).
        errors: (N, 4), what the encoders add to the angles, rad.
    """

    step: int
    model: int
    data: int
    q: NDArray[np.float64]
    w: NDArray[np.float64]
    control: NDArray[np.float64]
    read: NDArray[np.float64]
    substeps: int
    steps: int
    due: int
    rate: float
    payload: float
    limits: NDArray[np.float64]
    errors: NDArray[np.float64]
