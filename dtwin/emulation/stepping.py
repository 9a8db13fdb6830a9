"""MuJoCo's step as machine code may call it, without Python in between."""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Final, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray


class Stepping(NamedTuple):
    """Addresses of `mj_step`, of its model and of its data, and what of these a step reads and writes.

    q, w and control: (4,), angles (rad), velocities (rad/s) and voltages (V); read: (8,), angles and velocities as
    they were read after the last step, which a lock has changed since.
    """

    step: int
    model: int
    data: int
    q: NDArray[np.float64]
    w: NDArray[np.float64]
    control: NDArray[np.float64]
    read: NDArray[np.float64]


def _step_function() -> int | None:
    """The address of `mj_step` in the library that is loaded; None where it is not found."""
    files = sorted(Path(mujoco.__file__).parent.glob("libmujoco*.so*"))
    if len(files) != 1:
        return None
    return ctypes.cast(ctypes.CDLL(str(files[0])).mj_step, ctypes.c_void_p).value


STEP: Final = _step_function()
"""Address of `mj_step`."""
