"""`dtwin fmu ... --arm NAME`: twin, controller and cell of any serial arm."""

from __future__ import annotations

from dataclasses import MISSING, fields, replace
from typing import Any, Final

from dtwin.arm.chain import Arm, Friction
from dtwin.commands.cell.chain import THESIS
from dtwin.emulation.chain.arms import arm_of
from dtwin.emulation.chain.machine import NOMINAL, machine_of
from dtwin.errors import ParameterError, choices
from dtwin.fmu.chain import write_chain_fmu
from dtwin.run.arm_cell import ArmCell, arm_cell_of
from dtwin.run.chain import ChainSettings

_DURATION: Final = 10.0
"""Plant time of the run whose settings a controller gets, s; it has none of its own."""
_TASK: Final = ("poses", "path", "sort")
_KNOWN: Final = ("arm", "cell_file", "file", "fmi", "machine", *_TASK)
"""Options that mean something for any arm."""


def write_arm(options: Any) -> bool:
    """Writes the FMU of another arm than the thesis's; False where the options name none.

    Args:
        options: those of a command `dtwin fmu`.

    Raises:
        ParameterError: an option has no meaning for this arm.
        ModelError: the file of the arm or of the cell cannot be used.
        NativeError: there is no C compiler. RecordingError: the file cannot be written.
    """
    file = getattr(options, "cell_file", None)
    cell = None if file is None else arm_cell_of(file)
    if cell is None and options.arm == THESIS:
        for name in ("machine", *_TASK):
            if getattr(options, name, None) is not None:
                raise ParameterError(f"--{name}: expected --arm with another arm than the thesis's")
        return False
    _refuse_others(options)
    cell = ArmCell(arm=options.arm, machine=NOMINAL) if cell is None or options.arm != THESIS else cell
    if options.subject == "twin":
        write_chain_fmu(options.file, "twin", options.fmi, _real(arm_of(cell.arm), options.machine or NOMINAL))
        return True
    settings = _settings(cell, options)
    machine = getattr(options, "machine", None) or cell.machine
    arm = settings.arm if options.subject == "controller" else _real(settings.arm, machine)
    write_chain_fmu(
        options.file,
        options.subject,
        options.fmi,
        arm,
        known=settings.arm,
        poses=settings.poses,
        control=settings.control,
    )
    return True


def _settings(cell: ArmCell, options: Any) -> ChainSettings:
    given = {name: getattr(options, name) for name in _TASK}
    if any(each is not None for each in given.values()):
        cell = replace(cell, **given)
    if cell.late or cell.faults:
        raise ParameterError("late, faults: expected none of them, as an FMU has neither")
    return cell.settings(_DURATION)


def _real(arm: Arm, machine: str) -> Arm:
    """What an arm really is, without dry friction where it is ideal.

    Raises:
        ParameterError: its gears yield.
    """
    found = machine_of(machine, arm)
    if yielding := [joint.name for joint in found.arm.joints if joint.transmission is not None]:
        raise ParameterError(
            f"--machine {machine}: the gears of {' and '.join(yielding)} yield, and an FMU takes motor "
            "and joint for one: expected --machine ideal, or a machine without gear_stiffness"
        )
    if found.friction:
        return found.arm
    joints = (replace(joint, friction=Friction(joint.friction.viscous)) for joint in found.arm.joints)
    return replace(found.arm, joints=tuple(joints))


def _refuse_others(options: Any) -> None:
    known = [field.name for field in fields(options) if field.name in _KNOWN and field.name not in ("arm", "file")]
    for field in fields(options):
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in _KNOWN and getattr(options, field.name) != default:
            said = choices(f"--{name.replace('_', '-')}" for name in known)
            raise ParameterError(
                f"--{field.name.replace('_', '-')}: has no meaning for another arm than the thesis's: expected {said}"
            )
