"""`dtwin bench`."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from dtwin.commands.frame import JsonOption, at_least
from dtwin.experiments.benchmark import benchmark
from dtwin.terminal import print_json, print_table


@dataclass(frozen=True)
class Bench(JsonOption):
    """Measure raw MuJoCo steps, the closed loop, the twin's rollout and the controller; medians of several rounds."""

    rounds: int = 5
    """Number of times that each part is measured; the parts take turns."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 1)
        with Console(stderr=True).status("measuring") as status:
            result = benchmark(self.rounds, lambda name: status.update(f"measuring {name}"))
        if self.json:
            print_json(result)
            return 0
        table = Table("part", "measure", "median", title=f"medians of {self.rounds} rounds")
        for part, measures in result.items():
            for k, (name, value) in enumerate(measures.items()):
                table.add_row(
                    part if k == 0 else "",
                    name.replace("_", " "),
                    f"{value:,.3g}" if value < 100 else f"{value:,.0f}",
                )
        print_table(table)
        return 0
