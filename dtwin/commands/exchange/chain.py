"""`dtwin fmu ... --arm NAME`: twin, controller and cell of any serial arm."""

from __future__ import annotations

from dataclasses import MISSING, fields
from typing import Any, Final

from dtwin.api.arms import write_fmu_arm
from dtwin.commands.cell.chain import THESIS
from dtwin.commands.frame import arguments_as_options
from dtwin.errors import ParameterError, choices
from dtwin.run.arm_cell import arm_cell_of

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
    given: dict[str, Any] = {name: getattr(options, name, None) for name in ("machine", *_TASK)}
    with arguments_as_options(options):
        if options.arm != THESIS:
            write_fmu_arm(options.file, options.arm, options.subject, fmi=options.fmi, **given)
        else:
            write_fmu_arm(options.file, subject=options.subject, fmi=options.fmi, cell_file=file, **given)
    return True


def _refuse_others(options: Any) -> None:
    known = [field.name for field in fields(options) if field.name in _KNOWN and field.name not in ("arm", "file")]
    for field in fields(options):
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in _KNOWN and getattr(options, field.name) != default:
            said = choices(f"--{name.replace('_', '-')}" for name in known)
            raise ParameterError(
                f"--{field.name.replace('_', '-')}: has no meaning for another arm than the thesis's: expected {said}"
            )
