"""`dtwin upload gains|model|target|version|rollback`: other settings for the controller of a running cell."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tyro

from dtwin.api.live import connect
from dtwin.commands.simulation.trial import outcome
from dtwin.controller.proposed import read_settings
from dtwin.errors import ParameterError
from dtwin.identification.store import STORE
from dtwin.parameters import CellJoints
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
        who = self.who or None
        if runfile.has_other_arm(self.cell, self.zenoh):
            from dtwin.api.arm.live import connect_arm  # Uploads to the thesis's arm need no models of others.

            with connect_arm(self.cell, zenoh=self.zenoh) as arm:
                print_json(arm.roll_back_arm(self.why, who=who))
        else:
            with connect(self.cell, zenoh=self.zenoh) as cell:
                print_json(cell.roll_back(self.why, who=who))
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
            answer = cell.upload(
                **self.change(),
                arm=self.arm,
                store=self.store,
                based_on=self.based_on,
                why=self.why,
                who=self.who or None,
            )
            return outcome(answer, cell.settings, self.wait)

    def change(self) -> dict[str, Any]:
        """What shall change, as arguments of LiveCell.upload."""
        raise NotImplementedError


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

    def change(self) -> dict[str, Any]:
        if self.file is not None and self.commissioned is not None:
            raise ParameterError("--commissioned: expected no --file beside it")
        given = {"kp": self.kp, "ki": self.ki, "kd": self.kd}
        if self.commissioned is None:
            return {"gains": self.file, **given}
        proposed = read_settings(self.commissioned)
        return {"gains": proposed.gains, "law": proposed.law, **given}


@dataclass(frozen=True, kw_only=True)
class UploadTarget(UploadCommand):
    """Upload how long every motion takes, from the next one on."""

    time: float
    """s"""

    def change(self) -> dict[str, Any]:
        return {"target_time": self.time}


@dataclass(frozen=True, kw_only=True)
class UploadModel(UploadCommand):
    """Upload an identified model of the arm."""

    model: str | None = None
    """File of an identified model, or its name in --store."""
    commissioned: Path | None = None
    """Record of the arm that dtwin commission wrote, with the model that it proposes."""

    def change(self) -> dict[str, Any]:
        if (self.model is None) == (self.commissioned is None):
            raise ParameterError("expected either --model or --commissioned")
        return {"model": self.model if self.commissioned is None else read_settings(self.commissioned).model}


@dataclass(frozen=True, kw_only=True)
class UploadVersion(UploadCommand):
    """Upload the settings of an earlier version, as dtwin history shows them; checked and tried like new ones."""

    version: tyro.conf.Positional[int]
    """Number of the version. What differs must be gains and target time or the model: both are two messages."""

    def change(self) -> dict[str, Any]:
        return {"version": self.version}
