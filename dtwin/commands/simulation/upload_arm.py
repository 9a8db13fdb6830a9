"""`dtwin upload arm`: another model or tuning for the running blocks of an arm that is not the thesis's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from dtwin.api.arm.live import connect_arm
from dtwin.commands.frame import arguments_as_options
from dtwin.commands.simulation.trial import outcome


@dataclass(frozen=True, kw_only=True)
class UploadArm:
    """Give the blocks of a running arm another model, gains or speed; tried on the twin and then on the arm.

    Needs `dtwin up --arm NAME --simulation`.
    """

    file: Annotated[str | None, tyro.conf.Positional] = None
    """Arm whose model it is: a file (*.toml), as dtwin identify live or dtwin identify --arm-out has kept it, or a
    name of arms/."""
    version: int | None = None
    """Version of the history whose settings shall be in force again, instead of anything else."""
    pole: float | None = None
    """The threefold pole of the errors of every joint, rad/s; as it is if not given."""
    observer: float | None = None
    """Double pole of the observers, rad/s; as it is if not given."""
    speed: float | None = None
    """Speeds of the paths in parts of the data sheet's; as they are if not given."""
    why: str
    """Reason, for the history."""
    who: str = ""
    """Name, for the history; the login name if not given."""
    based_on: int | None = None
    """Version of the settings that you have seen; those in force if not given. An old version is refused."""
    wait: bool = False
    """Wait for the trial; the exit status is 1 when they are rolled back."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def execute(self) -> int:
        with arguments_as_options(self), connect_arm(self.cell, zenoh=self.zenoh) as cell:
            answer = cell.upload_arm(
                model=self.file,
                pole=self.pole,
                observer=self.observer,
                speed=self.speed,
                version=self.version,
                based_on=self.based_on,
                why=self.why,
                who=self.who or None,
            )
            return outcome(answer, cell.arm_settings, self.wait)
