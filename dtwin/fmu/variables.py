"""The variables of the models: what they are to a simulator, and where they are in the structure of the C model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Literal

from dtwin.controller.ports import PATH, SYSTEM
from dtwin.controller.sequence import HELP, STRAIGHT
from dtwin.controller.settings import ControlSettings
from dtwin.errors import FunctionBlockError, ParameterError
from dtwin.fmu.ranges import (
    ANGLES,
    ARM_RANGES,
    COULOMB_WIDTHS,
    MASSES,
    STEPS,
    VELOCITIES,
    VOLTAGES,
    Range,
    range_of_setting,
)
from dtwin.parameters import (
    COULOMB_WIDTH,
    HANGING,
    PARAMETER_NAMES,
    PHYSICS_STEP,
    ArmParameters,
    GripperParameters,
    symbol_of,
    unit_of,
)
from iec61499.native.layout import Layout
from iec61499.runtime.linking.generic_ports import variable_at
from iec61499.types import BOOL, DINT, LREAL

Value = float | int | bool | str
Kind = Literal["Float64", "Int32", "Boolean", "String"]
Causality = Literal["independent", "parameter", "input", "output"]
Variability = Literal["continuous", "discrete", "fixed", "tunable"]
_KINDS: Final[dict[object, Kind]] = {LREAL: "Float64", DINT: "Int32", BOOL: "Boolean"}
_JOINTS: Final = (1, 2, 3)
BOX_MASS: Final = 0.2
"""Mass of the box that waits in the cell unless another one is given, kg."""


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of a model; its value reference is its place among all.

    Attributes:
        name: its name, in the structured naming convention of FMI.
        kind: its type, as FMI 3.0 names it.
        causality: what it is to others.
        variability: when it changes.
        member: the C lvalue below the model.
        description: what it is.
        start: the start value; None for what is computed.
        unit: its unit, "" for none.
        derivative_of: name of the variable of which it is the derivative by time, "" for none.
        depends_on: of an output, the inputs and states that it follows at once, within a communication point. By
            these simulators find algebraic loops between FMUs.
        starts_from: of an output, the parameters of which its value at the start is made; None for all knowns.
        bounds: the range of a number that can be set; None for the others.

    Raises:
        ParameterError: the start value is out of the range.
    """

    name: str
    kind: Kind
    causality: Causality
    variability: Variability
    member: str
    description: str
    start: Value | None = None
    unit: str = ""
    derivative_of: str = ""
    depends_on: tuple[str, ...] = ()
    starts_from: tuple[str, ...] | None = ()
    bounds: Range | None = None

    def __post_init__(self) -> None:
        if self.bounds is not None and not isinstance(self.start, str | None):
            low, high = self.bounds
            if not low <= self.start <= high:
                unit = f" {self.unit}" if self.unit else ""
                raise ParameterError(f"{self.name}: an FMU takes {low:g} to {high:g}{unit}, got {self.start:g}")


TIME: Final = Variable("time", "Float64", "independent", "continuous", "time", "Time", unit="s")


def twin_variables(arm: ArmParameters) -> list[Variable]:
    """The variables of the twin alone.

    Args:
        arm: the parameters that it starts with.
    """
    volts = [
        _input(f"V{name}", "continuous", f"arm.volts[{i}]", text, 0.0, "V", VOLTAGES)
        for i, (name, text) in enumerate([*((str(j), f"Voltage of motor {j}") for j in _JOINTS), ("_gripper", _GRIP)])
    ]
    payload = _input("payload", "continuous", "arm.payload", "Mass at the tip", 0.0, "kg", MASSES)
    acting = (*(f"V{j}" for j in _JOINTS), payload.name)
    return [TIME, *_arm_parameters(arm, ""), *volts, payload, *_arm_outputs("", acting)]


def controller_variables(settings: ControlSettings, layout: Layout) -> list[Variable]:
    """The variables of the controller alone.

    Args:
        settings: the values that its parameters start with.
        layout: the layout of its C unit.

    Raises:
        FunctionBlockError: a block has not the variables that the settings name.
    """
    angles = [
        _input(f"theta{j}", "discrete", f"control.theta[{j - 1}]", f"Angle {j}", 0.0, "rad", ANGLES) for j in _JOINTS
    ]
    gripper = _input("gripper", "discrete", "control.gripper", "Gripper", _OPENED, "rad", ANGLES)
    return [TIME, *_settings(settings, layout), *angles, gripper, *_box(waits=False), *_commands(layout)]


def cell_variables(arm: ArmParameters, settings: ControlSettings, layout: Layout) -> list[Variable]:
    """The variables of the arm under its controller.

    Args:
        arm: the parameters that the arm starts with.
        settings: the values that the parameters of the controller start with.
        layout: the layout of the C unit of the controller.

    Raises:
        FunctionBlockError: a block has not the variables that the settings name.
    """
    mass = _input("box_mass", "discrete", "box_mass", "Mass of the box that waits", BOX_MASS, "kg", MASSES)
    payload = Variable("payload", "Float64", "output", "discrete", "arm.payload", "Mass at the tip", unit="kg")
    parameters = [*_arm_parameters(arm, "arm."), *_settings(settings, layout)]
    return [TIME, *parameters, *_box(waits=True), mass, *_arm_outputs("arm.", ()), payload, *_commands(layout)]


def _input(
    name: str, variability: Variability, member: str, text: str, start: float, unit: str, bounds: Range
) -> Variable:
    """A real input."""
    return Variable(name, "Float64", "input", variability, member, text, start, unit, bounds=bounds)


_GRIP: Final = "Voltage of the gripper, which opens it when above 0"
_OPENED: Final = GripperParameters().opened
_SYMBOLS: Final[Mapping[str, str]] = {
    "K": "Torque of motor {} by its voltage",
    "m": "Mass of link {}",
    "I": "Moment of inertia of link {} about its centre of mass",
    "l": "Length of link {}",
    "c": "Distance of the centre of mass of link {} from its joint",
    "D": "Viscous damping of joint {}",
    "mu": "Coulomb friction of joint {}",
}


def _arm_parameters(arm: ArmParameters, prefix: str) -> Iterator[Variable]:
    def real(
        name: str, member: str, text: str, start: float, unit: str, bounds: Range, fixed: bool = False
    ) -> Variable:
        variability: Variability = "fixed" if fixed else "tunable"
        full, place = f"{prefix}{name}", f"arm.{member}"
        return Variable(full, "Float64", "parameter", variability, place, text, start, unit, bounds=bounds)

    for i, name in enumerate(PARAMETER_NAMES):
        text, bounds = _SYMBOLS[symbol_of(name)].format(name[-1]), ARM_RANGES[symbol_of(name)]
        yield real(name, f"p[{i}]", text, arm.get(name), unit_of(name), bounds)
    text = "Velocity over which mu changes sign"
    yield real("coulomb_width", "coulomb_width", text, COULOMB_WIDTH, "rad/s", COULOMB_WIDTHS)
    name, text = f"{prefix}weight_only", "Whether a load has weight without inertia"
    yield Variable(name, "Boolean", "parameter", "tunable", "arm.weight_only", text, False)
    yield real(
        "longest_step", "longest_step", "Longest step of the integration", PHYSICS_STEP, "s", STEPS, fixed=True
    )
    gripper, of_arm = GripperParameters(), ARM_RANGES
    text = "Torque of the gripper by its voltage"
    yield real("gripper_K", "gripper_K", text, gripper.voltage_constant, "N m/V", of_arm["K"])
    yield real("gripper_D", "gripper_D", "Viscous damping of the gripper", gripper.damping, "N m s/rad", of_arm["D"])
    text = "Moment of inertia of the gripper"
    yield real("gripper_I", "gripper_inertia", text, gripper.inertia, "kg m^2", of_arm["I"])
    yield real("gripper_closed_at", "gripper_closed", "Stop of the closed gripper", gripper.closed, "rad", ANGLES)
    yield real("gripper_open_at", "gripper_opened", "Stop of the open gripper", gripper.opened, "rad", ANGLES)
    for i, angle in enumerate(HANGING):
        name, text = f"theta{i + 1}_start", f"Angle {i + 1} at the start"
        yield real(name, f"start[{i}]", text, angle, "rad", ANGLES, fixed=True)
    for i in range(3):
        name, text = f"omega{i + 1}_start", f"Velocity of joint {i + 1} at the start"
        yield real(name, f"start[{3 + i}]", text, 0.0, "rad/s", VELOCITIES, fixed=True)
    yield real("gripper_start", "gripper_start", "Gripper at the start", gripper.opened, "rad", ANGLES, fixed=True)


def _arm_outputs(prefix: str, acting: tuple[str, ...]) -> Iterator[Variable]:
    """Motion of an arm whose parameters have a prefix, and whose accelerations follow some inputs at once."""

    def real(
        name: str,
        member: str,
        text: str,
        unit: str,
        derivative_of: str = "",
        depends_on: tuple[str, ...] = (),
        starts_from: tuple[str, ...] | None = (),
    ) -> Variable:
        return Variable(
            name,
            "Float64",
            "output",
            "continuous",
            f"arm.{member}",
            text,
            None,
            unit,
            derivative_of,
            depends_on,
            starts_from,
        )

    angles, velocities = (tuple(f"{name}{j}" for j in _JOINTS) for name in ("theta", "omega"))
    for i, name in enumerate(angles):
        yield real(name, f"x[{i}]", f"Angle {i + 1}", "rad", "", (name,), (f"{prefix}{name}_start",))
    for i, name in enumerate(velocities):
        text = f"Velocity of joint {i + 1}"
        yield real(name, f"x[{3 + i}]", text, "rad/s", angles[i], (name,), (f"{prefix}{name}_start",))
    follows = (*angles, *velocities, *acting)
    for i, j in enumerate(_JOINTS):
        yield real(f"alpha{j}", f"alpha[{i}]", f"Acceleration of joint {j}", "rad/s^2", velocities[i], follows, None)
    start = f"{prefix}gripper_start"
    yield real("gripper", "gripper", "Angle of the gripper", "rad", starts_from=(start,))
    for name, text in (("closed", "Whether the gripper is closed"), ("open", "Whether the gripper is open")):
        yield Variable(
            f"gripper_is_{name}",
            "Boolean",
            "output",
            "discrete",
            f"arm.is_{name}",
            text,
            starts_from=(start, f"{prefix}gripper_{name}_at"),
        )


def _box(waits: bool) -> Iterator[Variable]:
    """The box sensor."""
    text = "Whether a box waits at the pickup point"
    yield Variable("box_present", "Boolean", "input", "discrete", "control.box_present", text, waits)
    text = "Colour of the box that waits: blue, red or green"
    yield Variable("box_colour", "String", "input", "discrete", "control.box_colour", text, "red" if waits else "")


def _commands(layout: Layout) -> Iterator[Variable]:
    """What the controller answers, and where its path is."""
    for i, name in enumerate(("V1", "V2", "V3", "V_gripper")):
        text = f"Voltage of motor {i + 1}" if i < 3 else _GRIP
        yield Variable(name, "Float64", "output", "discrete", f"control.volts[{i}]", text, unit="V")
    text = "Whether the gripper holds a box"
    yield Variable("box_gripped", "Boolean", "output", "discrete", "control.box_gripped", text)
    for name in (*PATH, HELP):
        kind, member, text = _of_block(layout, name)
        unit = "rad" if name in PATH else ""
        yield Variable(name, kind, "output", "discrete", member, text, unit=unit)


def _settings(settings: ControlSettings, layout: Layout) -> Iterator[Variable]:
    """The inputs of the blocks that hold settings, by the names of the blocks."""
    for name, value in {**settings.inputs(), **STRAIGHT.inputs()}.items():
        if isinstance(value, str):
            continue  # The colours of the places are those of the application, as a text has no fixed size in C.
        kind, member, text = _of_block(layout, name)
        start = {"Float64": float, "Int32": int, "Boolean": bool}[kind](value)
        bounds = None if kind == "Boolean" else range_of_setting(name)
        yield Variable(name, kind, "parameter", "tunable", member, text, start, bounds=bounds)


def _of_block(layout: Layout, name: str) -> tuple[Kind, str, str]:
    """The type, the member and the comment of a block's variable."""
    places = {place.name: place for place in layout.variables}
    block, _, variable = name.rpartition(".")
    node = next((node for node in layout.netlist.nodes.values() if node.name == block), None)
    if node is None or name not in places or places[name].type not in _KINDS:
        raise FunctionBlockError(f"{name}: expected a variable of type LREAL, DINT or BOOL in {SYSTEM}")
    place = places[name]
    return _KINDS[place.type], f"control.program.{place.member}", variable_at(node, variable).comment
