"""`dtwin bench identify`."""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from dtwin.commands.frame import JsonOption, at_least
from dtwin.controller.excitation import ExcitationController
from dtwin.emulation import peer
from dtwin.identification.data import Experiment
from dtwin.identification.estimation.estimate import Loss, identify, load_kernels
from dtwin.identification.estimation.problem import LOWER, UPPER
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import ArmParameters, symbol_of
from dtwin.terminal import print_json, print_table
from evidence.identification.standard import FREE, standard_settings

_OURS: dict[str, Loss] = {"dtwin": "adaptive", "dtwin, least squares": "gaussian"}
_PEER = "mujoco.sysid"


@dataclass(frozen=True)
class BenchIdentify(JsonOption):
    """Time the fit of 12 parameters and 3 offsets to 350 samples against mujoco.sysid at its best settings.

    The peer needs `pip install 'mujoco[sysid]'`; without it only this project's fits are timed.
    """

    rounds: int = 5
    """Number of data sets; on each all programs take turns."""
    noise: float = 0.010
    """Magnitude of the encoder noise, rad, which is noise * u with u uniform in [0, 1)."""
    seed: int = 0
    """Number of the random generator of the noise."""

    def execute(self) -> int:
        at_least("--rounds", self.rounds, 1)
        at_least("--seed", self.seed, 0)
        truth, plan, blocks = ArmParameters(), Plan(), ExcitationController()
        rig = Rig(truth, self.noise)
        load_kernels()
        seconds: dict[str, list[float]] = {}
        errors: dict[str, list[np.ndarray]] = {}
        with Console(stderr=True).status("measuring") as status:
            for number in range(self.rounds):
                status.update(f"round {number + 1} of {self.rounds}")
                experiment = rig.measure(plan, blocks, np.random.default_rng((self.seed, number)))
                for name, (values, took) in _fits(experiment, plan.payload).items():
                    seconds.setdefault(name, []).append(took)
                    errors.setdefault(name, []).append(np.array([values[n] / truth.get(n) - 1 for n in FREE]))
        report = {
            name: {
                "seconds": median(seconds[name]),
                "rms_error_percent": dict(zip(FREE, _rms_percent(errors[name]), strict=True)),
            }
            for name in seconds
        }
        ratio = median(seconds[_PEER]) / median(seconds["dtwin"]) if _PEER in seconds else None
        if self.json:
            print_json({"fits": report, "times_faster": ratio, "rounds": self.rounds})
        else:
            _print(report, ratio, self.rounds)
        return 0


def _fits(experiment: Experiment, weight: float) -> dict[str, tuple[dict[str, float], float]]:
    """Values by name and seconds of every program on the same data."""
    results = {}
    for name, loss in _OURS.items():
        settings = standard_settings(loss)
        began = time.perf_counter()
        estimate = identify([experiment], settings)
        results[name] = estimate.values, time.perf_counter() - began
    if peer.is_installed():
        bounds = {name: (LOWER[symbol_of(name)], UPPER[symbol_of(name)]) for name in FREE}
        start = np.array(experiment.start.theta)
        found = peer.fit(experiment.measured, experiment.volts, start, weight, standard_settings().known, bounds)
        results[_PEER] = dict(found.values), found.seconds
    return results


def _rms_percent(errors: list[np.ndarray]) -> list[float]:
    values: list[float] = (100 * np.sqrt(np.mean(np.square(errors), axis=0))).tolist()
    return values


def _print(report: dict[str, Any], ratio: float | None, rounds: int) -> None:
    table = Table("", *report, title=f"one fit of 12 parameters and 3 offsets to 350 samples, {rounds} data sets")
    table.add_row("median, s", *(f"{entry['seconds']:.3f}" for entry in report.values()), end_section=True)
    for name in FREE:
        table.add_row(f"RMS error {name}, %", *(f"{e['rms_error_percent'][name]:.3g}" for e in report.values()))
    console = Console()
    print_table(table)
    if ratio is None:
        console.print("mujoco.sysid is not installed: pip install 'mujoco[sysid]' to compare with it", markup=False)
    else:
        console.print(f"{ratio:.0f} times faster than mujoco.sysid on the same data", highlight=False)
