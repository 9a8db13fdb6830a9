"""`dtwin bench start` and `dtwin bench services`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

from rich.console import Console
from rich.table import Table

from dtwin.commands.frame import JsonOption, at_least
from dtwin.errors import ParameterError
from dtwin.services.parts.pace import Pace
from dtwin.terminal import print_json, print_table
from evidence.bench.load import ALL, TICK, CellLoad, Measured, measure_load, medians
from evidence.bench.start import KILLED, measure_start


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


@dataclass(frozen=True)
class BenchServices(JsonOption):
    """Measure what each service of a running cell takes of a core and of the memory; medians of several runs."""

    seconds: float = 60.0
    """Length of a measurement, s."""
    runs: int = 1
    """Number of cells that are started and measured."""
    settling: float = 30.0
    """Time from when a cell is ready until it is measured, s; memory settles in ten minutes."""
    bare: bool = False
    """Start emulator, bridge and controller alone."""
    record: bool = False
    """Write a recording too, and tell by how much it grows."""
    pace: Pace = "realtime"
    """Pace of the cell; in lockstep the speed counts."""
    against: Path | None = None
    """Folder of another checkout, whose cells are measured in turn with those of this one."""

    def execute(self) -> int:
        at_least("--runs", self.runs, 1)
        if not self.seconds > 0 or not self.settling >= 0:
            raise ParameterError("--seconds, --settling: expected a time above 0 s, and one of at least 0 s")
        here = Measured(
            seconds=self.seconds,
            settling=self.settling,
            options=(*(() if self.bare else ALL), "--pace", self.pace),
            record=self.record,
        )
        cells = {"here": here}
        if self.against is not None:
            cells["against"] = replace(here, checkout=self.against.resolve())
        runs: dict[str, list[CellLoad]] = {name: [] for name in cells}
        with Console(stderr=True).status("measuring") as status:
            for number in range(self.runs):
                for name, measured in cells.items():
                    status.update(f"measuring {name}, run {number + 1} of {self.runs}")
                    runs[name].append(measure_load(measured))
        if self.json:
            print_json(
                {
                    name: {"medians": medians(found), "runs": found, "tick": ticks(found)}
                    for name, found in runs.items()
                }
            )
            return 0
        for name, found in runs.items():
            print_table(_load_table(name, found))
        return 0


def ticks(runs: Sequence[CellLoad]) -> float:
    """Median of what the services that hand on every tick take together, % of a core."""
    return median(load.tick for load in runs)


def _load_table(name: str, runs: Sequence[CellLoad]) -> Table:
    load, latency = medians(runs), medians(runs).latency_ms
    table = Table(
        "service",
        "% of a core",
        "wake-ups, 1/s",
        "threads",
        "memory, MB",
        "growth, MB",
        title=f"{name}: medians of {len(runs)} runs",
        caption=(
            f"latency {latency.p50:.2f} ms, 99 % {latency.p99:.2f} ms; late ticks {load.late_ticks:g}; "
            f"{load.real_time_factor:.2f} x real time; recording {load.recording:.2f} MB a minute"
        ),
    )
    for service, used in load.services.items():
        table.add_row(
            service,
            f"{used.processor:.2f}",
            f"{used.wakes:.0f}",
            f"{used.threads:.0f}",
            f"{used.memory:.0f}",
            f"{used.memory - used.memory_before:.1f}",
        )
    table.add_row(", ".join(TICK), f"{ticks(runs):.2f}", "", "", "", "")
    return table
