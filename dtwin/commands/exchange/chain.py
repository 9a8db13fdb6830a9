"""`dtwin fmu ... --arm NAME`: twin, controller and cell of any serial arm."""

from __future__ import annotations

from typing import Any, Final

from dtwin.api.arms import write_fmu_arm
from dtwin.commands.cell.chain import THESIS
from dtwin.commands.frame import arguments_as_options
from dtwin.errors import ParameterError
from dtwin.options import refuse_others
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
    refuse_others(options, _KNOWN, ("arm", "file"))
    given: dict[str, Any] = {name: getattr(options, name, None) for name in ("machine", *_TASK)}
    with arguments_as_options(options):
        if options.arm != THESIS:
            write_fmu_arm(options.file, options.arm, options.subject, fmi=options.fmi, **given)
        else:
            write_fmu_arm(options.file, subject=options.subject, fmi=options.fmi, cell_file=file, **given)
    return True
