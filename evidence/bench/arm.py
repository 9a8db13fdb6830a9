"""`dtwin bench arm`."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from dtwin.arm.model import ArmModel
from dtwin.commands.frame import JsonOption, at_least
from dtwin.emulation.chain.machine import NOMINAL
from dtwin.emulation.chain.steps.raw import raw_chain_ticks, replayed_chain
from dtwin.equations.native import NativeChain
from dtwin.run.arm_cell import ArmCell
from dtwin.run.chain import ChainSettings, run
from dtwin.run.margins.chain import margins
from dtwin.simulation.chain.simulator import POSES, ArmSimulator
from dtwin.simulation.chain.whatif import ArmChange
from dtwin.terminal import print_json, print_table

WHAT_IF: Final = 4.0
"""Length of the motion of a what-if, s."""
SPAN: Final = 60.0
"""Plant time of the runs, s."""
_STATES: Final = 10_000


@dataclass(frozen=True)
class BenchArm(JsonOption):
    """Measure the speed of the parts of any serial arm: its equations, a what-if, its margins, and its closed loop
    with a log, beside MuJoCo alone on its model without a motion, and beside its plant alone in the same motion."""

    arm: str = "six-axis"
    """Name of an arm or its file."""
    rounds: int = 5
    """Number of turns; the least time counts, as other work on the machine only adds to it."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 1)
        settings = ArmCell(arm=self.arm, machine=NOMINAL).settings(SPAN)
        parts = _parts(settings)
        for part in parts.values():
            part()
        seconds: dict[str, list[float]] = {name: [] for name in parts}
        with Console(stderr=True).status("measuring"):
            for _ in range(self.rounds):
                for name, part in parts.items():
                    began = time.thread_time()
                    part()
                    seconds[name].append(time.thread_time() - began)
        figures = {
            "forward_dynamics_microseconds": 1e6 * min(seconds["dynamics"]) / _STATES,
            "what_if_milliseconds": 1e3 * min(seconds["what-if"]),
            "margins_milliseconds": 1e3 * min(seconds["margins"]),
            "closed_loop_of_plant_alone": _ratio(seconds, "plant"),
            "closed_loop_of_plant_in_the_same_motion": _ratio(seconds, "same motion"),
            "closed_loop_real_time_factor": SPAN / min(seconds["closed loop"]),
        }
        if self.json:
            print_json({"arm": self.arm, **figures})
            return 0
        table = Table("part", "figure")
        for name, value in figures.items():
            table.add_row(name.replace("_", " "), f"{value:.3g}")
        print_table(table)
        return 0


def _ratio(seconds: dict[str, list[float]], of: str) -> float:
    return min(seconds[of]) / min(seconds["closed loop"])


def _parts(settings: ChainSettings) -> dict[str, Callable[[], object]]:
    arm, start = settings.arm, settings.poses.positions[0]
    chain, simulator = NativeChain(arm), ArmSimulator(settings, ArmModel.of(arm))
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, _STATES, len(arm)))
    plant, ticks = raw_chain_ticks(settings.machine, start), round(SPAN / arm.period)
    return {
        "dynamics": lambda: chain.forward_dynamics(*states),
        "what-if": lambda: simulator.run(start, ArmChange(), WHAT_IF),
        "margins": lambda: margins(arm, settings.control, POSES, late=settings.late),
        "plant": lambda: plant(ticks),
        "same motion": replayed_chain(settings.machine, start, run(settings).command),
        "closed loop": lambda: run(settings),
    }
