"""MuJoCo alone: the yardstick that the closed loop is measured by."""

from __future__ import annotations

from pathlib import Path

import mujoco

from dtwin.emulation.plant import MODEL_FILE
from dtwin.parameters import PERIOD


def raw_ticks(ticks: int, model_file: Path = MODEL_FILE) -> None:
    """Steps the MJCF file as it stands for a number of 10 ms ticks, with nothing around it."""
    model = mujoco.MjModel.from_xml_path(str(model_file))
    data = mujoco.MjData(model)
    steps = round(PERIOD / model.opt.timestep)
    for _ in range(ticks):
        mujoco.mj_step(model, data, steps)
