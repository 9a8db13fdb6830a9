"""A serial chain of n joints as a frozen value. SI units; joints and links are counted from the base.

Link i moves with joint i. Its frame is that of joint i: the origin lies on the joint's axis, and at joint position 0
it is turned and shifted against the frame of link i - 1 as `Joint.rotation` and `Joint.translation` say.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ModelError

Array = NDArray[np.float64]
JointKind = Literal["revolute", "prismatic"]
Commanded = Literal["torque", "current", "voltage", "position"]
Side = Literal["motor", "joint"]

INERTIAL: Final = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
"""The ten inertial parameters of a link, in the order of Pinocchio's regressor: mass (kg), first moments (kg m) and
inertia (kg m^2) about the origin of the link's frame."""
GRAVITY: Final = (0.0, 0.0, -9.81)


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A rigid body.

    Attributes:
        name: name in the model file.
        mass: mass, kg.
        centre: centre of mass in the link's frame, (3,), m.
        inertia: inertia about the centre of mass, axes of the link's frame, (3, 3), kg m^2.
    """

    name: str
    mass: float
    centre: Array
    inertia: Array

    @property
    def parameters(self) -> Array:
        """The parameters named in INERTIAL, (10,)."""
        moved = self.inertia + self.mass * steiner(self.centre)
        return np.array([self.mass, *(self.mass * self.centre), *moved[np.tril_indices(3)]])

    @classmethod
    def from_parameters(cls, name: str, parameters: Array) -> Link:
        """The link with the parameters named in INERTIAL, (10,); a mass of 0 has its centre at the origin."""
        mass = float(parameters[0])
        centre = parameters[1:4] / mass if mass else np.zeros(3)
        return cls(name, mass, centre, symmetric(parameters[4:]) - mass * steiner(centre))


@dataclass(frozen=True, slots=True)
class Actuator:
    """What drives a joint.

    Attributes:
        commanded: quantity that a log or a controller commands.
        constant: torque at the joint per ampere or per volt, N m/A or N m/V; None where it is not known.
        tolerance: relative standard deviation of the constant.
        gear: turns of the motor for one of the joint; its sign is that of the direction.
        rotor: inertia of the rotor seen at the joint, kg m^2; None where it is not known.
        limit: largest command either way, N m, A or V; inf where it is not known.
        stiffness: of a drive that is commanded a position, torque at the joint a unit off its command, N m/rad or
            N/m; None where it is not known.
        damping: of such a drive, torque at the joint against a unit of velocity, N m s/rad or N s/m.
    """

    commanded: Commanded = "torque"
    constant: float | None = None
    tolerance: float = 0.1
    gear: float = 1.0
    rotor: float | None = None
    limit: float = np.inf
    stiffness: float | None = None
    damping: float = 0.0


@dataclass(frozen=True, slots=True)
class Friction:
    """What a joint loses, as far as it is known before anything is identified.

    Attributes:
        viscous: torque per velocity, N m s/rad or N s/m.
        coulomb: torque against the motion, N m or N.
        load: further torque against the motion, in parts of the torque that the gear carries.
    """

    viscous: float = 0.0
    coulomb: float = 0.0
    load: float = 0.0


@dataclass(frozen=True, slots=True)
class Transmission:
    """A gear that yields, between the motor and its joint; all of it as seen at the joint.

    Its torque is k dz(x) + d x', where x is what the motor is ahead of the joint and
    dz(x) = sign(x) max(|x| - b / 2, 0) (Spong, ASME J. Dyn. Sys. Meas. Control 109, 1987, with a dead band).

    Attributes:
        stiffness: k, N m/rad or N/m.
        damping: d, N m s/rad or N s/m.
        backlash: whole play b, rad or m.
        encoder: on which side of it the encoder is.
    """

    stiffness: float
    damping: float = 0.0
    backlash: float = 0.0
    encoder: Side = "motor"


@dataclass(frozen=True, slots=True)
class Brake:
    """A brake that holds a joint by springs as long as its coil has no current.

    Attributes:
        torque: torque or force up to which it holds, at the joint, N m or N; a joint that moves loses as much.
        delay: time from its command until it holds, s.
    """

    torque: float
    delay: float = 0.0


@dataclass(frozen=True, slots=True)
class Tolerances:
    """Relative standard deviations of an arm of this kind from its data sheet.

    Attributes:
        constant: of the constants of the actuators.
        mass: of the masses of the links.
        inertia: of their inertias.
        friction: of every friction term.
        gear: of stiffness, damping and play of gears that yield.
        centre: standard deviation of a centre of mass along each axis, m.
        noise: standard deviation of the noise of the encoders, rad or m.
    """

    constant: float = 0.05
    mass: float = 0.03
    inertia: float = 0.05
    friction: float = 0.3
    centre: float = 0.002
    noise: float = 0.0
    gear: float = 0.2


@dataclass(frozen=True, slots=True)
class Gripper:
    """What holds a load at the end of the chain.

    Attributes:
        payload: largest mass that it holds, kg.
    """

    payload: float


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint and what drives and senses it.

    Attributes:
        name: name in the model file.
        kind: revolute (rad, N m) or prismatic (m, N).
        axis: unit vector in the joint's frame, (3,).
        rotation: attitude of the joint's frame in that of the link before at position 0, (3, 3).
        translation: its origin there, (3,), m.
        lower: least position, rad or m; -inf where there is none.
        upper: largest position.
        speed: largest speed, rad/s or m/s; inf where it is not known.
        effort: largest torque or force, N m or N; inf where it is not known.
        actuator: its drive.
        step: step of the encoder, rad or m; 0 where it is not known.
        acceleration: largest acceleration that a path asks for, rad/s^2 or m/s^2; inf where nobody said one.
        friction: what it loses.
        transmission: its gear, if that yields; None for one that does not.
        brake: its holding brake; None without one.
    """

    name: str
    kind: JointKind
    axis: Array
    rotation: Array
    translation: Array
    lower: float = -np.inf
    upper: float = np.inf
    speed: float = np.inf
    effort: float = np.inf
    actuator: Actuator = Actuator()
    step: float = 0.0
    acceleration: float = np.inf
    friction: Friction = Friction()
    transmission: Transmission | None = None
    brake: Brake | None = None

    @property
    def turns(self) -> bool:
        """Whether it is revolute."""
        return self.kind == "revolute"

    @property
    def unit(self) -> str:
        """The unit of its position."""
        return "rad" if self.turns else "m"

    @property
    def effort_unit(self) -> str:
        """The unit of its torque or force."""
        return "N m" if self.turns else "N"

    @property
    def command_unit(self) -> str:
        """The unit in which its drive is commanded."""
        other = {"current": "A", "voltage": "V", "position": self.unit}
        return other.get(self.actuator.commanded, self.effort_unit)

    @property
    def largest(self) -> float:
        """The largest torque or force of its drive, N m or N; inf where neither limit nor effort is known."""
        constant = self.actuator.constant
        return self.effort if constant is None else min(self.effort, abs(constant) * self.actuator.limit)


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """A serial chain.

    Attributes:
        name: its name.
        joints: n joints from the base on.
        links: the n links that move with them.
        gravity: acceleration of gravity in the base's frame, (3,), m/s^2.
        remarks: what its reader simplified, as sentences for people.
        tool: point of the last link that does the work, in the link's frame, (3,), m.
        period: time between two samples of its controller, s.
        tolerances: how arms of this kind differ from it.
        gripper: what holds a load, if anything does.
        model: file that the chain was read from, which has its shapes; None where there is none.
    """

    name: str
    joints: tuple[Joint, ...]
    links: tuple[Link, ...]
    gravity: Array = field(default_factory=lambda: np.array(GRAVITY))
    remarks: tuple[str, ...] = ()
    tool: Array = field(default_factory=lambda: np.zeros(3))
    period: float = 0.01
    tolerances: Tolerances = Tolerances()
    gripper: Gripper | None = None
    model: Path | None = None

    def __post_init__(self) -> None:
        if not self.joints or len(self.joints) != len(self.links):
            raise ModelError(
                f"arm {self.name}: expected at least one joint and as many links, got {len(self.joints)} and "
                f"{len(self.links)}"
            )
        for joint in self.joints:
            if not np.isclose(np.linalg.norm(joint.axis), 1.0, atol=1e-6):
                raise ModelError(
                    f"arm {self.name}: joint {joint.name}: expected an axis of length 1, got {joint.axis}"
                )

    @property
    def most_load(self) -> float:
        """Largest mass at the tool that is reckoned with, kg: the gripper's payload, else the mass of the arm."""
        return self.gripper.payload if self.gripper is not None else sum(link.mass for link in self.links)

    @property
    def servos(self) -> tuple[str, ...]:
        """Names of the joints whose drives are commanded a position."""
        return tuple(joint.name for joint in self.joints if joint.actuator.commanded == "position")

    @property
    def path_speeds(self) -> Array:
        """The largest speeds of paths, (n,), rad/s or m/s.

        A drive that takes a position has its command for a tick. Where that moves on by what takes all of its loop's
        torque, the drive lets go of its joint between two commands; paths keep to half of that.
        """
        speeds = np.array([joint.speed for joint in self.joints])
        stiffness = np.array([joint.actuator.stiffness or 0.0 for joint in self.joints])
        reach = np.array([joint.largest for joint in self.joints])
        with np.errstate(divide="ignore"):
            found: Array = np.minimum(speeds, 0.5 * reach / (stiffness * self.period))
        return found

    def __len__(self) -> int:
        """The number of joints n."""
        return len(self.joints)

    @property
    def parameters(self) -> Array:
        """The inertial parameters of all links, (10 n,)."""
        return np.concatenate([link.parameters for link in self.links])

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of `parameters`, such as m_2 for the mass of link 2."""
        return tuple(f"{name}_{i}" for i in range(1, len(self) + 1) for name in INERTIAL)

    def with_parameters(self, parameters: Array) -> Arm:
        """The arm with other inertial parameters, (10 n,)."""
        links = zip(self.links, parameters.reshape(len(self), 10), strict=True)
        return replace(self, links=tuple(Link.from_parameters(link.name, row) for link, row in links))


def holding(arm: Arm, mass: float) -> Arm:
    """The arm with a point mass at its tool, kg, as part of its last link."""
    last = arm.links[-1]
    added = np.array([mass, *(mass * arm.tool), *(mass * steiner(arm.tool))[np.tril_indices(3)]])
    return replace(arm, links=(*arm.links[:-1], Link.from_parameters(last.name, last.parameters + added)))


def without_servos(arm: Arm, what: str) -> Arm:
    """The arm, if none of its drives is commanded a position.

    Args:
        arm: the arm.
        what: what needs that, for people.

    Raises:
        ModelError: one is; names it.
    """
    if arm.servos:
        raise ModelError(
            f"arm {arm.name}: joints.{arm.servos[0]}: {what}: expected a drive commanded in V, N m or A, whose "
            "command is its torque; this one is commanded a position and makes its torque itself"
        )
    return arm


def servo_torque(arm: Arm, command: Array, q: Array, qd: Array) -> Array:
    """What drives that are commanded a position give, (..., n), N m or N, within the joints' efforts.

    Args:
        arm: the arm; all of its drives are such ones.
        command: commanded positions, (..., n), rad or m.
        q: positions, (..., n).
        qd: velocities, (..., n).
    """
    stiffness = np.array([joint.actuator.stiffness or 0.0 for joint in arm.joints])
    damping = np.array([joint.actuator.damping for joint in arm.joints])
    effort = np.array([joint.effort for joint in arm.joints])
    torque: Array = np.clip(stiffness * (command - q) - damping * qd, -effort, effort)
    return torque


def aligned(arm: Arm) -> Arm:
    """The same arm with every frame turned so that its joint's axis is z, which makes its equations short."""
    before = np.eye(3)
    joints, links = [], []
    for joint, link in zip(arm.joints, arm.links, strict=True):
        turn = _onto(joint.axis)
        rotation, translation = before.T @ joint.rotation @ turn, before.T @ joint.translation
        joints.append(replace(joint, axis=np.array([0.0, 0.0, 1.0]), rotation=rotation, translation=translation))
        links.append(Link(link.name, link.mass, turn.T @ link.centre, turn.T @ link.inertia @ turn))
        before = turn
    return replace(arm, joints=tuple(joints), links=tuple(links), tool=before.T @ arm.tool)


def _onto(axis: Array) -> Array:
    """A rotation (3, 3) that takes z to a unit vector (3,); exact where that is along x, y or z."""
    helper = np.eye(3)[min((1, 2, 0), key=lambda k: abs(axis[k]))]  # y beside z, so that z itself stays
    first = np.cross(helper, axis)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(axis, first), axis], axis=1)


def steiner(arm: Array) -> Array:
    """What a mass of 1 kg at `arm`, (3,), m, adds to an inertia about the origin, (3, 3), m^2."""
    squared: Array = arm @ arm * np.eye(3) - np.outer(arm, arm)
    return squared


def symmetric(six: Array) -> Array:
    """The matrix (3, 3) of Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    matrix = np.zeros((3, 3))
    matrix[np.tril_indices(3)] = six
    return matrix + np.tril(matrix, -1).T
