"""`dtwin experiment clearance`: how near the arm comes to trays, belt, floor and boxes on its ways."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from dtwin.commands.frame import JsonOption
from dtwin.controller.ports import BLOCKS
from dtwin.emulation import MODEL_FILE
from dtwin.terminal import as_text, print_json, print_table

if TYPE_CHECKING:
    from dtwin.experiments.clearance import StartUps


@dataclass(frozen=True)
class ExperimentClearance(JsonOption):
    """Sweep the planned paths of the cell with contact through its geometry, also those from 300 random free poses.

    The status is 1 if the arm touches anything on its way; a box on the belt under it does not count.
    """

    mjcf: Path = MODEL_FILE
    """MJCF file of the cell."""
    blocks: Path = BLOCKS
    """Folder of the function blocks that plan the paths."""
    seed: int = 0
    """Number of the random generator of poses."""

    def execute(self) -> int:
        from dtwin.experiments.clearance import clearances, is_free  # loads MuJoCo and numba

        found = clearances(self.mjcf, self.blocks, self.seed)
        if self.json:
            print_json(found)
        else:
            table = Table("place", "from", "to", "box", "clearance, mm", "between")
            for leg in found.legs:
                names = f"{leg.arm} and {leg.other}" if leg.other else "nothing within reach"
                row = (
                    leg.place,
                    leg.start,
                    leg.end,
                    "held" if leg.carries else "",
                    f"{1000 * leg.distance:.1f}",
                    names,
                )
                table.add_row(*map(as_text, row))
            print_table(table)
            for name, ups in (("random", found.random), ("hanging", found.hanging)):
                print(f"start from {ups.poses} {name} poses: {_told(ups)}")
        touching = found.random.touching + found.hanging.touching
        return 0 if all(map(is_free, found.legs)) and not touching else 1


def _told(ups: StartUps) -> str:
    """What became of the starts, in words."""
    nearest = f"{1000 * ups.distance:.1f} mm between {ups.arm} and {ups.other}"
    return (
        f"{ups.free} on a free way, {ups.helpless} call for help, {ups.touching} touch something; nearest {nearest}"
    )
