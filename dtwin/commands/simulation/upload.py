"""`dtwin upload gains|model|target|version|rollback`: other settings for the controller of a running cell."""

from __future__ import annotations

import getpass
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import tyro

from dtwin.api.live import connect
from dtwin.bus.chain.messages import JointUpload
from dtwin.bus.messages import ARM_ROLL_BACK
from dtwin.bus.twin_messages import RollBackRequest, Upload, UploadRequest
from dtwin.commands.simulation.trial import outcome
from dtwin.controller.proposed import read_settings
from dtwin.errors import ModelError, ParameterError
from dtwin.identification.store import STORE, ModelStore, open_model
from dtwin.parameters import ArmParameters, CellJoints, Gains
from dtwin.services import runfile
from dtwin.terminal import print_json


@dataclass(frozen=True, kw_only=True)
class _Request:
    """Who wants a change of the settings, why, and in which cell."""

    why: str
    """Reason, for the history."""
    who: str = ""
    """Name, for the history; the login name if not given."""
    cell: str = "cell"
    """Name of the cell."""
    zenoh: Path | None = None
    """Zenoh configuration file, for a cell on another machine."""


@dataclass(frozen=True, kw_only=True)
class RollBack(_Request):
    """Put the settings before those on trial into force again, at once and without a check: they were in force."""

    def execute(self) -> int:
        with connect(self.cell, zenoh=self.zenoh) as cell:
            if runfile.has_other_arm(self.cell, self.zenoh):
                request = RollBackRequest(self.who or getpass.getuser(), self.why)
                print_json(cell.bus.ask(ARM_ROLL_BACK, request, JointUpload))
            else:
                print_json(cell.roll_back(self.why, who=self.who or None))
        return 0


@dataclass(frozen=True, kw_only=True)
class UploadCommand(_Request):
    """Options and course of every upload."""

    based_on: int | None = None
    """Version of the settings that you have seen; those in force if not given. An old version is refused."""
    arm: str | None = None
    """Identified model that takes the arm's place in the check, a file or a name in --store."""
    store: Path = STORE
    """Folder of the kept models."""
    wait: bool = False
    """Wait for the trial; the exit status is 1 when the settings are rolled back."""

    def execute(self) -> int:
        with connect(self.cell, zenoh=self.zenoh) as cell:
            now = cell.settings()
            request = UploadRequest(
                who=self.who or getpass.getuser(),
                why=self.why,
                based_on=now.version if self.based_on is None else self.based_on,
                arm=None if self.arm is None else self._model(self.arm),
            )
            return outcome(cell.send(self.change(request, now)), cell.settings, self.wait)

    def change(self, request: UploadRequest, now: Upload) -> UploadRequest:
        """The request with what shall change."""
        raise NotImplementedError

    def _model(self, reference: str) -> ArmParameters:
        model = open_model(reference, ModelStore(self.store))
        if doubts := model.validity.doubts:
            print(f"dtwin: model {reference} is in doubt: {doubts}", file=sys.stderr)
        return model.arm


class SavedSettings(msgspec.Struct, frozen=True):
    """What `dtwin optimise --save` writes."""

    gains: Gains
    target_time: float | None = None


@dataclass(frozen=True, kw_only=True)
class UploadGains(UploadCommand):
    """Upload gains, those not given stay: from here, from a file that dtwin optimise saved, or from a record."""

    kp: CellJoints | None = None
    """Proportional gains of joints 1 to 3, 1/s^2."""
    ki: CellJoints | None = None
    """Integral gains, 1/s^3."""
    kd: CellJoints | None = None
    """Derivative gains, 1/s."""
    file: Path | None = None
    """JSON file of dtwin optimise; its target time is uploaded too."""
    commissioned: Path | None = None
    """Record of the arm that dtwin commission wrote, with the gains that it proposes."""

    def change(self, request: UploadRequest, now: Upload) -> UploadRequest:
        if self.file is not None and self.commissioned is not None:
            raise ParameterError("--commissioned: expected no --file beside it")
        tuning = SavedSettings(now.gains) if self.file is None else _read(self.file)
        if self.commissioned is not None:
            tuning = SavedSettings(read_settings(self.commissioned).gains)
        given = {name: value for name in ("kp", "ki", "kd") if (value := getattr(self, name)) is not None}
        gains = replace(tuning.gains, **given)
        return msgspec.structs.replace(request, gains=gains, target_time=tuning.target_time)


@dataclass(frozen=True, kw_only=True)
class UploadTarget(UploadCommand):
    """Upload how long every motion takes, from the next one on."""

    time: float
    """s"""

    def change(self, request: UploadRequest, now: Upload) -> UploadRequest:
        return msgspec.structs.replace(request, target_time=self.time)


@dataclass(frozen=True, kw_only=True)
class UploadModel(UploadCommand):
    """Upload an identified model of the arm."""

    model: str | None = None
    """File of an identified model, or its name in --store."""
    commissioned: Path | None = None
    """Record of the arm that dtwin commission wrote, with the model that it proposes."""

    def change(self, request: UploadRequest, now: Upload) -> UploadRequest:
        if self.commissioned is not None and self.model is None:
            model = read_settings(self.commissioned).model
        elif self.model is not None and self.commissioned is None:
            model = self._model(self.model)
        else:
            raise ParameterError("expected either --model or --commissioned")
        return msgspec.structs.replace(request, model=model)


@dataclass(frozen=True, kw_only=True)
class UploadVersion(UploadCommand):
    """Upload the settings of an earlier version, as dtwin history shows them; checked and tried like new ones."""

    version: tyro.conf.Positional[int]
    """Number of the version. What differs must be gains and target time or the model: both are two messages."""

    def change(self, request: UploadRequest, now: Upload) -> UploadRequest:
        return msgspec.structs.replace(request, version=self.version)


def _read(path: Path) -> SavedSettings:
    try:
        return msgspec.json.decode(path.read_bytes(), type=SavedSettings)
    except OSError as error:
        raise ModelError(f"{path}: {error.strerror}") from None
    except msgspec.MsgspecError as error:
        raise ModelError(f"{path}: expected gains as dtwin optimise saves them: {error}") from None
