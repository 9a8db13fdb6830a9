"""What the function blocks of a serial arm can be given while they run: the model by which they reckon, a tuning."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Final

if TYPE_CHECKING:  # Messages carry models, and who only passes them loads no library of numbers.
    from dtwin.arm.chain import Arm

USUAL_POLE: Final = 13.7
"""The threefold pole of the errors of a joint, rad/s."""
USUAL_OBSERVER: Final = 100.0
"""Double pole of its observer, rad/s."""


@dataclass(frozen=True, slots=True)
class ArmTuning:
    """How strongly the blocks feed errors back, and how fast they lead the arm.

    Attributes:
        pole: triple pole of the errors of every joint, rad/s; drives that are commanded a position have their own.
        observer: double pole of the observers, rad/s.
        speed: speeds of the paths in parts of the data sheet's; accelerations follow with its square.
    """

    pole: float = USUAL_POLE
    observer: float = USUAL_OBSERVER
    speed: float = 1.0


@dataclass(frozen=True, slots=True)
class ArmModel:
    """A model. The lists have a value for each of the n joints.

    Attributes:
        bodies: the ten inertial parameters of each link, in the order of `dtwin.arm.chain.INERTIAL`.
        constant: torque at the joint a unit of the command, N m or N.
        rotor: inertia of the rotor seen at the joint, kg m^2 or kg.
        viscous: viscous friction, N m s/rad or N s/m.
        coulomb: Coulomb friction, N m or N.
        share: friction that grows with the torque carried, in parts of it.
    """

    bodies: tuple[tuple[float, ...], ...]
    constant: tuple[float, ...]
    rotor: tuple[float, ...]
    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    share: tuple[float, ...]

    @classmethod
    def of(cls, arm: Arm) -> ArmModel:
        """The model that an arm's data sheet gives."""
        return cls(
            tuple(tuple(map(float, link.parameters)) for link in arm.links),
            tuple(float(joint.actuator.constant or 1.0) for joint in arm.joints),
            tuple(float(joint.actuator.rotor or 0.0) for joint in arm.joints),
            tuple(float(joint.friction.viscous) for joint in arm.joints),
            tuple(float(joint.friction.coulomb) for joint in arm.joints),
            tuple(float(joint.friction.load) for joint in arm.joints),
        )


@dataclass(frozen=True, slots=True)
class ArmSettings:
    """All that running blocks can be given.

    Attributes:
        GROUPS: settings that come into force at once, which is all of them.
        NAMED: settings that stay, but which a change may be meant for alone: none.
        EXPECTED: what of them one change may consist of, in words.
        model: the model by which they reckon.
        tuning: how they control.
    """

    GROUPS: ClassVar[Mapping[tuple[str, ...], tuple[str, ...]]] = {("model", "tuning"): ("model", "tuning")}
    NAMED: ClassVar[tuple[str, ...]] = ()
    EXPECTED: ClassVar[str] = "a model, a tuning or both"

    model: ArmModel
    tuning: ArmTuning = ArmTuning()

    def differing(self, other: ArmSettings) -> set[str]:
        """Names of the settings that differ."""
        return {name for name in ("model", "tuning") if getattr(self, name) != getattr(other, name)}
