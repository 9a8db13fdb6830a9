"""The numbers of a serial arm by which function blocks reckon: bodies, and what drives give and joints lose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # Messages carry models, and who only passes them loads no library of numbers.
    from dtwin.arm.chain import Arm


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
