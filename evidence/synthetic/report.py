"""The page of the check on drawn machines, and its figures for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import msgspec
import numpy as np

from dtwin.campaign.spread import Progress
from dtwin.commands.frame import at_least
from evidence.experiment import SeriesCommand
from evidence.report import Report, page, table
from evidence.synthetic.check import (
    AHEAD,
    COVERED,
    FASTER,
    PEER_SECONDS,
    Known,
    ahead,
    covered,
    faster,
    kept,
    kind_of,
    synthetic_experiment,
)


def synthetic_report(found: Sequence[Known], seconds: float) -> Report:
    """The page for people."""
    rows = [
        [
            str(one.number),
            str(one.joints),
            f"{sum(abs(value) <= 1.0 for value in one.away.values())} of {len(one.away)}",
            f"{_mean(one.ours):.4f}",
            f"{_mean(one.theirs):.4f}",
            f"{one.seconds[0]:.1f}",
            f"{_mean(one.same):.4f}" if one.peer else "",
            f"{_mean(one.peer):.4f}" if one.peer else "",
            f"{one.same_seconds:.1f}" if one.peer else "",
            f"{one.peer_seconds:.1f}" if one.peer else "",
        ]
        for one in found
    ]
    head = ["machine", "joints", "intervals that hold the truth", "ours", "least squares", "time, s"]
    short = f"of {PEER_SECONDS:g} s"
    beside = [f"ours {short}", f"mujoco.sysid {short}", "our time, s", "its time, s"]
    words = (
        f"{len(found)} drawn machines whose numbers are known, each identified from three motions of {seconds:g} s: "
        "with an empty hand, with a load that is weighed and with one that is to be found. They have every effect "
        "that the identification has words for, told in the forms of textbooks, and a disturbance that no term has. "
        "Errors are the unexplained share of the torque of a fourth motion, the geometric mean over the joints. "
        "Least squares is told the drives' constants and has the first motion. mujoco.sysid and, beside it, the "
        f"identification are told the constants and have {PEER_SECONDS:g} s of the first motion; their times are the "
        "processor's."
    )
    told = (
        f"{covered(found):.1%} of the 95 % intervals of what the data tell hold the truth (asked: "
        f"{COVERED[0]:.0%} to {COVERED[1]:.0%}). On {ahead(found):.0%} of the machines the error is less than the "
        f"others' (asked: {AHEAD:.0%})."
    )
    if asked := [one for one in found if one.peer]:
        told += (
            f" It is {_mean([one.ratio for one in found]):.2f} of that of least squares and, on the {len(asked)} "
            f"machines that mujoco.sysid was asked about, {_mean([one.peer_ratio for one in asked]):.2f} of its own "
            f"(geometric means). Its search left {_mean([one.peer_fit[1] for one in asked]):.3f} of the torque that "
            f"it fitted, after {_mean([one.peer_fit[0] for one in asked]):.3f} where it began. It took at least "
            f"{faster(found):.0f} times as long for the same motion (asked: {FASTER:g})."
        )
    kinds = sorted({kind_of(name) for one in found for name in one.away})
    by_kind = [[kind, str(_count(found, kind)), f"{covered(found, kind):.1%}"] for kind in kinds]
    return page(
        "Drawn arms whose numbers are known",
        words,
        table([*head, *beside], rows),
        told,
        "## By sort of number",
        table(["sort", "intervals", "that hold the truth"], by_kind),
    )


def _mean(shares: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(shares))))


def _count(found: Sequence[Known], kind: str) -> int:
    return sum(kind_of(name) == kind for one in found for name in one.away)


def synthetic_figures(found: Sequence[Known]) -> dict[str, Any]:
    """The figures for programs."""
    kinds = sorted({kind_of(name) for one in found for name in one.away})
    times = faster(found)
    return {
        "covered": covered(found),
        "covered_by_kind": {kind: covered(found, kind) for kind in kinds},
        "ahead": ahead(found),
        "times_faster": times if np.isfinite(times) else None,
        "machines": msgspec.to_builtins(list(found)),
    }


@dataclass(frozen=True)
class ExperimentSynthetic(SeriesCommand[list[Known]]):
    """Identify drawn arms of six and seven joints from logs with every effect, beside least squares and mujoco.sysid.

    Fails when fewer than 90 % or more than 98 % of the 95 % intervals hold the truth, when least squares or
    mujoco.sysid predict other motion better on more than a tenth of the machines, or when mujoco.sysid takes less
    than ten times as long.
    """

    name: ClassVar = "synthetic"

    machines: int = 40
    """Number of machines; their numbers begin with the seed."""
    duration: float = 50.0
    """Length of each motion, s."""
    peers: int = 0
    """Number of machines, the first ones, that mujoco.sysid identifies, too; each takes it a minute."""

    def measure(self, progress: Progress) -> list[Known]:
        at_least("--machines", self.machines, 1)
        at_least("--duration", self.duration, 20.0)
        at_least("--peers", self.peers, 0)
        force = self.workforce()
        return synthetic_experiment(self.machines, self.seed, self.duration, self.peers, force, progress)

    def report(self, result: list[Known]) -> Report:
        return synthetic_report(result, self.duration)

    def figures(self, result: list[Known]) -> dict[str, Any]:
        return synthetic_figures(result)

    def passed(self, result: list[Known]) -> bool:
        return kept(result)
