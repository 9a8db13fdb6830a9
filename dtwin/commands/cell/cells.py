"""`dtwin cell`: cells as files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import tyro
from rich.table import Table

from dtwin.commands.frame import JsonOption
from dtwin.parameters import ArmParameters
from dtwin.run.cell_file import DEFAULT_NAME, holding, text_of
from dtwin.run.emulate import emulate
from dtwin.run.options import PlantOptions
from dtwin.terminal import as_text, print_json, print_table, printable


@dataclass(frozen=True)
class CellShow:
    """Show the file of a cell; that of the usual one has every key. Saved and changed, it is another cell."""

    cell_file: tyro.conf.Positional[str] = DEFAULT_NAME
    """Name or file of the cell."""

    def execute(self) -> int:
        for line in text_of(self.cell_file).splitlines():
            print(printable(line))
        return 0


@dataclass(frozen=True)
class CellCheck(JsonOption):
    """Check a cell file, and tell with which angles and voltages the arm holds the heaviest box at every place."""

    cell_file: tyro.conf.Positional[str] = DEFAULT_NAME
    """Name or file of the cell."""

    def execute(self) -> int:
        options = PlantOptions(cell_file=self.cell_file)
        emulate(options.settings())
        task = options.task()
        places: dict[str, dict[str, Any]] = {
            name: {
                "x": place.x,
                "y": place.y,
                "theta": place.theta,
                "volts": holding(place.theta, ArmParameters(), task.boxes.heaviest),
            }
            for name, place in task.all_places.items()
        }
        if self.json:
            print_json(places)
            return 0
        table = Table("place", "x, m", "y, m", "angles, rad", f"volts with {task.boxes.heaviest:g} kg")
        for name, row in places.items():
            angles = ", ".join(f"{angle:.4f}" for angle in row["theta"])
            volts = ", ".join(f"{value:.1f}" for value in row["volts"])
            table.add_row(as_text(name), f"{row['x']:g}", f"{row['y']:g}", angles, volts)
        print_table(table)
        return 0
