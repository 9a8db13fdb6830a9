"""Identification of an arm while it runs: its ticks as a measurement, what was found as a model for its blocks."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from dtwin.arm.adjustment import Adjustment
from dtwin.arm.chain import Arm, Array, steiner
from dtwin.arm.effort import logged
from dtwin.arm.model import ArmModel
from dtwin.arm.modelled import problem_of
from dtwin.identification.chain.identify import Identification
from dtwin.identification.chain.overlay import overlaid
from dtwin.measurements.measurement import Measurement

LEAST_FIT: Final = 0.7
"""Fit of a joint on motion that was held out, below which a model is in doubt."""
_LEAST: Final = 0.1
"""Friction in parts of what it should be, below which nothing can be said of what it should be."""


def measurement_of(arm: Arm, adjustment: Adjustment, t: Array, q: Array, target: Array, effort: Array) -> Measurement:
    """What has passed, as the blocks count on it.

    Args:
        arm: the arm.
        adjustment: what the twin has told the blocks.
        t: times, (N,), s.
        q: what the encoders read, (N, n), rad or m.
        target: desired positions, (N, n).
        effort: what acts at the samples, (N, n), in the units of the drives; NaN where nobody knows what it carries.
    """
    laden = np.isnan(effort[:, 0])
    commanded = arm.joints[0].actuator.commanded
    return Measurement(
        source=f"motion of {arm.name}",
        joints=tuple(joint.name for joint in arm.joints),
        t=t,
        q=q - np.array(adjustment.offset),
        effort=effort * logged(arm) * np.array(adjustment.strength),
        kind=None if commanded == "position" else commanded,
        command=target,
        gripped=laden,
    )


def model_without(found: Identification, adjustment: Adjustment) -> ArmModel:
    """The model of an identified arm without what the blocks add to it anyway: more friction, and a further load."""
    arm = overlaid(found)
    model = ArmModel.of(arm)
    usual = [1.0 if share < _LEAST else share for share in adjustment.friction]
    viscous, coulomb, share = (
        tuple(value / part for value, part in zip(values, usual, strict=True))
        for values in (model.viscous, model.coulomb, model.share)
    )
    moved = adjustment.load * steiner(arm.tool)
    load = [adjustment.load, *(adjustment.load * arm.tool), *moved[np.tril_indices(3)]]
    last = tuple(float(a - b) for a, b in zip(model.bodies[-1], load, strict=True))
    bodies = (*model.bodies[:-1], last) if adjustment.load else model.bodies
    return replace(model, bodies=bodies, viscous=viscous, coulomb=coulomb, share=share)


def doubts_of(found: Identification, arm: Arm) -> str:
    """Why an identified arm should not be used, "" if nothing speaks against it.

    Args:
        found: what was found.
        arm: the arm as its data sheet says.
    """
    doubts = [
        f"only {1.0 - error:.2f} of what {joint.name} needs is explained"
        for joint, error in zip(arm.joints, found.held_out[found.groups], strict=True)
        if 1.0 - error < LEAST_FIT
    ]
    problem = problem_of(arm, ArmModel.of(overlaid(found)))
    return "; ".join([*doubts, problem] if problem else doubts)
