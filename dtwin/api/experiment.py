"""Identification of the arm from a simulated experiment."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, Literal

import numpy as np

from dtwin.api.arguments import AnyPath, Texts, checked, texts
from dtwin.api.identification import FrictionChoice, Identified, Measured, fitted, identification_settings
from dtwin.controller.excitation import ExcitationController
from dtwin.emulation.machine.files import machine_of
from dtwin.emulation.machine.sections import IDEAL
from dtwin.identification.data import Start
from dtwin.identification.estimation.estimate import EstimationSettings, Loss
from dtwin.identification.excitation.design import optimise as designed
from dtwin.identification.excitation.plan import HELD_OUT, PLAIN, Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import ArmParameters, assignment

_DESIGN_NOISE: Final = 0.003
"""Encoder noise for which a signal is designed, rad."""
_USUAL_LOAD: Final = 0.2
"""Mass at the tip if none is given, kg."""


@checked
def identify_experiment(
    *,
    noise: float = 0.005,
    noise_kind: Literal["uniform", "gaussian"] = "uniform",
    payload: float | tuple[float, ...] = (),
    payload_model: Literal["weight", "point"] = "weight",
    optimise: bool = False,
    start: Literal["known", "free"] = "known",
    set: Texts | Mapping[str, float] = (),
    machine: str | int | Path = IDEAL.name,
    free: str = "K,I,c,D",
    friction: FrictionChoice | None = None,
    prior: Texts = (),
    loss: Loss = "adaptive",
    known: ArmParameters | AnyPath | None = None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda stage: None,
) -> Identified:
    """Identifies the parameters of an emulated arm from a 3-2-1-1 experiment, as `dtwin identify` without a log does.

    Args:
        noise: encoder noise, rad: amplitude (uniform) or standard deviation (gaussian).
        noise_kind: uniform adds noise * u with u in [0, 1), so it is biased by half of it; gaussian is not biased.
        payload: known load at the tip, kg, or several for several runs; none for 0.2.
        payload_model: weight is a load whose inertia does not act on the arm; point is a box in the gripper.
        optimise: whether the signal is designed first.
        start: whether the initial state is known, or estimated as well (free).
        set: parameters of the emulated arm in SI units, `{"m1": 0.15}` or `"m1=0.15"`.
        machine: machine that the arm is: a name of `dtwin machine list`, a file, or a number to draw it by.
        free: what to estimate: symbols (K, m, I, l, c, D, mu) of all joints, names such as m2, or "all", without mu.
        friction: friction law to estimate, in place of D and mu of `free`; auto takes that with the least BIC.
        prior: knowledge of a free parameter from elsewhere, NAME=MEAN+-DEVIATION in SI units.
        loss: likelihood: adapted to the noise's shape, least squares (gaussian), or robust to outliers (huber).
        known: parameters that are not estimated, or their JSON file; None for the data sheet.
        seed: number of the random generators of noise, further starting points and the signal, at least 0.
        progress: is told "measuring" and "estimating" when these begin.

    Raises:
        ParameterError: an argument is unknown, of another kind or out of range.
        IdentificationError: the data are too poor.
        ModelError: the machine's file cannot be used.
    """
    settings = identification_settings(free, known, texts(prior), loss, seed)
    progress("measuring")
    pairs = dict(set) if isinstance(set, Mapping) else dict(map(assignment, texts(set)))
    rig = Rig(ArmParameters().with_values(pairs), noise, noise_kind, machine=machine_of(str(machine)))
    loads = (payload,) if isinstance(payload, float) else payload or (_USUAL_LOAD,)
    first = Plan(PLAIN, loads[0], payload_model, Start(known=start == "known"))
    return fitted(_measured(rig, first, loads, settings, seed, optimise), settings, friction, progress)


def _measured(
    rig: Rig, first: Plan, loads: tuple[float, ...], settings: EstimationSettings, seed: int, optimise: bool
) -> Measured:
    """A run with every load, and one with another signal that judges the model.

    Args:
        rig: the emulated arm.
        first: plan with the first load.
        loads: loads at the tip, kg.
        settings: what is estimated.
        seed: number of the generators.
        optimise: whether the signal is designed.
    """
    generators = [np.random.default_rng(s) for s in np.random.SeedSequence(seed).spawn(3)]
    signal = PLAIN
    if optimise:
        signal = designed(first, settings.free, settings.known, _DESIGN_NOISE, generators[2]).signal
    plans = [Plan(signal, load, first.payload_model, first.start) for load in loads]
    blocks = ExcitationController()
    training = tuple(rig.measure(plan, blocks, generators[0]) for plan in plans)
    judging = rig.measure(Plan(HELD_OUT, plans[0].payload, first.payload_model), blocks, generators[1])
    return Measured(training, (judging,), rig.made, "simulated experiment")
