"""What if a running arm were controlled otherwise, carried more or went faster: its work on the chain twin.

The twin is the chain of dtwin/equations with the friction of the model and the steps of the encoders, and the real
function blocks lead it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from dtwin.arm.chain import Arm, Array, holding, without_servos
from dtwin.arm.model import ArmModel
from dtwin.arm.modelled import with_model
from dtwin.controller.chain.application import Control, inputs
from dtwin.controller.chain.embedded import ChainController
from dtwin.equations.native import DryFriction, NativeChain, width_of
from dtwin.equations.rigid import usual_inertia
from dtwin.errors import DivergenceError, ParameterError
from dtwin.run.chain import ChainSettings
from dtwin.simulation.chain.checks import OBSERVERS, POLES, SLOWEST, check_model
from dtwin.simulation.margins.chain import JointMargins, margins

STEPS: Final = 4
"""Least number of integration steps in a tick."""
_SHARP: Final = 0.002
"""Velocity over which dry friction changes its sign, in parts of the least speed of a joint: sharp."""
_RATE: Final = 2.0
"""Largest rate that it makes in a step; Runge-Kutta's method of fourth order is stable up to 2.78."""
SPEEDS: Final = (SLOWEST, 2.0)
"""Speeds of paths that are tried, in parts of the data sheet's."""
_POSES: Final = 4
"""Poses at which the loops are looked at."""
_FULL: Final = 1.0 - 1e-12


@dataclass(frozen=True, slots=True)
class ArmChange:
    """What is otherwise.

    Attributes:
        pole: triple pole of the errors of every joint, rad/s; as it is if None.
        observer: double pole of the observers, rad/s; as it is if None.
        speed: speeds of the paths in parts of the data sheet's; accelerations follow with its square; None as it is.
        payload: mass that hangs on the tool without the blocks knowing, kg.

    Raises:
        ParameterError: a value is out of its range.
    """

    pole: float | None = None
    observer: float | None = None
    speed: float | None = None
    payload: float = 0.0

    def __post_init__(self) -> None:
        for name, value, (low, high), unit in (
            ("pole", self.pole, POLES, "rad/s"),
            ("observer", self.observer, OBSERVERS, "rad/s"),
            ("speed", self.speed, SPEEDS, "of the data sheet's"),
        ):
            if value is not None and not low <= value <= high:
                raise ParameterError(f"{name}: expected {low:g} to {high:g} {unit}, got {value:g}")


@dataclass(frozen=True, slots=True, eq=False)
class ArmOutcome:
    """How the twin did its work.

    Attributes:
        t: times of the samples, (N,), s.
        q: positions, (N, n), rad or m.
        target: desired positions, (N, n).
        command: commands in parts of what the drives take, (N, n).
        stop: safe stop in force at the end, 0 if none.
        reached: number of poses that were reached.
    """

    t: Array
    q: Array
    target: Array
    command: Array
    stop: int
    reached: int

    @property
    def error(self) -> Array:
        """Distance from the path, (N, n), rad or m."""
        return self.target - self.q

    @property
    def saturated(self) -> Array:
        """Time at the limit of each drive, (n,), s."""
        period = self.t[1] - self.t[0] if len(self.t) > 1 else 0.0
        found: Array = period * np.sum(np.abs(self.command) >= _FULL, axis=0)
        return found


def work_on_twin(
    settings: ChainSettings,
    model: ArmModel,
    start: Array,
    change: ArmChange,
    duration: float,
    *,
    real: Arm | None = None,
    after: float = np.inf,
) -> ArmOutcome:
    """Lets the twin do what an arm has to do, from where it rests.

    Args:
        settings: the run of the cell.
        model: what the arm is as the twin knows it, and by which its blocks reckon.
        start: positions at the beginning, (n,), rad or m.
        change: what is otherwise.
        duration: plant time, s.
        real: what the twin is, if it is something else than the model by which its blocks reckon.
        after: the work ends so long after the last pose was reached, s.

    Raises:
        ParameterError: the model is out of bounds, or the load is more than the arm can hold.
        ModelError: a drive has a loop of its own.
        DivergenceError: the motion is not finite.
    """
    known = check_model(without_servos(settings.arm, "what-if"), model)
    if not 0.0 <= change.payload <= settings.arm.most_load:
        raise ParameterError(f"payload: expected 0 to {settings.arm.most_load:g} kg, got {change.payload:g}")
    control = _control(settings.control, change)
    blocks = ChainController(len(known), inputs(known, usual_inertia(known), control, settings.poses))
    twin = holding(with_model(settings.arm, model) if real is None else real, change.payload)
    dry = _friction(twin)
    steps = max(STEPS, int(np.ceil(width_of(twin, known.period) / (_RATE * dry.width))))
    plant = NativeChain(twin).moving(start, np.zeros(len(known)), dry)
    constant = np.array([joint.actuator.constant or 1.0 for joint in twin.joints])
    limit = np.array([joint.largest / abs(joint.actuator.constant or 1.0) for joint in known.joints])
    grid = np.array([joint.step for joint in known.joints])
    marks = np.where(grid > 0.0, grid, 1.0)
    ticks = max(1, round(duration / known.period))
    rows = np.zeros((3, ticks, len(known)))
    waiting = [np.zeros(len(known))] * settings.late
    reached, rest = set(), 0.0
    for k in range(ticks):
        read = np.where(grid > 0.0, marks * np.floor(plant.q / marks + 0.5), plant.q)
        command: Array = np.array(blocks.step(read.tolist()))
        rows[0, k], rows[1, k], rows[2, k] = plant.q, blocks.desired()[0], command / limit
        reached.add(blocks.pose)
        waiting.append(np.minimum(np.maximum(command, -limit), limit))
        plant.advance(constant * waiting.pop(0), known.period / steps, steps)
        if not np.isfinite(plant.q).all():
            raise DivergenceError(f"the twin of {known.name}", (k + 1) * known.period, plant.q)
        rest = rest + known.period if blocks.done else 0.0
        if rest > after:
            ticks = k + 1
            break
    t: Array = np.arange(ticks, dtype=np.float64) * known.period
    q, target, commands = rows[:, :ticks]
    return ArmOutcome(t, q, target, commands, blocks.stop, len(reached) - 1 + blocks.done)


def loops_of(
    settings: ChainSettings, model: ArmModel, change: ArmChange, real: Arm | None = None
) -> tuple[JointMargins, ...]:
    """The margins of the loop of each joint with what is otherwise, at a few drawn poses.

    Args:
        settings: the run of the cell.
        model: what the arm is as the twin knows it.
        change: what is otherwise.
        real: what the arm is, if it is something else than the model.

    Raises:
        ParameterError: the model is out of bounds.
    """
    arm = holding(check_model(settings.arm, model) if real is None else real, change.payload)
    return margins(arm, _control(settings.control, change), _POSES, late=settings.late)


def _control(control: Control, change: ArmChange) -> Control:
    given = {"pole": change.pole, "observer": change.observer, "speed": change.speed}
    return replace(control, **{name: value for name, value in given.items() if value is not None})


def _friction(arm: Arm) -> DryFriction:
    coulomb = np.array([joint.friction.coulomb for joint in arm.joints])
    share = np.array([joint.friction.load for joint in arm.joints])
    return DryFriction(coulomb, share, _SHARP * min(joint.speed for joint in arm.joints))
