"""Settings of the controller and the block inputs that hold them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, Final, get_args

from dtwin.controller.ports import CONFIRM, LOAD, MODEL, OFFSETS, PAYLOAD, PULL, REPEATS, TUNING, WIDENED
from dtwin.errors import ParameterError, choices
from dtwin.parameters import (
    JOINTS,
    ONE_A_JOINT,
    ArmParameters,
    CellJoints,
    Gains,
    JointVector,
    Law,
    PayloadModel,
    every_joint,
)

DIGITS: Final = 1e-14
"""Relative difference between a number and the 15 digits of it that a FORTE writes."""
LAWS: Final[tuple[Law, ...]] = get_args(Law)
"""Names of the control laws; the index is the value of the input LAW of the controller block."""
_OF_JOINTS: Final = tuple(
    f"CONTROLLER.{name}{joint}" for name in ("KP", "KI", "KD", *"KMILCD", "MU") for joint in (1, 2, 3)
)
_NEEDED: Final[dict[Law, PayloadModel]] = {"computed_torque": "point", "row_sum": "weight", "cascade": "point"}
_NO_GAIN: Final[JointVector] = every_joint(0.0)
_THESIS: Final = Gains((200.0, 500.0, 300.0), (75.0, 200.0, 150.0), (2.0, 2.0, 2.0))
USUAL_GAINS: Final[dict[Law, Gains]] = {
    "computed_torque": _THESIS,
    "row_sum": _THESIS,
    "cascade": Gains((559.0,) * 3, (2535.0,) * 3, (41.0,) * 3),
}
"""The gains of each control law unless others are given; `dtwin experiment margins` finds those of the cascade."""
_OF_THE_LAW: Final = Gains(_NO_GAIN, _NO_GAIN, _NO_GAIN)
"""Stands for the usual gains of a law that is known only when settings are made."""
COMPENSATION_RANGES: Final = {
    "delay": (0.0, 0.01, "s"),
    "dead_zone": (0.0, 1.0, "V"),
    "bandwidth": (10.0, 300.0, "rad/s"),
}
"""Least and greatest value, and unit, of what the cascade takes into account; the Nyquist frequency is 314 rad/s."""
MOST_REPEATS: Final = 300
"""Most repetitions of a reading that the observer waits for; by then, 3 s, an arm has toppled."""
BELIEVED: Final = 0.08
"""Largest distance of a reading that the cascade believes from where its voltages can have brought the joint, rad: in
a tick, 8 rad/s of a joint that nothing expected to move."""
CONFIRMED: Final = 2
"""Samples by which the cascade knows another arm from a burst of wild readings, after the first one of it."""
RESTLESS: Final = 5.0
"""Factor on the tolerance with which the cascade takes an arm for settled that does not come to rest."""
NO_OFFSET: Final[JointVector] = every_joint(0.0)
"""Offsets of encoders that read what the angles are, rad."""
APPLICATION_LAW: Final[Law] = "cascade"
"""The law of a cell for which no other is asked; settings without a law have the thesis's computed torque."""


def usual_gains(
    law: Law, kp: JointVector | None = None, ki: JointVector | None = None, kd: JointVector | None = None
) -> Gains:
    """The usual gains of a control law, but for those that are given.

    Args:
        law: cascade, computed_torque or row_sum.
        kp: proportional gain of each joint, 1/s^2; None for the usual one.
        ki: integral gain of each joint, 1/s^3; None for the usual one.
        kd: derivative gain of each joint, 1/s; None for the usual one.

    Raises:
        ParameterError: there is no such law, or a gain is negative or not finite.
    """
    if law not in USUAL_GAINS:
        raise ParameterError(f"law: expected {choices(LAWS)}, got {law!r}")
    usual = USUAL_GAINS[law]
    return Gains(kp or usual.kp, ki or usual.ki, kd or usual.kd)


@dataclass(frozen=True, slots=True)
class Compensation:
    """What the cascade takes into account of the drives and encoders; the thesis's laws know nothing of it.

    Attributes:
        delay: time from a sample until its voltages act, s, one tick at most.
        dead_zone: voltage that is lost in every amplifier, V.
        bandwidth: double pole of the observer, rad/s.
        repeats: repetitions of a reading that the noise of each encoder makes impossible; 0 where it does not.
        pull: what leaves the readings of each joint as they are, as a share of the torque that does so where drives
            and encoders are unknown: 0.3 N m, and 7 rad/s^2 times the inertia. 1 where they are.

    Raises:
        ParameterError: a value is out of range.
    """

    delay: float = 0.01
    dead_zone: float = 0.0
    bandwidth: float = 100.0
    repeats: Annotated[tuple[int, ...], ONE_A_JOINT] = (0,) * JOINTS
    pull: CellJoints = every_joint(1.0)

    def __post_init__(self) -> None:
        for name, (low, high, unit) in COMPENSATION_RANGES.items():
            value = getattr(self, name)
            if not low <= value <= high:
                raise ParameterError(f"{name.replace('_', ' ')}: expected {low:g} to {high:g} {unit}, got {value:g}")
        if not all(0 <= count <= MOST_REPEATS for count in self.repeats):
            raise ParameterError(f"repeats: expected 0 to {MOST_REPEATS}, got {self.repeats}")
        if not all(0.0 < share <= 1.0 for share in self.pull):
            raise ParameterError(f"pull: expected shares above 0 and up to 1, got {self.pull}")


@dataclass(frozen=True, slots=True)
class ControlSettings:
    """Values for the data inputs of the control application.

    Attributes:
        GROUPS: inputs that hold settings which a running controller can be given, by the names of those that come
            into force at once.
        NAMED: settings that stay, but which a change may be meant for alone.
        EXPECTED: what of them one change may consist of, in words.
        target_time: duration T of every motion, s.
        gains: gains of the law; the usual ones of the law if not given.
        law: "computed_torque" feeds back through the mass matrix, "row_sum" through its row sums without the damping
            term; both are the thesis's, on cubic paths. "cascade" feeds back a velocity, on paths whose acceleration
            has no steps.
        model: arm model of the controller; the law "cascade" alone compensates its Coulomb friction.
        payload: mass of a box that the controller assumes, kg.
        payload_model: how a held box counts in the model; None takes what the law needs to hold a box everywhere:
            the weight alone for the row-sum law, a point mass for the others.
        compensation: what the cascade takes into account of drives and encoders.
        encoder_offset: known offsets of the encoders, rad, which are taken off what they read.

    Raises:
        ParameterError: a value is out of range.
    """

    GROUPS: ClassVar[Mapping[tuple[str, ...], tuple[str, ...]]] = {
        ("gains", "target_time"): TUNING,
        ("model",): MODEL,
        ("payload",): LOAD,
        ("encoder_offset",): OFFSETS,
    }
    NAMED: ClassVar[tuple[str, ...]] = ("law",)
    EXPECTED: ClassVar[str] = "gains, a target time or both, or a model, a payload or encoder offsets alone"

    target_time: float = 2.0
    gains: Gains = _OF_THE_LAW
    law: Law = "computed_torque"
    model: ArmParameters = field(default_factory=ArmParameters)
    payload: float = 0.2
    payload_model: PayloadModel | None = None
    compensation: Compensation = field(default_factory=Compensation)
    encoder_offset: CellJoints = NO_OFFSET

    def __post_init__(self) -> None:
        if self.law not in LAWS:
            raise ParameterError(f"law: expected {choices(LAWS)}, got {self.law!r}")
        if self.gains is _OF_THE_LAW:
            object.__setattr__(self, "gains", USUAL_GAINS[self.law])
        if not (math.isfinite(self.target_time) and self.target_time > 0):
            raise ParameterError(f"target time: expected a finite number of seconds above 0, got {self.target_time}")
        if not (math.isfinite(self.payload) and self.payload >= 0):
            raise ParameterError(f"payload: expected a finite mass of at least 0 kg, got {self.payload}")
        if not all(map(math.isfinite, self.encoder_offset)):
            raise ParameterError(f"encoder offset: expected finite angles, got {self.encoder_offset}")
        if self.payload_model not in (None, *get_args(PayloadModel)):
            raise ParameterError(
                f"payload model: expected {choices(get_args(PayloadModel))}, got {self.payload_model!r}"
            )

    @property
    def box_counts(self) -> PayloadModel:
        """How a held box counts in the model of the controller."""
        return self.payload_model or _NEEDED[self.law]

    def inputs(self) -> dict[str, float | int]:
        """The values by the names of the block inputs, `BLOCK.INPUT`."""
        gains, model = self.gains, self.model
        vectors = (*gains.kp, *gains.ki, *gains.kd, *model.vector())
        values: dict[str, float | int] = dict(zip(_OF_JOINTS, vectors, strict=True))
        values["CONTROLLER.LAW"] = LAWS.index(self.law)
        values[PAYLOAD] = self.payload
        values["CONTROLLER.WEIGHT_ONLY"] = self.box_counts == "weight"
        values["CONTROLLER.DEAD_ZONE"] = self.compensation.dead_zone
        values["OBSERVER.DELAY"] = self.compensation.delay
        values["OBSERVER.BANDWIDTH"] = self.compensation.bandwidth
        values[CONFIRM] = CONFIRMED if self.law == "cascade" else 0
        values[WIDENED] = RESTLESS if self.law == "cascade" else 1.0
        values["OBSERVER.GATE"] = BELIEVED if self.law == "cascade" else 0.0
        values.update(zip(REPEATS, self.compensation.repeats, strict=True))
        values.update(zip(PULL, self.compensation.pull, strict=True))
        values["PLANNER.SMOOTH"] = self.law == "cascade"
        values["PLANNER.T"] = self.target_time
        values.update(zip(OFFSETS, self.encoder_offset, strict=True))
        return values

    @classmethod
    def from_inputs(cls, values: Mapping[str, float]) -> ControlSettings:
        """The settings that given block inputs hold: the inverse of `inputs`.

        Raises:
            ParameterError: a value is out of range.
        """

        def joints(name: str) -> JointVector:
            return tuple(values[f"CONTROLLER.{name}{joint}"] for joint in range(1, JOINTS + 1))

        law = round(values["CONTROLLER.LAW"])
        if law not in range(len(LAWS)):
            raise ParameterError(f"CONTROLLER.LAW: expected 0 to {len(LAWS) - 1}, got {law}")
        return cls(
            values["PLANNER.T"],
            Gains(joints("KP"), joints("KI"), joints("KD")),
            LAWS[law],
            ArmParameters(*map(joints, (*"KMILCD", "MU"))),
            values[PAYLOAD],
            "weight" if values["CONTROLLER.WEIGHT_ONLY"] else "point",
            Compensation(
                values["OBSERVER.DELAY"],
                values["CONTROLLER.DEAD_ZONE"],
                values["OBSERVER.BANDWIDTH"],
                (round(values[REPEATS[0]]), round(values[REPEATS[1]]), round(values[REPEATS[2]])),
                (values[PULL[0]], values[PULL[1]], values[PULL[2]]),
            ),
            (values[OFFSETS[0]], values[OFFSETS[1]], values[OFFSETS[2]]),
        )

    def angles(self, readings: JointVector) -> JointVector:
        """The angles that encoders with the known offsets read, rad."""
        return tuple(reading - offset for reading, offset in zip(readings, self.encoder_offset, strict=True))

    def differing(self, other: ControlSettings) -> set[str]:
        """Names of the inputs whose values differ by more than the 15 digits that a FORTE writes."""
        mine, its = self.inputs(), other.inputs()
        return {name for name in mine if not math.isclose(mine[name], its[name], rel_tol=DIGITS)}
