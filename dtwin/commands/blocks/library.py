"""`dtwin fb check`, `export` and `deploy`: the commands of the blocks' distribution, with this project's own library
where nothing else is said."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from dtwin.controller.sequence import SequenceName, with_sequence
from dtwin.parameters import ROOT
from dtwin.run.cell_file import task_named
from iec61499 import model
from iec61499.commands import check, deploying

BLOCKS = ROOT / "fb"
SYSTEM = BLOCKS / "dtwin.sys"


@dataclass(frozen=True)
class FbCheck(check.FbCheck):
    __doc__ = check.FbCheck.__doc__

    files: tyro.conf.Positional[tuple[Path, ...]] = (BLOCKS,)
    """Types (.fbt, .fct, .sub), systems (.sys), boot files (.fboot), or folders of them; fb/ of this project if none
    is given."""


@dataclass(frozen=True)
class FbExport(deploying.FbExport):
    __doc__ = deploying.FbExport.__doc__

    system: Path = SYSTEM
    """System (.sys) that the boot files build, whose types a FORTE gets, or that is written as C."""


@dataclass(frozen=True)
class FbDeploy(deploying.FbDeploy):
    __doc__ = deploying.FbDeploy.__doc__

    system: Path | None = SYSTEM
    """System (.sys) to build, if the address is that of one device."""
    sequence: SequenceName | None = None
    """Sequence of the cell: straight in joint space, or among_bodies for a machine with contact; without it that of
    the system."""
    cell_file: str | None = None
    """Cell whose places the sequence gets: a file (*.toml), or a name of the folder cells; without it those of the
    system."""

    def adapted(self, system: model.System) -> model.System:
        return with_sequence(system, self.sequence, task_named(self.cell_file))
