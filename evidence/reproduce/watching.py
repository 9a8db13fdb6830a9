"""Figures 5.13 to 5.17: how fast the monitors can be, and the failure of a motor."""

from __future__ import annotations

import math
import time as wall
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.emulation.faults import parse_fault
from dtwin.monitoring.estimation.belief import assumed
from dtwin.monitoring.monitor import Monitor
from dtwin.monitoring.offline import Stream, stream
from dtwin.monitoring.thesis import ABSOLUTE, IN_A_ROW, ThesisMonitor, ThesisSettings
from dtwin.parameters import PERIOD, ArmParameters
from dtwin.pictures import COLOURS, DARK, RED, legend, new_figure
from dtwin.run.cell import Cell
from dtwin.run.settings import CellSettings
from evidence.monitoring.failure import FAULT, START, failure_experiment
from evidence.report import Picture
from evidence.reproduce.chapter import Chapter, Line, Part, Scope

STEPS: Final = (0.001, 0.002, 0.0025, 0.005, 0.010)
"""Steps of the thesis's simulation, with samples every second, s."""
SAMPLE_TIMES: Final = (0.010, 0.100, 0.500, 1.000)
"""The thesis's sample times, with steps of 5 ms, s."""
NOISE: Final = 0.001
"""Magnitude of the encoder noise in the failure test, rad."""
_WATCHED: Final = 60.0
_FAILING: Final = 75.0
_SHOWN: Final = ((0.002, 1.0), (0.005, 1.0), (0.005, 0.010), (0.005, 0.100))
"""Step and sample time of the combinations that the thesis draws, s."""


def _name(step: float, sample_time: float) -> str:
    return f"{1e3 * step:g} ms, {1e3 * sample_time:g} ms"


def _limits(scope: Scope, progress: Progress) -> dict[str, Any]:
    cell = Cell(CellSettings(_WATCHED, scope.seed))
    cell.run()
    seen = stream(cell.log.freeze())
    combinations = [*((step, 1.0) for step in STEPS), *((0.005, sample) for sample in SAMPLE_TIMES if sample < 1.0)]
    followed, share = {}, {}
    for done, (step, sample_time) in enumerate(combinations):
        progress(done, len(combinations) + 1)
        began = wall.process_time()
        followed[_name(step, sample_time)] = _followed(seen, step, sample_time)
        share[_name(step, sample_time)] = (wall.process_time() - began) / _WATCHED
    monitor = Monitor(assumed(ArmParameters(), (1e-6, 1e-6, 1e-6)))
    seen.feed(monitor, 0, 2)
    began = wall.process_time()
    seen.feed(monitor, 2, len(seen))
    share["default"] = (wall.process_time() - began) / _WATCHED
    return {"followed": followed, "share": share}


def _followed(seen: Stream, step: float, sample_time: float, arm: ArmParameters | None = None) -> dict[str, Any]:
    """What the thesis's monitor simulates at its samples, link by link, beside what is measured."""
    monitor, every = (
        ThesisMonitor(arm or ArmParameters(), ThesisSettings(sample_time, step)),
        round(sample_time / PERIOD),
    )
    simulated = np.empty((len(seen), 3))
    for row in range(len(seen)):
        seen.feed(monitor, row, row + 1)
        simulated[row] = monitor.simulated
    at = np.arange(0, len(seen), max(every, len(seen) // 750))
    return {
        "difference": float(np.abs(simulated - seen.measured)[::every].max()),
        "failed": [None if math.isnan(when) else when for when in monitor.failed.tolist()],
        "time": np.round(PERIOD * at, 3).tolist(),
        "simulated": np.round(simulated[at], 5).T.tolist(),
        "measured": np.round(seen.measured[at], 5).T.tolist(),
    }


def _tell_limits(numbers: Mapping[str, Any]) -> Chapter:
    followed, share = numbers["followed"], numbers["share"]
    lines = []
    for name, seen in followed.items():
        step, _, sample = name.partition(", ")
        slow = step in ("1 ms", "2 ms", "2.5 ms") or sample == "10 ms"
        here = "keeps up" if share[name] < 1.0 else "falls behind"
        lines.append(
            Line(
                "5.13" if sample == "1000 ms" else "5.14",
                f"step {step}, samples every {sample}",
                "falls behind" if slow else "keeps up",
                f"{here}: {100 * share[name]:.1f} % of a core; at most {1e3 * seen['difference']:.1f} mrad off",
            )
        )
    figure = new_figure(12, 7)
    for axis, (step, sample_time) in zip(figure.subplots(2, 2).flat, _SHOWN, strict=True):
        name = _name(step, sample_time)
        axis.plot(followed[name]["time"], followed[name]["simulated"][0], color=COLOURS[0], lw=1.2, label="simulated")
        axis.plot(followed[name]["time"], followed[name]["measured"][0], ".", color=RED, ms=3, label="measured")
        axis.set_title(f"step {1e3 * step:g} ms, sample time {1e3 * sample_time:g} ms", fontsize=10)
        axis.set(xlabel="time, s", ylabel="angle of link 1, rad")
        axis.grid(alpha=0.3)
    legend(figure.axes[0])
    return Chapter(
        "The thesis's monitor simulates the healthy arm beside the measured one, with its own steps and sample "
        "times; the arm is healthy and the model true. Sample times are tried with steps of 5 ms, steps with "
        "samples every second.",
        lines,
        "The thesis's limits are those of its program and computer: below 5 ms or 100 ms it missed samples. Here "
        "the simulation is compiled; a combination keeps up if it takes less than all of a core.",
        f"This project's monitor at every sample takes {100 * share['default']:.1f} % of a core. Shares are those "
        "of the machine on which this page was made.",
        [
            Picture(
                figure,
                "Angle of link 1 that the thesis's monitor simulates (line) and measures (dots) over time: above "
                "at steps of 2 and 5 ms with samples every second (the thesis's Figure 5.13), below at steps of 5 "
                "ms with samples every 10 and 100 ms (Figure 5.14).",
            )
        ],
    )


def _failure(scope: Scope, progress: Progress) -> dict[str, Any]:
    outcomes = failure_experiment(scope.runs(50, 3), NOISE, scope.seed, workforce=scope.workforce, progress=progress)
    cell = Cell(CellSettings(_FAILING, scope.seed, NOISE, faults=(parse_fault(f"{FAULT}@{START:g}"),)))
    cell.run()
    latencies = {method: [o.latency_s for o in outcomes if o.method == method] for method in ("thesis", "default")}
    named = [o.named for o in outcomes if o.method == "default"]
    return {
        "latency": latencies,
        "named": sum(map(bool, named)),
        "run": _followed(stream(cell.log.freeze()), 0.005, 0.5),
    }


def _tell_failure(numbers: Mapping[str, Any]) -> Chapter:
    def latency_text(method: str) -> str:
        found = [value for value in numbers["latency"][method] if value is not None]
        runs = len(numbers["latency"][method])
        return (
            f"{len(found)} of {runs} runs, after {np.median(found):.2f} s (median), {max(found):.2f} s at most"
            if found
            else f"none of {runs} runs"
        )

    run = numbers["run"]
    shown = next((when for when in run["failed"] if when is not None), None)
    lines = [
        Line(
            "5.16",
            "failure detected, the thesis's method",
            "yes; the number is not given, at least 5 s after 45 s",
            latency_text("thesis"),
        ),
        Line("5.16", "failure detected, this project's monitor", "not there", latency_text("default")),
        Line(
            "5.17",
            "what the operator is told",
            "deviation on link 2",
            f"voltage constant of joint 2 in {numbers['named']} of {len(numbers['latency']['default'])} runs",
        ),
    ]
    figure = new_figure(12, 8)
    for joint, axis in enumerate(figure.subplots(3, 1, sharex=True)):
        axis.plot(run["time"], run["simulated"][joint], color=COLOURS[0], lw=1.2, label="simulated")
        axis.plot(run["time"], run["measured"][joint], ".", color=RED, ms=3, label="measured")
        axis.axvline(START, color=DARK, ls="--", lw=1.2)
        if shown is not None:
            axis.axvline(shown, color=COLOURS[2], ls="--", lw=1.2)
        axis.set_ylabel(f"link {joint + 1}, rad")
        axis.grid(alpha=0.3)
    legend(figure.axes[0])
    figure.axes[-1].set_xlabel("time, s")
    detected = "not detected in this run" if shown is None else f"detected at {shown:.1f} s (green)"
    return Chapter(
        f"The voltage constant of joint 2 drops to a tenth at {START:g} s. A deviation counts beyond {ABSOLUTE:g} "
        f"rad and 5 %; {IN_A_ROW} in a row, compared every 0.5 s, are a failure. Encoder noise of {NOISE:g} u rad.",
        lines,
        "Ten comparisons at 0.5 s take 4.5 s at least; while the arm holds still at the pickup point little "
        "deviates.",
        "Cause, size and confidence of the fault, and hundreds of other faults: `dtwin experiment failure`, `dtwin "
        "experiment faults`.",
        [
            Picture(
                figure,
                "Measured angles (dots) and those that the thesis's monitor simulates for a healthy arm (lines), "
                f"compared every 0.5 s; K2 drops to a tenth at 45 s (grey), {detected} (the thesis's Figures 5.16 "
                "and 5.17).",
            )
        ],
    )


LIMITS = Part("limits", "Limits of monitoring (Figures 5.13 and 5.14)", _limits, _tell_limits, ("share",))
FAILURE = Part("failure", "Failure of a motor (Figures 5.16 and 5.17)", _failure, _tell_failure)
