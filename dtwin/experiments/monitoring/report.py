"""Report pages of the monitoring experiments: Markdown with tables, and plots as PNG."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from dtwin.errors import RecordingError
from dtwin.experiments.monitoring.sampling import Speed
from dtwin.experiments.monitoring.scorecard import WITHIN, Scorecard, label, summary
from dtwin.experiments.monitoring.stopping import WATCHED, StopOutcome
from dtwin.experiments.monitoring.trial import METHODS, Method, Outcome, true_cause
from dtwin.identification.plots import save
from dtwin.run.recording import replacing

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE: Final = "report.md"
CHART: Final = "report.png"

_METHOD_TITLES: Final[Mapping[Method, str]] = {"default": "Default method", "thesis": "The thesis's method"}
_FAILURE_THESIS: Final = (
    "The thesis tests one failure: K2 to 10 % at 45 s, compared every 0.5 s with a simulation of 5 ms steps. It "
    "takes ten deviating comparisons in a row, so more than five seconds, and names the link but no cause."
)
_SAMPLING_THESIS: Final = (
    "The thesis's monitor could not keep up below a simulation step of 5 ms or a sample time of 100 ms."
)


def failure_text(outcomes: Sequence[Outcome]) -> str:
    """The page of the failure test."""
    tables = []
    for method in METHODS:
        chosen = [o for o in outcomes if o.method == method]
        groups = {
            "all": chosen,
            "moving": [o for o in chosen if o.moving],
            "holding": [o for o in chosen if not o.moving],
        }
        columns = {state: _failure_column(group) for state, group in groups.items() if group}
        if columns:
            rows = [[name, *(column[name] for column in columns.values())] for name in next(iter(columns.values()))]
            tables += [f"## {_METHOD_TITLES[method]}", _table(["arm", *columns], rows)]
    return _page(
        "The voltage constant of joint 2 drops to a tenth",
        "The emulated cell (MuJoCo) sorts boxes under its function blocks; every run has its own boxes, encoder "
        "noise, and model from one simulated identification run at the same noise. At 45 s K2 is multiplied by 0.1.",
        *tables,
        "*95 %*: of the runs were faster. *size off*: error relative to the true size. *within 2 sd*: share of the "
        "sizes within 1.96 of their stated standard deviations; honest ones reach 95 %.",
        _FAILURE_THESIS,
    )


def faults_text(card: Scorecard) -> str:
    """The page of the scorecard."""
    lines = card.lines()
    found = [
        [
            f"`{line.fault}`",
            str(line.runs),
            *(_percent(share) for share in (line.detected, line.in_motion, line.named)),
            f"{_number(line.latency_median)} / {_number(line.latency_95)}",
            f"{_number(line.motion_median)} / {_number(line.motion_95)}",
        ]
        for line in lines
    ]
    sized = [
        [
            f"`{line.fault}`",
            *(_percent(share) for share in (line.size_median, line.size_worst, line.covered)),
        ]
        for line in lines
        if line.size_median is not None
    ]
    (true, named), matrix = confusion(card)
    causes = [
        [
            cause,
            str(row.sum()),
            str(row[i]),
            ", ".join(f"{name} ({n})" for j, (name, n) in enumerate(zip(named, row, strict=True)) if n and j != i),
        ]
        for i, (cause, row) in enumerate(zip(true, matrix, strict=True))
    ]
    alarms = [f"seed {q.seed}, noise {q.noise:g} rad: {alarm}" for q in card.quiet for alarm in q.alarms]
    return _page(
        "Faults of the cell",
        "Every fault comes at a random time between 30 s and 60 s into normal work with random boxes; every run has "
        "its own boxes, encoder noise, and model from one simulated identification run at the same noise.",
        "## Found",
        _table(["fault", "runs", "found", "soon", "named", "after, s", "moved, s"], found),
        f"*soon*: found within {WITHIN:g} s of motion. *named*: with the right cause and joint. *after*: time since "
        "the fault, median / 95 % of the runs. *moved*: of that, the time in which the arm moved, for the payload "
        "with a box.",
        "## Sizes",
        _table(["fault", "off, median", "off, largest", "within 2 sd"], sized),
        "As first stated, later data refine them. *off*: error relative to the true size, of the runs named right. "
        "*within 2 sd*: share of the sizes within 1.96 of their stated standard deviations; honest ones reach 95 %.",
        "## Causes",
        _table(["true cause", "runs", "right", "named instead (runs)"], causes),
        f"## Without fault\n\n{card.false_alarms} false alarms in {card.hours:.2f} hours of normal work.",
        *alarms,
    )


def sampling_text(speeds: Sequence[Speed]) -> str:
    """The page of the limits test."""
    rows = [
        [
            s.method,
            f"{1e3 * s.step:g}",
            f"{1e3 * s.sample_time:g}",
            f"{100 * s.core_share:.2f} %",
            f"{s.real_time_factor:.0f}",
            _number(s.latency_s),
        ]
        for s in speeds
    ]
    return _page(
        "Simulation step and sample time",
        "One run of the emulated cell is watched in every combination; processor time is measured.",
        _table(["method", "step, ms", "sample, ms", "of a core", "x real time", "found, s"], rows),
        "*step*: of the simulation. *sample*: time between two samples. *found*: time after which the drop of K2 to "
        "10 % was reported.",
        _SAMPLING_THESIS,
    )


def stopping_text(outcomes: Sequence[StopOutcome]) -> str:
    """The page of the safe stop."""
    header = [
        "fault", "runs", "demanded", "after s, median", "largest", "in motion", "standing at the end",
        "in motion: at rest after s, median", "largest", "torque off at the end", "after s, median", "largest",
    ]  # fmt: skip
    rows = []
    for fault in dict.fromkeys(o.fault for o in outcomes):
        runs = [o for o in outcomes if o.fault == fault]
        demanded = [o.demanded_s for o in runs if o.demanded_s is not None]
        rested = [o.rest_s for o in runs if o.moving and o.rest_s is not None]
        off = [o.torque_off_s for o in runs if o.torque_off_s is not None]
        standing = sum(o.stop == "standstill" for o in runs)
        moving = sum(o.moving for o in runs)
        row = [
            fault,
            str(len(runs)),
            str(len(demanded)),
            *_middle(demanded),
            str(moving),
            str(standing),
            *_middle(rested),
        ]
        rows.append([*row, str(len(off)), *_middle(off)])
    return _page(
        "Safe stop",
        "Every fault comes at a random time between 30 s and 60 s into normal work with random boxes. The monitor's "
        "verdict goes to the function blocks once its diagnosis is settled; times to rest and to torque off count "
        f"from there. A run ends {WATCHED:g} s later.",
        _table(header, rows),
    )


def draw_stopping(outcomes: Sequence[StopOutcome], figure: Figure) -> None:
    """Times from fault to demand, and from there to rest or torque off, a row a fault."""
    figure.set_size_inches(12, 5)
    faults = list(dict.fromkeys(o.fault for o in outcomes))
    left, right = figure.subplots(1, 2, sharey=True)
    for axis, title, names in (
        (left, "from the fault to the demand", {"demanded_s": "C0"}),
        (right, "from the demand", {"rest_s": "C2", "torque_off_s": "C3"}),
    ):
        for name, colour in names.items():
            known = [o for o in outcomes if getattr(o, name) is not None]
            times = [max(getattr(o, name), 0.01) for o in known]
            rows = [faults.index(o.fault) for o in known]
            axis.plot(times, rows, ".", color=colour, alpha=0.6, label=name.removesuffix("_s").replace("_", " "))
        axis.set_xscale("log")
        axis.set(xlabel="s", title=title)
        axis.grid(alpha=0.3)
        axis.legend()
    left.set_yticks(range(len(faults)), faults)
    left.invert_yaxis()


def confusion(card: Scorecard) -> tuple[tuple[list[str], list[str]], np.ndarray]:
    """True causes and named ones, and the number of runs by both."""
    counts = card.confusion()
    true = list(dict.fromkeys(label(*true_cause(line.fault)) for line in card.lines()))
    named = [*true, *sorted({pair[1] for pair in counts} - set(true))]
    return (true, named), np.array([[counts.get((t, n), 0) for n in named] for t in true])


def write(folder: Path, text: str, draw: Callable[[Figure], None]) -> Path:
    """Writes a page with its chart at the end into a folder, made if need be; returns the page.

    Raises:
        RecordingError: the folder cannot be written.
    """
    from matplotlib.figure import Figure

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be made: {error.strerror}") from None
    figure = Figure(layout="constrained")
    draw(figure)
    save(figure, folder / CHART)
    path = folder / PAGE
    with replacing(path) as temporary:
        temporary.write_text(f"{text}\n![chart]({CHART})\n", encoding="utf-8")
    return path


def draw_failure(outcomes: Sequence[Outcome], figure: Figure) -> None:
    """Share of the runs detected over the time since the failure, a line a method."""
    figure.set_size_inches(8, 4)
    axis = figure.subplots()
    for method in METHODS:
        latency = sorted(math.inf if o.latency_s is None else o.latency_s for o in outcomes if o.method == method)
        shares = np.arange(1, len(latency) + 1) / max(len(latency), 1)
        axis.step(latency, 100 * shares, where="post", label=f"{method} method")
    axis.axvline(0.2, color="0.6", ls="--", lw=1)
    axis.set_xscale("log")
    axis.set(xlabel="time since K2 dropped to 10 %, s", ylabel="runs detected, %", ylim=(0, 103))
    axis.grid(alpha=0.3)
    axis.legend()


def draw_faults(card: Scorecard, figure: Figure) -> None:
    """Latencies in motion, and the matrix of named causes."""
    lines = card.lines()
    (true, named), matrix = confusion(card)
    figure.set_size_inches(16, max(4.0, 0.27 * max(len(lines), len(true)) + 2))
    left, right = figure.subplots(1, 2)
    for row, line in enumerate(lines):
        runs = [o for o in card.outcomes if o.fault == line.fault and o.motion_latency_s is not None]
        left.plot(
            [max(o.motion_latency_s or 0.0, 0.01) for o in runs], [row] * len(runs), ".", color="#4c72b0", alpha=0.6
        )
    left.set_yticks(range(len(lines)), [line.fault for line in lines], fontsize=8)
    left.axvline(WITHIN, color="0.6", ls="--", lw=1)
    left.set_xscale("log")
    left.set(xlabel="motion until detection, s", title="latency")
    left.invert_yaxis()
    left.grid(alpha=0.3)
    shares = matrix / np.maximum(matrix.sum(axis=1, keepdims=True), 1)
    right.imshow(shares, cmap="Blues", vmin=0, vmax=1, aspect="auto")
    for (i, j), count in np.ndenumerate(matrix):
        if count:
            right.text(
                j, i, str(count), ha="center", va="center", fontsize=7, color="w" if shares[i, j] > 0.5 else "k"
            )
    right.set_xticks(range(len(named)), named, rotation=90, fontsize=7)
    right.set_yticks(range(len(true)), true, fontsize=7)
    right.set(title="named (columns) and true (rows) causes, runs")


def draw_sampling(speeds: Sequence[Speed], figure: Figure) -> None:
    """Share of a core and latency over the sample time, a line a step."""
    figure.set_size_inches(12, 4)
    share, latency = figure.subplots(1, 2)
    for step in dict.fromkeys(s.step for s in speeds if s.method == "thesis"):
        chosen = [s for s in speeds if s.method == "thesis" and s.step == step]
        times = [s.sample_time for s in chosen]
        share.plot(
            times, [100 * s.core_share for s in chosen], ".-", label=f"thesis's method, step {1e3 * step:g} ms"
        )
        latency.plot(times, [s.latency_s or math.nan for s in chosen], ".-")
    for s in speeds:
        if s.method == "default":
            share.plot(s.sample_time, 100 * s.core_share, "k*", ms=10, label="default method")
            latency.plot(s.sample_time, s.latency_s or math.nan, "k*", ms=10)
    share.set(xlabel="sample time, s", ylabel="of a core, %", xscale="log", yscale="log")
    latency.set(xlabel="sample time, s", ylabel="K2 to 10 % found after, s", xscale="log", yscale="log")
    share.legend(fontsize=8)
    for axis in (share, latency):
        axis.grid(alpha=0.3)


def _failure_column(group: Sequence[Outcome]) -> dict[str, str]:
    """What came of runs, by what is told."""
    line = summary(group[0].fault, group)
    latency = [math.inf if o.latency_s is None else o.latency_s for o in group]
    return {
        "runs": str(line.runs),
        "found": _percent(line.detected),
        "within 0.2 s": _percent(sum(value <= 0.2 + 1e-9 for value in latency) / len(group)),
        "after, s: median": _number(line.latency_median),
        "95 %": _number(line.latency_95),
        "largest": _number(max(latency)),
        "named K2": _percent(line.named),
        "size off: median": _percent(line.size_median),
        "largest size off": _percent(line.size_worst),
        "within 2 sd": _percent(line.covered),
        "false alarms": str(sum(o.false_alarms for o in group)),
    }


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100 * share:.3g} %"


def _middle(values: Sequence[float]) -> list[str]:
    """Median and largest."""
    return [f"{np.median(values):.2f}", f"{max(values):.2f}"] if values else ["", ""]


def _number(value: float | None) -> str:
    return "-" if value is None or math.isinf(value) else f"{value:.2f}"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _page(title: str, *parts: str) -> str:
    return "\n\n".join([f"# {title}", *parts]) + "\n"
