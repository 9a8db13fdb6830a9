"""`dtwin bench`."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
from rich.console import Console
from rich.table import Table

from dtwin.errors import ParameterError
from dtwin.experiments.benchmark import benchmark


@dataclass(frozen=True)
class Bench:
    """Measure raw MuJoCo steps, the closed loop, the twin's rollout and the controller; medians of several rounds."""

    json: bool = False
    """Print one JSON object on standard output and nothing else."""
    rounds: int = 5
    """How often each part is measured; the parts take turns."""

    def execute(self) -> int:
        if self.rounds < 1:
            raise ParameterError(f"--rounds: expected at least 1, got {self.rounds}")
        with Console(stderr=True).status("measuring") as status:
            result = benchmark(self.rounds, lambda name: status.update(f"measuring {name}"))
        if self.json:
            print(msgspec.json.encode(result).decode())
            return 0
        table = Table("part", "measure", "median", title=f"medians of {self.rounds} rounds")
        for part, measures in result.items():
            for k, (name, value) in enumerate(measures.items()):
                table.add_row(
                    part if k == 0 else "",
                    name.replace("_", " "),
                    f"{value:,.3g}" if value < 100 else f"{value:,.0f}",
                )
        Console().print(table)
        return 0
