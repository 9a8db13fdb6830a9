"""`dtwin bench start`."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from rich.console import Console

from dtwin.commands.frame import JsonOption, at_least, print_json
from dtwin.experiments.start import KILLED, measure_start


@dataclass(frozen=True)
class BenchStart(JsonOption):
    """Time the start of a cell with all services and the way back of killed ones; medians of several starts."""

    rounds: int = 5
    """Number of starts."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 1)
        starts = [measure_start() for _ in range(self.rounds)]
        result = {
            "ready_s": median(start.ready_s for start in starts),
            "memory_mb": median(sum(start.memory_mb.values()) for start in starts),
            "supervisor_mb": median(start.resident_mb["supervisor"] for start in starts),
            **{f"{name}_again_s": median(start.again_s[name] for start in starts) for name in KILLED},
        }
        if self.json:
            print_json(result)
        else:
            for name, value in result.items():
                Console().print(f"{name.replace('_', ' ')} {value:.3g}", highlight=False)
        return 0
