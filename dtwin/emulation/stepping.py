"""MuJoCo's step as machine code may call it, without Python in between."""

from __future__ import annotations

import contextlib
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


def _prepared_step() -> int | None:
    """The address of `mj_step` in the library that is loaded; None where it is not found.

    MuJoCo's package for Python lets every part of a step read the clock, which costs a good part of the step. Nobody
    here reads those times, so the clock is taken away (`mjcb_time` of MuJoCo's interface), for the whole process.
    """
    files = sorted(Path(mujoco.__file__).parent.glob("libmujoco*.so*"))
    if len(files) != 1:
        return None
    library = ctypes.CDLL(str(files[0]))
    with contextlib.suppress(ValueError):  # a library that does not show it
        ctypes.c_void_p.in_dll(library, "mjcb_time").value = None
    return ctypes.cast(library.mj_step, ctypes.c_void_p).value


STEP: Final = _prepared_step()
"""Address of `mj_step`."""
