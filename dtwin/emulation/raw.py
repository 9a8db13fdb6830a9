"""MuJoCo alone, without the closed loop around it: the reference speeds of the benchmark."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mujoco

from dtwin.emulation import MODEL_FILE
from dtwin.emulation.plant import Plant
from dtwin.parameters import PERIOD


def raw_file_ticks(model_file: Path = MODEL_FILE) -> Callable[[int], None]:
    """A function that steps the unchanged model of an MJCF file for a number of 10 ms ticks."""
    return _stepping(mujoco.MjModel.from_xml_path(str(model_file)))


def raw_plant_ticks() -> Callable[[int], None]:
    """A function that steps the plant's model, without the parts that do not move, for a number of 10 ms ticks."""
    return _stepping(Plant().model)


def _stepping(model: mujoco.MjModel) -> Callable[[int], None]:
    data = mujoco.MjData(model)
    steps = round(PERIOD / model.opt.timestep)

    def step(ticks: int) -> None:
        for _ in range(ticks):
            mujoco.mj_step(model, data, steps)

    return step
