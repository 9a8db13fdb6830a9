"""Report pages of the simulation module's experiments: Markdown with tables, and pictures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from dtwin.errors import RecordingError
from dtwin.experiments.simulation.accuracy import NOISE, Pair
from dtwin.experiments.simulation.upload import GAINS_AT, MODEL_AT, UploadRun
from dtwin.parameters import PERIOD
from dtwin.run.recording import replacing
from dtwin.simulation.plots import COLOURS, save

PAGE: Final = "report.md"
FITS: Final = "fits.png"
MOTION: Final = "motion.png"
RUN: Final = "run.png"


def accuracy_report(runs: Sequence[Sequence[Pair]], folder: Path) -> Path:
    """Writes the accuracy experiment's page and pictures; returns the page.

    Args:
        runs: the motions of every model, in the same order.
        folder: made if need be.

    Raises:
        RecordingError: the folder cannot be written.
    """
    _make(folder)
    _draw_fits(runs, folder / FITS)
    _draw_motion(runs[0][0], folder / MOTION)
    rows = []
    for pairs in zip(*runs, strict=True):
        fits = np.array([pair.fit for pair in pairs])
        apart = 1e3 * np.array([pair.difference for pair in pairs]).max(axis=0)
        load = f"{1e3 * pairs[0].payload:.0f} g" if pairs[0].payload else "none"
        cells = [f"{fits[:, k].min():.4f} / {np.median(fits[:, k]):.4f}" for k in range(3)]
        rows.append(
            f"| {pairs[0].target_time:g} s | {load} | {' | '.join(cells)} | {', '.join(f'{v:.1f}' for v in apart)} |"
        )
    return _write(
        folder / PAGE,
        "# Accuracy of the simulated motion",
        f"The model is identified from one experiment at {NOISE:g} rad of encoder noise, with the 3-2-1-1 signal "
        "whose unit, delays and amplitudes tell most (dtwin identify --optimise). The emulated arm "
        "(MuJoCo) and the analytic twin with that model then move from the pickup point to red, both under the real "
        "function blocks, whose controller has the identified model. They are compared until both have settled (2 % "
        "of the way, joints slower than 0.01 rad/s). The fit is 1 - ||y - yhat|| / ||y - mean(y)||, 1 is perfect.",
        "## Outcome",
        f"Smallest and median fit of {len(runs)} models, and the largest difference between the two.",
        "| target time | load | joint 1 | joint 2 | joint 3 | largest difference, mrad |\n|---|---|---|---|---|---|",
        *rows,
        f"![Smallest fit by target time]({FITS})",
        f"![The fastest motion, arm and twin]({MOTION})",
        "## What the thesis found",
        "Fits of 0.90 and more at 1 s and 0.95 and more from 2 s on, worst for the first link; its damping was "
        "identified badly.",
    )


def upload_report(run: UploadRun, folder: Path) -> Path:
    """Writes the upload experiment's page and picture; returns the page.

    Raises:
        RecordingError: the folder cannot be written.
    """
    _make(folder)
    _draw_run(run, folder / RUN)
    phases = [
        f"| {p.name} | {p.start:g} to {p.stop:g} s | {_mrad(p.rms)} | {_mrad(p.largest)} | {p.delivered} |"
        for p in run.phases
    ]
    entries = [
        f"| {e.time:.2f} s | {e.version} | {e.action} | {e.kind} | {e.who} | {e.why} | {e.text} |"
        for e in run.entries
    ]
    waited = ", ".join(f"{1e3 * seconds:.0f} ms" for seconds in run.acknowledged)
    return _write(
        folder / PAGE,
        "# Uploading gains and a model into the running controller",
        "The cell works for 180 s without a stop. Its controller starts with all gains zero and a poor model; the "
        f"usual gains are uploaded at {GAINS_AT:g} s and an identified model at {MODEL_AT:g} s, through the function "
        "blocks, after a check on the twin, each with a trial period.",
        "## Outcome",
        "Distance from the path of joints 1 to 3 in mrad, without the 5 s after each upload.",
        "| in force | from | root mean square | largest | boxes delivered |\n|---|---|---|---|---|",
        *phases,
        f"Acknowledged after {waited} of wall time, checks included. {len(run.log)} ticks, none missing.",
        f"![Angles, distance from the path and voltages]({RUN})",
        "## History",
        "| time | version | what | of | who | why | remark |\n|---|---|---|---|---|---|---|",
        *entries,
        "## What the thesis found",
        "Both uploads arrived without stopping the cell (the model at 122 s). Without gains the arm did not reach "
        "the pickup point within 60 s, with them it worked; the model changed little more.",
    )


def _draw_fits(runs: Sequence[Sequence[Pair]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4), layout="constrained")
    loads = sorted({pair.payload for pair in runs[0]})
    for axis, load in zip(np.atleast_1d(figure.subplots(1, len(loads), sharey=True)), loads, strict=True):
        columns = [pairs for pairs in zip(*runs, strict=True) if pairs[0].payload == load]
        times = [pairs[0].target_time for pairs in columns]
        for joint in range(3):
            lowest = [min(pair.fit[joint] for pair in pairs) for pairs in columns]
            axis.plot(times, lowest, "o-", color=COLOURS[joint], label=f"joint {joint + 1}")
        axis.axhline(0.99, color="#444444", lw=0.8, ls=":")
        axis.set_title("no load" if not load else f"load of {1e3 * load:.0f} g")
        axis.set_xlabel("target time, s")
        axis.grid(alpha=0.3)
    figure.axes[0].set_ylabel(f"smallest fit of {len(runs)} models")
    figure.axes[0].legend()
    save(figure, path)


def _draw_motion(pair: Pair, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 6), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True)
    time = np.arange(pair.samples) * PERIOD
    for joint in range(3):
        one, other = pair.arm.theta[: pair.samples, joint], pair.twin.theta[: pair.samples, joint]
        axes[0, joint].plot(time, one, color="#444444", lw=2.5, alpha=0.6, label="arm")
        axes[0, joint].plot(time, other, color=COLOURS[0], lw=1.2, label="twin")
        axes[0, joint].plot(time, pair.twin.path[: pair.samples, joint], color=COLOURS[1], lw=1, ls=":", label="path")
        axes[0, joint].set_title(f"joint {joint + 1}: fit {pair.fit[joint]:.4f}")
        axes[1, joint].plot(time, 1e3 * (one - other), color=COLOURS[3], lw=1.2)
        axes[1, joint].set_xlabel("time, s")
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    axes[0, 0].set_ylabel("angle, rad")
    axes[1, 0].set_ylabel("arm minus twin, mrad")
    axes[0, 0].legend(fontsize=8)
    save(figure, path)


def _draw_run(run: UploadRun, path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 9), layout="constrained")
    angle, error, volts = figure.subplots(3, 1, sharex=True)
    time = run.log.columns["t"]
    theta, goal, applied = (run.log.stack(name) for name in ("theta", "target", "volts"))
    for joint in range(3):
        colour = COLOURS[joint]
        angle.plot(time, theta[:, joint], color=colour, lw=1.2, label=f"joint {joint + 1}")
        angle.plot(time, goal[:, joint], color=colour, lw=0.8, ls=":")
        error.semilogy(time, np.maximum(np.abs(goal - theta)[:, joint], 1e-5), color=colour, lw=0.8)
        volts.plot(time, applied[:, joint], color=colour, lw=0.6)
    for axis in (angle, error, volts):
        axis.axvline(GAINS_AT, color="#c44e52", ls="--", lw=1.2)
        axis.axvline(MODEL_AT, color="#55a868", ls="--", lw=1.2)
        axis.grid(alpha=0.3)
    angle.set_title("gains uploaded at the red line, model at the green one")
    for axis, label in ((angle, "angle and path, rad"), (error, "distance from path, rad"), (volts, "voltage, V")):
        axis.set_ylabel(label)
    volts.set_xlabel("time, s")
    angle.legend(fontsize=8)
    save(figure, path)


def _mrad(values: Sequence[float]) -> str:
    return ", ".join(f"{1e3 * value:.1f}" for value in values)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{folder}: cannot be made: {error.strerror}") from None


def _write(path: Path, *parts: str) -> Path:
    """Writes paragraphs; rows of a table stay together."""
    text = ""
    for part in parts:
        joined = part.startswith("| ") and text.rstrip("\n").endswith("|")
        text = f"{text.rstrip()}\n{part}\n\n" if joined else f"{text}{part}\n\n"
    with replacing(path) as temporary:
        temporary.write_text(text.rstrip() + "\n", encoding="utf-8")
    return path
