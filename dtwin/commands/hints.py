"""What is said to be typed next, such that it works as it is printed."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from pathlib import Path


def viewer_command(recording: Path) -> str:
    """The command that shows a recording: by its name where a shell finds it, else with where it is installed."""
    program = "dtwin"
    if shutil.which(program) is None:
        beside = Path(sys.executable).parent / program
        program = os.path.relpath(beside) if beside.is_relative_to(Path.cwd()) else str(beside)
    return shlex.join([program, "show", str(recording)])
