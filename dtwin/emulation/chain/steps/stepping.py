"""A tick of an emulated serial arm in machine code: MuJoCo's step with what the gears lose, as stepping.c has it."""

from __future__ import annotations

import ctypes
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from dtwin.emulation.stepping import STEP
from iec61499.native.build import load

Array = NDArray[np.float64]
_FOLDER: Final = Path(__file__).parent


class _Emulated(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("step", "model", "data")),
        ("joints", ctypes.c_int32),
        ("steps", ctypes.c_int32),
        *((name, ctypes.c_void_p) for name in ("applied", "loss")),
        *((name, ctypes.c_void_p) for name in ("passive", "constraint", "actuator", "acceleration", "q")),
        *((name, ctypes.c_void_p) for name in ("rotor", "coulomb", "share")),
        ("bad", ctypes.c_void_p),
    )


class Stepping:
    """An arm for machine code that moves it.

    Args:
        model: its model.
        data: its state.
        steps: integration steps in a tick.
        gears: inertia of the rotors (kg m^2), Coulomb friction (N m) and friction in parts of what the gears carry,
            (n,) each; None where no friction grows with the load.

    Attributes:
        move: address of `int32_t move(void *plant, const double *torque)`, which goes on by a tick.
        plant: address of what it moves.
        q: positions, (n,), rad or m.

    Raises:
        NativeError: there is no C compiler.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, steps: int, gears: tuple[Array, Array, Array] | None
    ) -> None:
        self.q: Array = data.qpos
        read = (data.qfrc_passive, data.qfrc_constraint, data.qfrc_actuator, data.qacc, self.q)
        given = () if gears is None else tuple(np.array(each, dtype=np.float64) for each in gears)
        bad = data.warning.number.ctypes.data + data.warning.number.strides[0] * int(mujoco.mjtWarning.mjWARN_BADQACC)
        made = _Emulated(
            STEP,
            model._address,
            data._address,
            len(self.q),
            steps,
            *(each.ctypes.data for each in (data.qfrc_applied, model.dof_frictionloss, *read)),
            *(each.ctypes.data for each in given or ()),
            *((None,) * (3 - len(given))),
            bad,
        )
        self._kept: tuple[Any, ...] = model, data, given, made, (data.qfrc_applied, model.dof_frictionloss, *read)
        self.move: int = ctypes.cast(_library().emulated_move, ctypes.c_void_p).value or 0
        self.plant = ctypes.addressof(made)


@lru_cache(maxsize=1)
def _library() -> ctypes.CDLL:
    texts = {name: (_FOLDER / name).read_text() for name in ("stepping.h", "stepping.c")}
    return load("".join(texts.values()), "stepping", lambda: texts)
