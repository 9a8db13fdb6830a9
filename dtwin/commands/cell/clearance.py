"""`dtwin experiment clearance`: how near the arm comes to trays, belt, floor and boxes on its ways."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import msgspec

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import ExperimentCommand
from dtwin.controller.ports import BLOCKS
from dtwin.emulation import MODEL_FILE
from dtwin.experiments.clearance import Clearances, clearance_report, clearances, keeps_clear
from dtwin.experiments.report import Report


@dataclass(frozen=True)
class ExperimentClearance(ExperimentCommand[Clearances]):
    """Sweep the planned paths of the cell with contact through its geometry, also those from 300 random free poses.

    The status is 1 if the arm touches anything on its way; a box on the belt under it does not count.
    """

    name: ClassVar = "clearance"

    mjcf: Path = MODEL_FILE
    """MJCF file of the cell."""
    blocks: Path = BLOCKS
    """Folder of the function blocks that plan the paths."""

    def measure(self, progress: Progress) -> Clearances:
        return clearances(self.mjcf, self.blocks, self.seed)

    def report(self, result: Clearances) -> Report:
        return clearance_report(result)

    def figures(self, result: Clearances) -> dict[str, Any]:
        found: dict[str, Any] = msgspec.to_builtins(result)
        return found

    def passed(self, result: Clearances) -> bool:
        return keeps_clear(result)
