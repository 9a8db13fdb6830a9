"""What the monitor believes of the healthy arm before it has seen a sample, and how firmly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ModelError, ParameterError
from dtwin.identification.machine.record import LEARNED, MachineRecord
from dtwin.identification.model import IdentifiedModel
from dtwin.monitoring.estimation.layout import ARM_NAMES
from dtwin.monitoring.learning.course import courses
from dtwin.parameters import ArmParameters, CellJoints, JointVector, every_joint, joint_vector, symbol_of
from dtwin.twin.effects import NO_EFFECTS, Effects

if TYPE_CHECKING:
    from dtwin.run.prediction import BelievedArm

Array = NDArray[np.float64]

NOISE_FLOOR: Final = 2e-5
"""rad: encoders are never believed to be better, so that a recording without noise can be monitored"""
UNKNOWN_OFFSET: Final = 3e-3
"""rad, standard deviation of an encoder's offset that nobody has estimated"""
TOLERANCE: Final = {"K": 0.003, "D": 0.003, "mu": 0.0, "c": 0.0, "I": 0.0}
"""relative standard deviation of parameters given without covariance: what a good identification reaches"""
WIDENED: Final = 2.0
"""factor on identified standard errors: they rest on one experiment"""
TIMING: Final = 5e-4
"""s, standard deviation that delay and lag together are taken to have where an arm has them, less than either has"""
_MINUTE: Final = 60.0
_BIAS: Final = ("offset1", "offset2", "offset3")


@dataclass(frozen=True, slots=True)
class Unmodelled:
    """Torques on the joints that the model of a healthy arm does not explain.

    Attributes:
        white: standard deviation of those that are new in every sample, N m.
        slow: standard deviation of those that last, N m.
        memory: time after which a share of 1/e of the latter is left, s.
        grip: standard deviation of those that are new in every sample while a box is gripped or let go, N m: the jaws
            push the arm, and the weight does not come and go in one sample.
        closing: the same while jaws close that hold no box yet, N m; that of `grip` where nobody has watched them.
        displacement: standard deviation of the angle by which gears that yield or have play move a link in a sample
            without any torque, rad.
        compliance: (3,), angle by which the gears swing after a torque of the motor has jumped, rad/(N m), as a
            standard deviation.
        stick: share of the dry friction that is in doubt near standstill, as a standard deviation.
        timing: standard deviation of the time at which a voltage changes, s.

    Raises:
        ParameterError: a number is out of range.
    """

    white: CellJoints = every_joint(1e-4)
    slow: CellJoints = every_joint(0.0)
    memory: float = 0.1
    grip: float = 0.0
    displacement: float = 0.0
    compliance: CellJoints = every_joint(0.0)
    stick: float = 1.0
    timing: float = 0.0
    closing: float | None = None

    def __post_init__(self) -> None:
        torques = (*self.white, *self.slow, self.grip, self.pushing)
        if not (min(torques) >= 0.0 and math.isfinite(sum(torques))):
            raise ParameterError(f"white, slow, grip, closing: expected finite torques of at least 0, got {torques}")
        if not 0.0 < self.memory < math.inf:
            raise ParameterError(f"memory: expected a time above 0 s, got {self.memory}")
        angles = (self.displacement, *self.compliance)
        if not (min(angles) >= 0.0 and math.isfinite(sum(angles))):
            raise ParameterError(f"displacement, compliance: expected finite numbers of at least 0, got {angles}")
        if not 0.0 <= self.timing < math.inf:
            raise ParameterError(f"timing: expected a time of at least 0 s, got {self.timing}")
        if not 0.0 <= self.stick <= 1.0:
            raise ParameterError(f"stick: expected 0 to 1, got {self.stick}")

    @property
    def pushing(self) -> float:
        """Standard deviation of the torques in a sample in which jaws close, N m."""
        return self.grip if self.closing is None else self.closing


@dataclass(frozen=True, slots=True)
class Tail:
    """How far one of the monitor's statistics goes while the arm is healthy.

    Attributes:
        level: a value that it passes now and then.
        rate: how often it does, 1/h; 0 if nobody has watched the arm.
        excess: by how much it passes it on average; larger excesses get rarer exponentially.
    """

    level: float = 0.0
    rate: float = 0.0
    excess: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Belief:
    """A model with its uncertainty.

    Attributes:
        arm: the healthy arm.
        covariance: (15, 15), of the parameters called ARM_NAMES, SI units.
        noise: standard deviation of the encoders' noise, rad; of white noise that tells as little over some time, if
            the noise of neighbouring samples is alike.
        clip: standard deviations beyond which the tails of the noise are exponential, infinite for a normal
            distribution; see `kernels.correct`.
        offset: mean of the encoders' noise, rad.
        offset_deviation: its standard deviation, rad.
        effects: what the arm has beside its equations of motion.
        error: what the model does not explain of the healthy arm.
        tails: how far the monitor's statistic of each fault goes while the arm is healthy, by fault.
        misfit: mean square of some innovations in standard deviations that the healthy arm does not pass.
        rates: rates at which parameters were seen to change while the arm was healthy, as shares, 1/s, by name;
            earlier and later ones.
        courses: changes between which parameters lie while the healthy arm warms, as shares, by name.
        load: mass with which a box moves on an arm of these numbers, as a share of the mass that it has.
        sheet: whether these are the numbers of a data sheet, which nobody has held against this arm.

    Raises:
        ParameterError: a shape or a number is wrong.
    """

    arm: ArmParameters
    covariance: Array
    noise: CellJoints
    clip: CellJoints = every_joint(math.inf)
    offset: CellJoints = every_joint(0.0)
    offset_deviation: CellJoints = every_joint(UNKNOWN_OFFSET)
    effects: Effects = NO_EFFECTS
    error: Unmodelled = Unmodelled()
    tails: Mapping[str, Tail] = field(default_factory=dict)
    misfit: float = 2.0
    rates: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    courses: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    load: float = 1.0
    sheet: bool = False

    def __post_init__(self) -> None:
        count = len(ARM_NAMES)
        if self.covariance.shape != (count, count) or not np.isfinite(self.covariance).all():
            raise ParameterError(f"covariance: expected a finite {count} x {count} matrix")
        for name in ("noise", "offset", "offset_deviation"):
            values = np.array(getattr(self, name))
            if values.shape != (3,) or not np.isfinite(values).all():
                raise ParameterError(f"{name}: expected 3 finite numbers, got {getattr(self, name)}")
        if min(self.noise) < 0:
            raise ParameterError(f"noise: expected at least 0 rad, got {self.noise}")
        if not min(self.clip) > 0:
            raise ParameterError(f"clip: expected numbers above 0, got {self.clip}")
        if not 0.0 < self.load < math.inf:
            raise ParameterError(f"load: expected a share above 0, got {self.load}")

    def walk(self, name: str) -> float:
        """Standard deviation, as a share, that a parameter gains in one second by such change: that of a random walk
        which comes as far in a minute, 0 of what does not change."""
        return max(map(abs, self.rates.get(name, (0.0,)))) * math.sqrt(_MINUTE)

    @property
    def dry_friction(self) -> Array:
        """Dry friction in doubt near standstill, (3,), N m; 0 of an arm that is not known with its effects."""
        if self.effects == NO_EFFECTS:
            return np.zeros(3)
        return self.error.stick * (np.array(self.arm.coulomb) + np.array(self.effects.stiction))


def assumed(arm: ArmParameters, noise: JointVector) -> Belief:
    """A belief in parameters whose covariance is not known."""
    deviations = [TOLERANCE[symbol_of(name)] * arm.get(name) for name in ARM_NAMES]
    return Belief(arm, np.diag(np.square(deviations)), noise)


def data_sheet(noise: JointVector) -> Belief:
    """A belief in the arm of the data sheet, which nobody has held against the arm that is watched."""
    return replace(assumed(ArmParameters(), noise), sheet=True)


def identified(model: IdentifiedModel) -> Belief:
    """The belief that an identification leads to; what it could not tell apart counts as known.

    Raises:
        ModelError: the model has free parameters that the data did not determine.
    """
    if model.unidentifiable:
        raise ModelError(
            f"the model leaves {', '.join(model.unidentifiable)} open: expected one whose free parameters are all"
            " determined, identify with masses and lengths known"
        )
    matrix = WIDENED**2 * np.array(model.covariance.matrix).reshape(len(model.covariance.names), -1)
    place = {name: index for index, name in enumerate(model.covariance.names)}
    covariance = np.zeros((len(ARM_NAMES), len(ARM_NAMES)))
    for i, row in enumerate(ARM_NAMES):
        for j, column in enumerate(ARM_NAMES):
            if row in place and column in place:
                covariance[i, j] = matrix[place[row], place[column]]
    spread = [
        max(1e-3, matrix[place[name], place[name]] ** 0.5) if name in place else UNKNOWN_OFFSET for name in _BIAS
    ]
    return Belief(
        model.arm,
        covariance,
        joint_vector(model.validity.noise),
        offset=joint_vector(model.offsets),
        offset_deviation=tuple(spread),
    )


def believed_arm(belief: Belief) -> BelievedArm:
    """The healthy arm of a belief as a prediction takes it; a box counts with the usual mass."""
    from dtwin.run.prediction import BelievedArm  # loads what a monitor does without

    return BelievedArm(belief.arm, offset=belief.offset, effects=belief.effects)


def commissioned(record: MachineRecord) -> Belief:
    """The belief that a commissioning leads to.

    Centres of mass and inertias count as known: what they leave unexplained is a torque that lasts. The rest is what
    the monitor has learned, if the arm was watched at work.
    """
    names = [name for name in LEARNED if name in ARM_NAMES]
    known, effects = record.healthy, record.effects
    timing, load = TIMING if max(effects.delay, *effects.lag) > 0.0 else 0.0, record.load or 1.0
    if known is None:
        deviations = {name: record.numbers[name].deviation for name in names}
        error = Unmodelled(timing=timing)
        return Belief(record.arm, _uncertain(deviations), record.encoders, effects=effects, error=error, load=load)
    bias1, bias2, bias3 = (known.learned[f"bias{joint}"] for joint in (1, 2, 3))
    return Belief(
        record.arm.with_values({name: known.learned[name].value for name in names}),
        _uncertain({name: known.learned[name].deviation for name in names}),
        record.encoders,
        offset=(bias1.value, bias2.value, bias3.value),
        offset_deviation=(bias1.deviation, bias2.deviation, bias3.deviation),
        effects=effects,
        error=Unmodelled(
            slow=known.slow,
            memory=known.memory,
            grip=known.grip,
            displacement=known.displacement,
            compliance=known.compliance,
            stick=known.stick,
            timing=timing,
            closing=known.closing,
        ),
        tails={fault: Tail(tail.level, tail.rate, tail.excess) for fault, tail in known.tails.items()},
        misfit=known.misfit,
        rates=known.rates,
        courses=courses(known.rates, known.duration),
        load=load,
    )


def _uncertain(deviations: Mapping[str, float]) -> Array:
    """The covariance of the parameters called ARM_NAMES, (15, 15), of which those without a deviation are certain."""
    return np.diag([deviations.get(name, 0.0) ** 2 for name in ARM_NAMES])
