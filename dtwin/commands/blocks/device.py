"""`dtwin fb run`: function blocks on a device, those of the cell among them."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

from dtwin.controller.sequence import SequenceName, with_sequence
from dtwin.parameters import ROOT
from dtwin.run.cell_file import task_named
from iec61499 import model
from iec61499.commands import running


@dataclass(frozen=True)
class FbRun(running.FbRun):
    __doc__ = running.FbRun.__doc__

    blocks: Path | None = None
    """Folder of the block types; without it the project of FILE, and without FILE the library of this project."""
    sequence: SequenceName | None = None
    """Sequence of the cell: straight in joint space, or among_bodies for a machine with contact. Without it that of
    FILE, which must be a system."""
    cell_file: str | None = None
    """Cell whose places the sequence gets: a file (*.toml), or a name of the folder cells; without it those of
    FILE, which must be a system."""

    def folders(self) -> list[Path]:
        return super().folders() or [ROOT / "fb"]

    def adapted(self, system: model.System) -> model.System:
        return with_sequence(system, self.sequence, task_named(self.cell_file))

    def for_systems(self) -> list[tuple[str, object]]:
        return [("--sequence", self.sequence), ("--cell-file", self.cell_file), *super().for_systems()]

    def again(self) -> list[str]:
        command = [sys.executable, "-m", "dtwin", "fb", *super().again()[3:]]
        command += ["--sequence", self.sequence] if self.sequence else []
        command += ["--cell-file", self.cell_file] if self.cell_file else []
        return command
