"""`dtwin monitor LOG --arm NAME`: the first fault of any arm in its own log."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Final

from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ParameterError, RecordingError
from dtwin.monitoring.chain.finding import hidden_in_words
from dtwin.monitoring.chain.sequential import doubt, watched
from dtwin.run.arm_log import read_arm_log
from dtwin.terminal import print_json, printable

LEAST_HEALTHY: Final = 20.0
"""Shortest time in which an arm is learned, s: the longest window over which evidence is gathered passes twice."""


def monitor_arm(log: Path, arm: str, healthy: float, json: bool) -> int:
    """Looks for the first fault after the healthy stretch; returns the exit status, 1 with a finding.

    Args:
        log: log of `dtwin run --arm` or `dtwin up --arm`.
        arm: name of arms/, the arm's file or its model.
        healthy: time from the beginning in which the arm is healthy, s.
        json: print one JSON object.

    Raises:
        ParameterError: the healthy stretch is too short.
        RecordingError: the log is too short, or what the arm does in the healthy stretch does not suffice to know it.
        DtwinError: arm or log cannot be read.
    """
    if not LEAST_HEALTHY <= healthy < math.inf:
        raise ParameterError(f"--healthy: expected at least {LEAST_HEALTHY:g} s, got {healthy:g}")
    known = arm_of(arm)
    rows = read_arm_log(log, known)
    watch = watched(known, rows.t, rows.q, rows.target, rows.effort, healthy)
    unsure = doubt(known, rows.t, rows.q, rows.target, rows.effort, healthy)
    if unsure is not None:
        raise RecordingError(
            f"{log}: the first {healthy:g} s do not suffice to know the arm: who knows half of them would tell "
            f"{unsure.text(known)}; expected a longer --healthy, without a fault and with all of the arm's work"
        )
    found, hidden = watch.finding, watch.hidden()
    if json:
        finding = None
        if found is not None:
            finding = {"time": found.time, "cause": found.cause, "size": found.size, "others": found.others}
        print_json(
            {
                "arm": known.name,
                "healthy": healthy,
                "judged": float(rows.t[-1] - rows.t[0]),
                "finding": finding,
                "unobservable": {cause: size if math.isfinite(size) else None for cause, size in hidden.items()},
            }
        )
    else:
        judged = f"arm {known.name}: learned in {healthy:g} s, judged until {rows.t[-1]:g} s"
        print(printable(judged))
        print(printable("nothing is wrong" if found is None else found.text(known)))
        if hidden:
            said = "; ".join(hidden_in_words(known, *each) for each in hidden.items())
            print(printable(f"the last seconds that were judged could not have shown: {said}"))
    return int(found is not None)
