"""`dtwin experiment clearance`: how near the arm comes to trays, belt, floor and boxes on its ways."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from rich.table import Table

from dtwin.commands.frame import JsonOption
from dtwin.controller.ports import BLOCKS
from dtwin.emulation import MODEL_FILE
from dtwin.terminal import as_text, print_json, print_table


@dataclass(frozen=True)
class ExperimentClearance(JsonOption):
    """Sweep the planned paths of the cell with contact through its geometry.

    The status is 1 if the arm touches anything on its way; a box on the belt under it does not count.
    """

    mjcf: Path = MODEL_FILE
    """MJCF file of the cell."""
    blocks: Path = BLOCKS
    """Folder of the function blocks that plan the paths."""

    def execute(self) -> int:
        from dtwin.experiments.clearance import is_free, sweep  # loads MuJoCo and numba

        legs = sweep(self.mjcf, self.blocks)
        if self.json:
            print_json(legs)
        else:
            table = Table("place", "from", "to", "box", "clearance, mm", "between")
            for leg in legs:
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
        return 0 if all(map(is_free, legs)) else 1
