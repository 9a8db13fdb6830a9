"""What several tests of the identification share."""

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from dtwin.controller.excitation import ExcitationController
from dtwin.identification.data import Experiment, Start
from dtwin.identification.excitation.plan import PLAIN, Excitation, Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, PayloadModel
from evidence.identification.standard import standard_settings
from tests.support.arms import Array

ARM = ArmParameters()
ALL = PARAMETER_NAMES[:18]
NO_MASSES = tuple(name for name in ALL if name[0] != "m")
SETTINGS = standard_settings()
FREE = SETTINGS.free


@cache
def blocks() -> ExcitationController:
    """The function blocks that excite; made once, when the first test asks."""
    return ExcitationController()


def truth(names: Sequence[str]) -> Array:
    return np.array([ARM.get(name) for name in names])


def measured(
    seed: int = 0,
    payload: float = 0.2,
    model: PayloadModel = "weight",
    signal: Excitation = PLAIN,
    known: bool = True,
    samples: int = 350,
    **rig: Any,
) -> Experiment:
    """An experiment on the emulated arm under the function blocks' signal."""
    plan = Plan(signal, payload, model, Start(known=known), samples)
    return Rig(**rig).measure(plan, blocks(), np.random.default_rng(seed))


@cache
def clean() -> Experiment:
    """An experiment without noise: tests add their own noise, which saves running the emulation."""
    return measured()


def noisy(
    seed: int | tuple[int, ...], level: float, kind: str = "uniform", given: Experiment | None = None
) -> Experiment:
    """An experiment with noise of that level (rad): the one without noise, or the given one."""
    clear = clean() if given is None else given
    generator = np.random.default_rng(seed)
    draw = generator.random if kind == "uniform" else generator.standard_normal
    angles = clear.measured + level * draw(clear.measured.shape)
    return Experiment(angles, clear.volts, clear.payload, clear.start, clear.period, clear.payload_model)
