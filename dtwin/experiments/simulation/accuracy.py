"""How well the twin predicts the arm: the motion from pickup to red, at several target times.

The model is identified first, under the given encoder noise. Arm and twin then make the same motion under the same
blocks, whose controller has the identified model; they are compared until both have settled.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from dtwin.controller.excitation import ExcitationController
from dtwin.controller.settings import ControlSettings
from dtwin.errors import IdentificationError
from dtwin.experiments.identification.experiments import standard_settings
from dtwin.experiments.simulation.emulated_arm import EmulatedArm
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.excitation.design import optimise
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PERIOD, PICKUP, ArmParameters, Triple
from dtwin.simulation.figures import fit
from dtwin.simulation.whatif import MotionCase, Outcome, Simulator

TARGET_TIMES: Final = (1.0, 2.0, 4.0, 6.0, 8.0)
"""s"""
NOISE: Final = 0.010
"""rad, of the encoders while the model is identified"""
BOX: Final = 0.2
"""kg"""
TRIALS: Final = 300
"""signals that are looked at"""
_LOOK: Final = 4.0
"""s after the path's end in which a motion should have settled"""


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One motion twice.

    Attributes:
        target_time: s.
        payload: kg.
        arm: of the emulation.
        twin: predicted.
        samples: of both, until the later of them had settled.
        fit: of each joint over these samples, 1 is perfect.
        difference: largest, of each joint, rad.
    """

    target_time: float
    payload: float
    arm: Outcome
    twin: Outcome
    samples: int
    fit: Triple
    difference: Triple


def designed() -> Plan:
    """The standard experiment with the signal that tells most, as `dtwin identify --optimise` finds it.

    It is found around the start values of the estimation: nothing of the true arm is known.
    """
    settings = standard_settings()
    return optimise(Plan(), settings.free, settings.known, NOISE, np.random.default_rng(0), trials=TRIALS)


def identified(noise: float, seed: int, true: ArmParameters | None = None, plan: Plan | None = None) -> ArmParameters:
    """A model of the emulated arm, from one experiment at that noise.

    Args:
        noise: rad, uniform, of mean noise / 2.
        seed: of the noise.
        true: the emulated arm; the data sheet's when None.
        plan: of the experiment; the standard one when None.

    Raises:
        IdentificationError: the estimation did not converge.
    """
    rig = Rig(true or ArmParameters(), noise)
    experiment = rig.measure(plan or Plan(), ExcitationController(), np.random.default_rng(seed))
    estimate = identify([experiment], standard_settings())
    if not estimate.converged:
        raise IdentificationError(f"the model for seed {seed} did not converge: expected a minimum")
    return estimate.parameters


def accuracy(
    model: ArmParameters,
    target_times: Sequence[float] = TARGET_TIMES,
    payloads: Sequence[float] = (0.0, BOX),
    true: ArmParameters | None = None,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Pair]:
    """Makes the motions.

    Args:
        model: of twin and controller.
        target_times: s.
        payloads: kg; the controller counts on as much.
        true: the emulated arm; the data sheet's when None.
        progress: told the motions made and their number.
    """
    simulator, pairs = Simulator(), []
    number = len(target_times) * len(payloads)
    for payload in payloads:
        for target_time in target_times:
            settings = ControlSettings(target_time, model=model, payload=payload)
            case = MotionCase("red", settings, PICKUP.theta, arm=model, payload=payload, duration=target_time + _LOOK)
            pairs.append(_pair(case, true or ArmParameters(), simulator))
            progress(len(pairs), number)
    return pairs


def _pair(case: MotionCase, true: ArmParameters, simulator: Simulator) -> Pair:
    arm = simulator.run(case, partial(EmulatedArm, true))
    twin = simulator.run(case)
    times = (arm.figures.settling_time, twin.figures.settling_time)
    latest = max(case.seconds if time is None else time for time in times)
    samples = round(latest / PERIOD)
    one, other = arm.theta[:samples], twin.theta[:samples]
    first, second, third = np.abs(one - other).max(axis=0).tolist()
    return Pair(case.settings.target_time, case.payload, arm, twin, samples, fit(one, other), (first, second, third))
