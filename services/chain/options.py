"""What the services of a cell of another arm are told of it, declared once; all of them make the same run of it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dtwin.run.arm_cell import LONGEST, ArmCell
from dtwin.run.chain import ChainSettings


@dataclass(frozen=True, kw_only=True)
class ArmCellOptions:
    """The arm, what it really is and what it does."""

    kind: str
    """Name of arms/, the arm's file or its model."""
    machine: str
    """ideal, nominal, a number or a machine's file (*.toml)."""
    poses: Path | None = None
    """TOML file of the poses that it takes."""
    path: Path | None = None
    """CSV file of a path that it follows."""
    sort: Path | None = None
    """TOML file of a sorting task."""
    late: int = 0
    """Ticks from a command until it acts."""
    fault: tuple[str, ...] = ()
    """What is otherwise than the machine says, and when, such as K2*=0.8@30; repeatable."""
    seed: int = 0
    """Number of the generators of noise, boxes and poses."""

    def settings(self, seed: int | None = None) -> ChainSettings:
        """The run that the options stand for, with that seed for noise and boxes if one is given.

        Raises:
            DtwinError: a file cannot be used, or a value is out of range.
        """
        cell = ArmCell(
            arm=self.kind,
            machine=self.machine,
            poses=self.poses,
            path=self.path,
            sort=self.sort,
            late=self.late,
            faults=self.fault,
        )
        return cell.settings(LONGEST, self.seed if seed is None else seed)
