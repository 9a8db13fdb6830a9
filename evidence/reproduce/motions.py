"""Figures 5.10 to 5.12: simulated motions beside the arm's, and uploads to a running controller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from dtwin.campaign.spread import Progress, spread
from dtwin.controller.excitation import ExcitationController
from dtwin.identification.estimation.estimate import identify
from dtwin.identification.excitation.plan import Plan
from dtwin.identification.excitation.rig import Rig
from dtwin.parameters import PERIOD
from dtwin.pictures import COLOURS, DARK, RED, legend, new_figure
from evidence.report import Picture
from evidence.reproduce.chapter import Chapter, Line, Part, Scope, curve
from evidence.reproduce.parameters import settings
from evidence.simulation.accuracy import NOISE, TARGET_TIMES, Pair, accuracy, identified
from evidence.simulation.upload import DURATION, GAINS_AT, MODEL_AT, upload_run

_WAYS: Final = {"thesis": "18 parameters, as in the thesis", "ours": "12 parameters and offsets"}


def _accuracy(scope: Scope, progress: Progress) -> dict[str, Any]:
    items = [(way, scope.seed + run) for way in _WAYS for run in range(scope.runs(20, 2))]
    found = spread(_pairs, items, scope.workforce, progress, lambda item: f"{item[0]}, seed {item[1]}")
    numbers: dict[str, Any] = {way: {f"{t:g}": [] for t in TARGET_TIMES} for way in _WAYS}
    for (way, _), pairs in zip(items, found, strict=True):
        for pair in pairs:
            numbers[way][f"{pair.target_time:g}"].append(list(pair.fit))
    first = found[0][0]
    time = PERIOD * np.arange(first.samples)
    one, other, path = (values[: first.samples, 0] for values in (first.arm.theta, first.twin.theta, first.twin.path))
    return {**numbers, "curves": curve(time, one, other, path), "shown": list(first.fit)}


def _pairs(item: tuple[str, int]) -> list[Pair]:
    """The motions of a model that is identified in one of the ways at the thesis's noise."""
    way, seed = item
    rig = Rig(noise=NOISE)
    experiment = rig.measure(Plan(), ExcitationController(), np.random.default_rng((seed, 40)))
    return accuracy(identify([experiment], settings(way)).parameters, payloads=(0.0,))


def _tell_accuracy(numbers: Mapping[str, Any]) -> Chapter:
    def smallest(way: str, time: float) -> str:
        fits = np.array(numbers[way][f"{time:g}"])
        return f"{fits.min():.4f}, median {np.median(fits.min(axis=1)):.4f}"

    lines = [
        Line(
            "5.10",
            f"smallest fit of a link at a target time of {time:g} s",
            "above 0.90" if time == 1 else "above 0.95",
            f"{smallest('thesis', time)} with 18; {smallest('ours', time)} with 12",
        )
        for time in TARGET_TIMES
    ]
    lines.append(
        Line("5.11", "fit of link 1 at 1 s, the worst of the thesis", "above 0.90", f"{numbers['shown'][0]:.4f}")
    )
    fits = np.concatenate([np.array(numbers["thesis"][f"{time:g}"]) for time in TARGET_TIMES])
    weakest = int(fits.min(axis=0).argmin()) + 1
    figure = new_figure(12, 4)
    for axis, (way, words) in zip(figure.subplots(1, 2, sharey=True), _WAYS.items(), strict=True):
        for joint in range(3):
            low = [np.array(numbers[way][f"{time:g}"])[:, joint].min() for time in TARGET_TIMES]
            axis.plot(TARGET_TIMES, low, "o-", color=COLOURS[joint], label=f"link {joint + 1}")
        axis.axhline(0.95, color=RED, lw=0.8, ls=":")
        axis.set(xlabel="target time, s", title=words)
        axis.grid(alpha=0.3)
    figure.axes[0].set_ylabel("smallest fit")
    legend(figure.axes[0])
    motion = new_figure(9, 4)
    axis = motion.subplots()
    time, one, other, path = numbers["curves"]
    axis.plot(time, one, color=DARK, lw=2.4, alpha=0.6, label="arm")
    axis.plot(time, other, color=COLOURS[0], lw=1.2, label="twin")
    axis.plot(time, path, color=COLOURS[1], lw=1.0, ls=":", label="path")
    axis.set(xlabel="time, s", ylabel="angle of link 1, rad")
    axis.grid(alpha=0.3)
    legend(axis)
    return Chapter(
        "Arm and twin move from the pickup point to red under the same function blocks, whose controller has the "
        "identified model; they are compared until both have settled (2 % of the way, links slower than 0.01 "
        "rad/s).",
        lines,
        "The thesis shows one model, found at 0.010 rad; here every number is the smallest of several. The 18 "
        "parameters take the noise's mean of N/2 into themselves, and with them the torques that the controller "
        f"counts on; link {weakest} follows worst. With offsets, fits are near 1.",
        "Models of 12 parameters and offsets; motions with a box in `dtwin experiment accuracy`.",
        [
            Picture(
                figure,
                "Smallest fit of the twin's motion to the arm's over the target time (the thesis's Figure 5.10).",
            ),
            Picture(
                motion,
                "Link 1 on the way from pickup to red in 1 s: the arm, the twin with the identified model of 18 "
                "parameters, and the path (the thesis's Figure 5.11).",
            ),
        ],
    )


def _upload(scope: Scope, progress: Progress) -> dict[str, Any]:
    model = identified(NOISE, scope.seed)
    with TemporaryDirectory() as folder:
        history = Path(folder) / "history.jsonl"
        run = upload_run(model, history, scope.seed, progress=lambda t: progress(round(t), round(DURATION)))
    log = run.log
    return {
        "ticks": len(log),
        "phases": [[phase.name, list(phase.rms), list(phase.largest), phase.delivered] for phase in run.phases],
        "curves": curve(log.columns["t"], *log.stack("theta").T, *log.stack("target").T),
        "acknowledged": list(run.acknowledged),
    }


def _tell_upload(numbers: Mapping[str, Any]) -> Chapter:
    poor, gains, model = numbers["phases"]

    def phase_text(phase: Sequence[Any]) -> str:
        return f"{1e3 * max(phase[1]):.1f} mrad root mean square, {phase[3]} boxes delivered"

    lines = [
        Line(
            "5.12",
            "uploads without interruption at",
            "60 s and 122 s",
            f"{GAINS_AT:g} s and {MODEL_AT:g} s, all {numbers['ticks']} ticks answered",
        ),
        Line("5.12", "without gains", "pickup point not reached in 60 s", phase_text(poor)),
        Line("5.12", "with the gains of Table 5.1", "works, after a clear disturbance", phase_text(gains)),
        Line("5.12", "with the identified model too", "minor disturbance, no dramatic change", phase_text(model)),
    ]
    figure = new_figure(12, 5)
    axis = figure.subplots()
    time, *columns = numbers["curves"]
    for joint in range(3):
        axis.plot(time, columns[joint], color=COLOURS[joint], lw=1.1, label=f"link {joint + 1}")
        axis.plot(time, columns[3 + joint], color=COLOURS[joint], lw=0.8, ls=":")
    axis.axvline(GAINS_AT, color=RED, ls="--", lw=1.2)
    axis.axvline(MODEL_AT, color=COLOURS[2], ls="--", lw=1.2)
    axis.set(xlabel="time, s", ylabel="angle, path dotted, rad")
    axis.grid(alpha=0.3)
    legend(axis)
    waited = ", ".join(f"{1e3 * seconds:.0f}" for seconds in numbers["acknowledged"])
    return Chapter(
        "180 s of work that begin with zero gains and a poor model; gains are uploaded at 60 s, an identified "
        "model at 120 s.",
        lines,
        "The uploads arrive at the ticks for which they are planned, not when an operator gets to it.",
        f"Each upload is tried on the twin first and is on trial afterwards; acknowledged after {waited} ms on this "
        "machine.",
        [
            Picture(
                figure,
                "Angles of the links and their paths over 180 s; gains are uploaded at the red line, an identified "
                "model at the green one (the thesis's Figure 5.12).",
            )
        ],
    )


ACCURACY = Part("accuracy", "Accuracy of simulated motions (Figures 5.10 and 5.11)", _accuracy, _tell_accuracy)
UPLOAD = Part("upload", "Uploads to the running controller (Figure 5.12)", _upload, _tell_upload, ("acknowledged",))
