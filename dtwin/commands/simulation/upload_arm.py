"""`dtwin upload arm`: another model for the running blocks of an arm that is not the thesis's."""

from __future__ import annotations

import getpass
import time
from dataclasses import dataclass
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
    """Let the blocks of a running arm reckon with another model; it is checked on the twin and tried on the arm.

    Needs `dtwin up --arm NAME --simulation`.
    """

    file: Annotated[str | None, tyro.conf.Positional] = None
    """Arm whose model it is: a file (*.toml), as dtwin identify live or dtwin identify --arm-out has kept it, or a
    name of arms/."""
    version: int | None = None
    """Version of the history whose model shall be in force again, instead of a file."""
    why: str
    """Reason, for the history."""
    who: str = ""
    """Name, for the history; the login name if not given."""
    based_on: int | None = None
    """Version of the model that you have seen; that in force if not given. An old version is refused."""
    wait: bool = False
    """Wait for the trial; the exit status is 1 when the model is rolled back."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""

    def execute(self) -> int:
        if (self.file is None) == (self.version is None):
            raise ParameterError("upload arm: expected either a file or --version")
        model = None if self.file is None else ArmModel.of(arm_of(self.file))
        with join(self.cell, self.zenoh) as bus:
            now = bus.ask(ARM_UPLOAD, None, JointUpload).version if self.based_on is None else self.based_on
            request = JointUploadRequest(self.who or getpass.getuser(), self.why, now, model, self.version)
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
