"""A machine: the effects of a real arm in five sections; the defaults of all of them together are the ideal machine.

docs/machine.md has the equation, the unit and the source of every number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Annotated, Any, Final, Literal, get_args, get_origin, get_type_hints

from dtwin.errors import ParameterError, choices
from dtwin.parameters import JOINTS, ArmParameters, JointVector, every_joint

NoiseKind = Literal["uniform", "gaussian", "correlated"]
"""Kind of the encoders' noise."""


@dataclass(frozen=True, slots=True)
class Range:
    """The range of a number, or of those of all joints."""

    low: float
    high: float


_NONE: Final[JointVector] = every_joint(0.0)
_ALL: Final[JointVector] = every_joint(1.0)
_ANGLE: Final = Range(-math.tau, math.tau)


def declared(section: type[Section]) -> dict[str, tuple[Any, Range | None]]:
    """Type and range of every field of a section; texts have no range."""
    hints = get_type_hints(section, include_extras=True)
    return {name: (hint, None) if get_origin(hint) is Literal else get_args(hint) for name, hint in hints.items()}


@dataclass(frozen=True, slots=True)
class Section:
    """Base of the sections: checks every number against the range that its field declares."""

    def __post_init__(self) -> None:
        for name, (kind, allowed) in declared(type(self)).items():
            value, where = getattr(self, name), f"{type(self).__name__.lower()}.{name}"
            if allowed is None:
                if value not in get_args(kind):
                    raise ParameterError(f"{where}: expected {choices(get_args(kind))}, got {value!r}")
                continue
            if kind is JointVector and len(value) != JOINTS:
                raise ParameterError(f"{where}: expected {JOINTS} numbers, one a joint, got {len(value)}")
            for number in value if kind is JointVector else (value,):
                if not allowed.low <= number <= allowed.high:
                    bounds = f"from {allowed.low:g} to {allowed.high:g}"
                    raise ParameterError(f"{where}: expected a number {bounds}, got {number}")


@dataclass(frozen=True, slots=True)
class Drive(Section):
    """Amplifier, supply and windings, from the commanded voltage to the torque of the motor.

    Attributes:
        torque: factor of the torque per volt K.
        lag: time constant of amplifier and windings, s.
        back_emf: voltage that the turning motor induces, per joint velocity, V s/rad.
        bits: resolution of the voltage over its range from -8 to 8 V, bits; 0 for an infinite one.
        dead_zone: voltage that is lost in the amplifier, V.
        sag: resistance of the supply, as a share of that of one winding.
        delay: time from a command until it acts, s.
    """

    torque: Annotated[JointVector, Range(0.1, 2.0)] = _ALL
    lag: Annotated[JointVector, Range(0.0, 0.1)] = _NONE
    back_emf: Annotated[JointVector, Range(0.0, 2.0)] = _NONE
    bits: Annotated[int, Range(0, 24)] = 0
    dead_zone: Annotated[JointVector, Range(0.0, 2.0)] = _NONE
    sag: Annotated[float, Range(0.0, 0.5)] = 0.0
    delay: Annotated[float, Range(0.0, 0.1)] = 0.0


@dataclass(frozen=True, slots=True)
class Transmission(Section):
    """Gear and bearings between motor and link; friction and torque ripple act on the side of the motor.

    Attributes:
        damping: factor of the viscous damping D.
        coulomb: Coulomb friction, N m.
        static: friction at rest, N m; where it is below the Coulomb friction, that one holds at rest too.
        stribeck_velocity: velocity over which friction falls from static to Coulomb, rad/s.
        presliding: stiffness of the contact before it slides, N m/rad; 0 for a contact that does not yield.
        rotor_inertia: inertia of the rotor as seen at the joint, kg m^2.
        stiffness: stiffness of the gear, N m/rad; 0 for a rigid one.
        gear_damping: damping of the gear beside its stiffness, N m s/rad.
        backlash: whole play of the gear, rad; only an elastic gear has one.
        ripple: amplitude of the torque ripple, N m.
        ripple_periods: number of its periods in a turn of the joint.
        ripple_phase: phase of the ripple at the angle 0, rad.
        cable: stiffness of the cables that span the joint, N m/rad.
        cable_rest: angle of the joint at which the cables do not pull, rad.
    """

    damping: Annotated[JointVector, Range(0.0, 10.0)] = _ALL
    coulomb: Annotated[JointVector, Range(0.0, 0.5)] = _NONE
    static: Annotated[JointVector, Range(0.0, 0.5)] = _NONE
    stribeck_velocity: Annotated[JointVector, Range(1e-3, 10.0)] = every_joint(0.1)
    presliding: Annotated[JointVector, Range(0.0, 1000.0)] = _NONE
    rotor_inertia: Annotated[JointVector, Range(0.0, 0.1)] = _NONE
    stiffness: Annotated[JointVector, Range(0.0, 1000.0)] = _NONE
    gear_damping: Annotated[JointVector, Range(0.0, 1.0)] = every_joint(0.02)
    backlash: Annotated[JointVector, Range(0.0, 0.2)] = _NONE
    ripple: Annotated[JointVector, Range(0.0, 0.2)] = _NONE
    ripple_periods: Annotated[JointVector, Range(1.0, 500.0)] = every_joint(6.0)
    ripple_phase: Annotated[JointVector, _ANGLE] = _NONE
    cable: Annotated[JointVector, Range(0.0, 1.0)] = _NONE
    cable_rest: Annotated[JointVector, _ANGLE] = _NONE

    def __post_init__(self) -> None:
        # Written out: super() without arguments is lost where a dataclass with slots is made anew.
        Section.__post_init__(self)
        for joint, (stiffness, backlash, inertia) in enumerate(
            zip(self.stiffness, self.backlash, self.rotor_inertia, strict=True), 1
        ):
            if backlash and not stiffness:
                raise ParameterError(f"transmission.backlash: expected a stiffness above 0 at joint {joint}, got 0")
            if stiffness and not inertia:
                raise ParameterError(
                    f"transmission.stiffness: expected a rotor_inertia above 0 at joint {joint}, got 0"
                )


@dataclass(frozen=True, slots=True)
class Structure(Section):
    """Links and base as they were made.

    Attributes:
        mass: factor of the mass m.
        inertia: factor of the moment of inertia I.
        length: factor of the length l.
        com: factor of the distance c of the centre of mass.
        com_offset: distance of the centre of mass from the link's line, to the left of it, m.
        tilt: angle by which the base is turned in the arm's plane, positive as joint 1, rad.
    """

    mass: Annotated[JointVector, Range(0.5, 2.0)] = _ALL
    inertia: Annotated[JointVector, Range(0.2, 5.0)] = _ALL
    length: Annotated[JointVector, Range(0.9, 1.1)] = _ALL
    com: Annotated[JointVector, Range(0.5, 1.5)] = _ALL
    com_offset: Annotated[JointVector, Range(-0.05, 0.05)] = _NONE
    tilt: Annotated[float, Range(-0.5, 0.5)] = 0.0


@dataclass(frozen=True, slots=True)
class Sensing(Section):
    """Encoders of the joints.

    Attributes:
        motor_side: joints whose encoder sits on the motor, 1 for yes and 0 for no.
        bits: resolution of a turn, bits; 0 for an infinite one.
        eccentricity: amplitude of the error that comes back every turn, rad.
        eccentricity_phase: phase of that error at the angle 0, rad.
        scale: share by which the reading is too large.
        noise: magnitude of the noise, rad.
        noise_kind: uniform adds noise u with u in [0, 1); gaussian has the standard deviation noise; correlated is
            Gaussian with a memory.
        noise_time: time over which correlated noise forgets, s.
        spike_rate: number of spikes of an encoder in a second.
        spike: size of a spike, up or down, rad.
        loss_rate: number of samples that are lost in a second; the last one is read again.
        delay: age of the sample, s.
    """

    motor_side: Annotated[JointVector, Range(0.0, 1.0)] = _NONE
    bits: Annotated[int, Range(0, 32)] = 0
    eccentricity: Annotated[JointVector, Range(0.0, 0.1)] = _NONE
    eccentricity_phase: Annotated[JointVector, _ANGLE] = _NONE
    scale: Annotated[JointVector, Range(-0.05, 0.05)] = _NONE
    noise: Annotated[float, Range(0.0, 0.1)] = 0.0
    noise_kind: NoiseKind = "gaussian"
    noise_time: Annotated[float, Range(1e-3, 10.0)] = 0.05
    spike_rate: Annotated[float, Range(0.0, 50.0)] = 0.0
    spike: Annotated[float, Range(0.0, 1.0)] = 0.0
    loss_rate: Annotated[float, Range(0.0, 50.0)] = 0.0
    delay: Annotated[float, Range(0.0, 0.1)] = 0.0


@dataclass(frozen=True, slots=True)
class Contact(Section):
    """Contact between arm, jaws, trays, belts and boxes.

    Attributes:
        enabled: whether bodies touch; otherwise a box is a mass at the tip from grip to release.
        pad_friction: coefficient of Coulomb friction between the pads of the gripper and a box.
        friction: coefficient of Coulomb friction between all other bodies.
        belt_speed: speed of a belt while it runs, m/s.
    """

    enabled: Annotated[bool, Range(0, 1)] = False
    pad_friction: Annotated[float, Range(0.0, 5.0)] = 0.6
    friction: Annotated[float, Range(0.0, 5.0)] = 0.6
    belt_speed: Annotated[float, Range(0.01, 0.5)] = 0.2


@dataclass(frozen=True, slots=True)
class Machine:
    """A whole machine.

    Attributes:
        name: name of the machine, for people and logs.
        drive: amplifiers and motors.
        transmission: gears and bearings.
        structure: links and base.
        sensing: encoders.
        contact: whether bodies touch, and how.

    Raises:
        ParameterError: a number of a section is out of range.
    """

    name: str = "ideal"
    drive: Drive = Drive()
    transmission: Transmission = Transmission()
    structure: Structure = Structure()
    sensing: Sensing = Sensing()
    contact: Contact = Contact()

    @property
    def ideal(self) -> bool:
        """Whether the machine obeys the twin's equations, whatever it is called."""
        return self.ideal_arm and self.contact == IDEAL.contact

    @property
    def ideal_arm(self) -> bool:
        """Whether the arm obeys the twin's equations as long as it touches nothing."""
        return replace(self, name=IDEAL.name, contact=IDEAL.contact) == IDEAL

    def arm(self, nominal: ArmParameters) -> ArmParameters:
        """The parameters of the arm that was made to the nominal ones; its Coulomb friction is added to theirs."""
        structure, transmission = self.structure, self.transmission
        return ArmParameters(
            voltage_constant=_product(nominal.voltage_constant, self.drive.torque),
            mass=_product(nominal.mass, structure.mass),
            inertia=_product(nominal.inertia, structure.inertia),
            length=_product(nominal.length, structure.length),
            com=_product(nominal.com, structure.com),
            damping=_product(nominal.damping, transmission.damping),
            coulomb=_sum(nominal.coulomb, transmission.coulomb),
        )

    def effects(self) -> dict[str, dict[str, Any]]:
        """What differs from the ideal machine, by section and field."""
        found = {}
        for section, values in self.sections().items():
            ideal = asdict(getattr(IDEAL, section))
            changed = {name: value for name, value in values.items() if value != ideal[name]}
            if changed:
                found[section] = changed
        return found

    def sections(self) -> Mapping[str, dict[str, Any]]:
        """All numbers, by section and field."""
        return {name: asdict(getattr(self, name)) for name in SECTIONS}


SECTIONS: Final[Mapping[str, type[Section]]] = {
    "drive": Drive,
    "transmission": Transmission,
    "structure": Structure,
    "sensing": Sensing,
    "contact": Contact,
}
"""The sections of a machine by their names."""
IDEAL: Final = Machine()
"""The machine that obeys the twin's equations."""


def _product(first: JointVector, second: JointVector) -> JointVector:
    return tuple(a * b for a, b in zip(first, second, strict=True))


def _sum(first: JointVector, second: JointVector) -> JointVector:
    return tuple(a + b for a, b in zip(first, second, strict=True))
