"""What is said to be typed next, such that it works as it is printed, and what will not work."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path

from dtwin.parameters import ArmParameters
from dtwin.run.out_of_place import out_of_place
from dtwin.task import Task
from dtwin.terminal import printable


def viewer_command(recording: Path) -> str:
    """The command that shows a recording: by its name where a shell finds it, else with where it is installed."""
    program = "dtwin"
    if shutil.which(program) is None:
        beside = Path(sys.executable).parent / program
        program = os.path.relpath(beside) if beside.is_relative_to(Path.cwd()) else str(beside)
    return shlex.join([program, "show", str(recording)])


def warn_of_places(task: Task, arm: ArmParameters) -> None:
    """Tells people before they wait for it at which places an arm will do no work.

    Args:
        task: places and boxes of the cell.
        arm: arm that works there.
    """
    for text in out_of_place(task, arm):
        warn(text)


def warn(text: str) -> None:
    """Prints a warning in one line on standard error."""
    print(printable(f"dtwin: warning: {text}"), file=sys.stderr)
