"""The standard identification: twelve parameters of the arm from one 3-2-1-1 signal under a known load."""

from __future__ import annotations

from typing import Final

import numpy as np

from dtwin.controller.excitation import ExcitationController
from dtwin.identification.estimation.estimate import Estimate, EstimationSettings, Loss, identify
from dtwin.identification.estimation.problem import START
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PARAMETER_NAMES, ArmParameters, symbol_of

FREE: Final = tuple(name for name in PARAMETER_NAMES if symbol_of(name) in ("K", "I", "c", "D"))
"""the twelve parameters that one run under a known load determines once masses and lengths are known"""


def standard_settings(loss: Loss = "adaptive") -> EstimationSettings:
    """Twelve free parameters from the thesis's start values; masses and lengths known."""
    known = ArmParameters().with_values({name: START.get(name) for name in FREE})
    return EstimationSettings(FREE, known, loss=loss)


def standard_estimate(rig: Rig, generator: np.random.Generator, plan: Plan | None = None) -> Estimate:
    """What one experiment tells of the arm of a rig.

    Args:
        rig: the arm and its encoders.
        generator: the random generator of the encoder noise.
        plan: signal and load of the experiment; the standard ones if None.

    Raises:
        IdentificationError: the data are too poor.
    """
    return identify([rig.measure(plan or Plan(), ExcitationController(), generator)], standard_settings())
