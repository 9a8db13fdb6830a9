"""Optimal experiment design: the precision that an experiment can give, and the signal that gives the best one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.errors import DivergenceError, IdentificationError
from dtwin.identification.estimation.estimate import covariance
from dtwin.identification.estimation.identifiability import Identifiability, analyse
from dtwin.identification.estimation.problem import Problem
from dtwin.identification.excitation.plan import Excitation, Plan
from dtwin.parameters import JOINTS, ArmParameters, CellJoints, joint_vector, scaled

UNITS: Final = (2, 45)
"""Least and largest length of a unit that the search tries, ticks."""
LATEST: Final = 60
"""Largest delay that the search tries, ticks."""
_DAMPINGS: Final = (1.0, 0.6, 0.8, 1.4)
"""Factors of the damping for which the reach must be kept: before an identification it is the least known."""
_SHARES: Final = (0.6, 0.8, 1.0, 1.0)
"""Shares of the planned amplitude from which a random signal takes its own."""
_EXPLORED: Final = 0.4
"""Share of the trials spent on random signals; the other trials vary the best signal so far."""


@dataclass(frozen=True, slots=True)
class CramerRaoBounds:
    """Cramer-Rao bounds of planned experiments under Gaussian noise and with unknown encoder offsets.

    Attributes:
        bounds: least standard errors of an unbiased estimate by name, SI units; NaN where not identifiable.
        relative: the bounds divided by the values of the parameters, without those of the encoder offsets.
        identifiability: which parameters the experiments determine.
        reach: (3,), largest distance of each joint from its start, rad.
    """

    bounds: dict[str, float]
    relative: dict[str, float]
    identifiability: Identifiability
    reach: CellJoints

    @property
    def worst(self) -> float:
        """The largest relative bound; infinite when a parameter is not identifiable."""
        values = list(self.relative.values())
        return math.inf if any(map(math.isnan, values)) else max(values, default=0.0)


def predict(plans: Sequence[Plan], free: tuple[str, ...], arm: ArmParameters, deviation: float) -> CramerRaoBounds:
    """The Cramer-Rao bounds on the free parameters from all planned experiments together.

    Args:
        plans: plans of the experiments.
        free: names of the parameters to estimate.
        arm: parameters at which the bounds are computed.
        deviation: standard deviation of the noise, rad.

    Raises:
        DivergenceError: the arm diverges under the plan.
    """
    problem = Problem(tuple(plan.experiment() for plan in plans), free, arm)
    x = problem.start()
    motions = [np.abs(angles - angles[0]).max(axis=0) for angles in problem.simulate(x)]
    identifiability = analyse(problem, x)
    errors = np.sqrt(np.diag(covariance(problem, x, np.full(3, deviation), identifiability)))
    bounds = dict(zip(problem.shared, errors.tolist(), strict=True))
    first, second, third = np.max(motions, axis=0).tolist()
    relative = {name: bounds[name] / arm.get(name) if arm.get(name) else bounds[name] for name in free}
    return CramerRaoBounds(bounds, relative, identifiability, (first, second, third))


def optimise(
    plan: Plan,
    free: tuple[str, ...],
    arm: ArmParameters,
    deviation: float,
    generator: np.random.Generator,
    *,
    reach: float = math.pi,
    trials: int = 1000,
    progress: Callable[[int], None] = lambda done: None,
) -> Plan:
    """Searches unit, delays and amplitudes of the 3-2-1-1 signals that minimise the largest relative bound.

    Duration and load stay as planned; no amplitude exceeds the planned one.

    Args:
        plan: plan of the experiment to improve.
        free: names of the parameters to estimate.
        arm: assumed parameters of the arm, such as those of the last model.
        deviation: standard deviation of the noise, rad; it scales all bounds alike.
        generator: random generator of the signals that are tried.
        reach: largest distance of a joint from its start, rad, which is also kept if the damping is 40 % off.
        trials: number of signals to try, a few ms each.
        progress: called with the number of trials done.

    Raises:
        IdentificationError: no signal keeps within the reach and determines all parameters.
    """
    best, least = plan, _worst(plan, free, arm, deviation, reach)
    for done in range(1, trials + 1):
        anywhere = done <= _EXPLORED * trials or math.isinf(least)
        signal = _anywhere(plan.signal, generator) if anywhere else _near(best.signal, plan.signal, generator)
        candidate = replace(plan, signal=signal)
        worst = _worst(candidate, free, arm, deviation, reach)
        if worst < least:
            best, least = candidate, worst
        progress(done)
    if math.isinf(least):
        raise IdentificationError(
            f"no signal of {trials} tried keeps every joint within {reach:g} rad of its start and determines "
            f"{', '.join(free)}: allow more reach, lower the amplitudes or free fewer parameters"
        )
    return best


def _worst(plan: Plan, free: tuple[str, ...], arm: ArmParameters, deviation: float, reach: float) -> float:
    try:
        problem = Problem((plan.experiment(),), free, arm)
        x = problem.start()
        for factor in _DAMPINGS:
            arm_then = scaled(arm, "D", factor)
            motion = replace(problem, free=(), fixed=arm_then, offsets=False).simulate(np.empty(0))[0]
            if np.abs(motion - motion[0]).max() > reach:
                return math.inf
        matrix = problem.sensitivity(x, [np.full(3, 1.0 / deviation)])
    except DivergenceError:
        return math.inf
    norms = np.linalg.norm(matrix, axis=0)
    _, singular, right = np.linalg.svd(matrix / norms, full_matrices=False)
    if singular[-1] < 1e-9 * singular[0]:
        return math.inf
    errors = np.linalg.norm(right.T / singular, axis=1) / norms * problem.scale[: len(problem.shared)]
    values = np.array([arm.get(name) or 1.0 for name in free])
    return float((errors[: len(free)] / values).max())


def _anywhere(limit: Excitation, generator: np.random.Generator) -> Excitation:
    share = generator.choice((-1.0, 1.0), 3) * generator.choice(_SHARES, 3)
    unit = int(generator.integers(UNITS[0], UNITS[1] + 1))
    return Excitation(
        joint_vector(share * limit.amplitude), unit, tuple(generator.integers(0, LATEST + 1, JOINTS).tolist())
    )


def _near(signal: Excitation, limit: Excitation, generator: np.random.Generator) -> Excitation:
    """A signal of which one or two properties are changed a little."""
    amplitude, delay, unit = np.array(signal.amplitude), np.array(signal.delay), signal.unit
    for kind in generator.integers(0, 7, generator.integers(1, 3)).tolist():
        if kind < 3:
            delay[kind] += generator.integers(-6, 7)
        elif kind < 6:
            change = generator.choice((-0.15, -0.05, 0.05, 0.15)) * limit.amplitude[kind - 3]
            amplitude[kind - 3] += change
        else:
            unit += int(generator.choice((-2, -1, 1, 2)))
    bound = np.abs(limit.amplitude)
    clipped = joint_vector(np.clip(amplitude, -bound, bound))
    return Excitation(clipped, min(max(unit, UNITS[0]), UNITS[1]), tuple(np.clip(delay, 0, LATEST).tolist()))
