"""Figures 4.7 to 4.10: the emulated arm without voltage."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dtwin.campaign.spread import Progress
from dtwin.pictures import COLOURS, legend, new_figure
from evidence.report import Picture
from evidence.reproduce.chapter import Chapter, Line, Part, Scope, curve
from evidence.validation import ValidationOutcome, cases, validate

_FIGURES = {"drop": "4.7", "masses x 1.5": "4.8", "inertias x 2": "4.9", "upright": "4.10"}


def _measure(scope: Scope, progress: Progress) -> dict[str, Any]:
    done: list[str] = []

    def between(case: object) -> None:
        progress(len(done), len(cases()))
        done.append("")

    return {outcome.case.name: _numbers(outcome) for outcome in validate(between)}


def _numbers(outcome: ValidationOutcome) -> dict[str, Any]:
    motion = outcome.emulation
    return {
        "least": motion.min_theta_1,
        "at": motion.time_of_min,
        "rests": motion.rests_at,
        "falls": motion.falls_at,
        "difference": outcome.difference,
        "until": min(outcome.case.agreement_until, outcome.case.duration),
        "passed": outcome.passed,
        "curves": curve(motion.time, *motion.theta.T),
    }


def _tell(numbers: Mapping[str, Any]) -> Chapter:
    drop, heavy, slow, up = (numbers[name] for name in _FIGURES)
    lines = [
        Line(
            "4.7",
            "drop: least angle of link 1",
            "-2.3422 rad at 0.67 s",
            f"{drop['least']:.4f} rad at {drop['at']:g} s",
        ),
        Line("4.7", "drop: at rest, hanging", "about 10 s", f"{drop['rests']:.1f} s"),
        Line(
            "4.8",
            "masses x 1.5: least angle of link 1",
            "-2.4867 rad, 6.2 % farther",
            f"{heavy['least']:.4f} rad, {100 * (heavy['least'] / drop['least'] - 1):.1f} % farther",
        ),
        Line("4.8", "masses x 1.5: swings until", "about 15 s", f"{heavy['rests']:.1f} s"),
        Line(
            "4.9",
            "inertias x 2: time of the least angle",
            "0.6825 s, 1.9 % later",
            f"{slow['at']:g} s, {100 * (slow['at'] / drop['at'] - 1):.1f} % later",
        ),
        Line("4.10", "upright: falls after", "about 9 s", f"{up['falls']:.1f} s"),
    ]
    figure = new_figure(10, 8)
    axes = figure.subplots(4, 1)
    for axis, (name, number) in zip(axes, _FIGURES.items(), strict=True):
        time, *angles = numbers[name]["curves"]
        for joint, (angle, colour) in enumerate(zip(angles, COLOURS, strict=False), 1):
            axis.plot(time, angle, color=colour, lw=1.1, label=f"joint {joint}")
        axis.set_title(f"{number}: {name}", fontsize=10)
        axis.set_ylabel("angle, rad")
        axis.grid(alpha=0.3)
    legend(axes[0])
    axes[-1].set_xlabel("time, s")
    apart = max(numbers[name]["difference"] for name in numbers)
    return Chapter(
        "The arm moves without voltage, with steps of 2.5 ms: dropped from the horizontal, with heavier and with "
        "slower links, and from the upright position, where nothing but rounding moves it.",
        lines,
        "Of the inertias the thesis's time is one of its steps later than ours. When the upright arm falls is "
        "decided by rounding, which no two programs share; everything else is alike.",
        f"Two independent physics, MuJoCo and the analytic twin, agree within {apart:.1e} rad, until rounding "
        "decides.",
        [
            Picture(
                figure,
                "Angles of the unpowered arm over time: dropped from the horizontal (4.7), with masses 1.5 times "
                "(4.8) and inertias twice as large (4.9), and upright (4.10). Numbers in front are the thesis's "
                "figures.",
            )
        ],
    )


VERIFICATION = Part("verification", "Verification of the emulation (Figures 4.7 to 4.10)", _measure, _tell)
