"""`dtwin upload arm`: another model or tuning for the running blocks of an arm that is not the thesis's."""

from __future__ import annotations

import getpass
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Final

import tyro

from dtwin.arm.model import ArmModel
from dtwin.bus.chain.messages import JointUpload, JointUploadRequest
from dtwin.bus.messages import ARM_UPLOAD
from dtwin.bus.session import Bus
from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import CommunicationError, ParameterError
from dtwin.services.runfile import join
from dtwin.terminal import print_json

_LOOK: Final = 0.2
"""Time between two looks at a trial, s."""
_PATIENCE: Final = 120.0
"""Time for a trial to end, s."""


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
    """Triple pole of the errors of every joint, rad/s; as it is if not given."""
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
        given = {name: value for name in ("pole", "observer", "speed") if (value := getattr(self, name)) is not None}
        if (self.file is None and not given) == (self.version is None):
            raise ParameterError("upload arm: expected a file, --pole, --observer or --speed, or --version alone")
        model = None if self.file is None else ArmModel.of(arm_of(self.file))
        with join(self.cell, self.zenoh) as bus:
            now = bus.ask(ARM_UPLOAD, None, JointUpload)
            based_on = now.version if self.based_on is None else self.based_on
            tuning = replace(now.tuning, **given) if given else None
            who = self.who or getpass.getuser()
            request = JointUploadRequest(who, self.why, based_on, model, self.version, tuning)
            answer = bus.ask(ARM_UPLOAD, request, JointUpload)
            print_json(answer)
            return self._outcome(bus, answer) if self.wait else 0

    def _outcome(self, bus: Bus, answer: JointUpload) -> int:
        """Waits until the trial is over."""
        deadline = time.monotonic() + _PATIENCE
        while answer.on_trial:
            if time.monotonic() > deadline:
                raise CommunicationError(f"the trial of version {answer.version} goes on after {_PATIENCE:g} s")
            time.sleep(_LOOK)
            answer = bus.ask(ARM_UPLOAD, None, JointUpload)
        print_json(answer)
        return 0 if answer.action == "confirm" else 1
