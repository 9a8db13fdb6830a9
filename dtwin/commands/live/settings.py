"""`dtwin gains|model|target set`: uploads of single values, for which an operator need not give a reason."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dtwin.commands.simulation.upload import UploadCommand, UploadGains, UploadTarget
from dtwin.parameters import load_arm


@dataclass(frozen=True, kw_only=True)
class GainsSet(UploadGains):
    """Set gains of the running controller, checked and on trial; those not given stay.

    Prints what is in force then.
    """

    why: str = "by hand"
    """Reason, for the history."""


@dataclass(frozen=True, kw_only=True)
class ModelSet(UploadCommand):
    """Set the arm model of the running controller, checked and on trial; values not given stay.

    Prints what is in force then.
    """

    why: str = "by hand"
    """Reason, for the history."""
    file: Path | None = None
    """JSON object of parameter names and numbers, e.g. {"m1": 0.12}."""
    set: tuple[str, ...] = ()
    """One parameter, e.g. m1=0.12; repeatable."""

    def change(self) -> dict[str, Any]:
        return {"model": None if self.file is None else load_arm(self.file), "set": self.set}


@dataclass(frozen=True, kw_only=True)
class TargetSet(UploadTarget):
    """Set how long every motion takes, from the next one on; checked and on trial. Prints what is in force then."""

    why: str = "by hand"
    """Reason, for the history."""
