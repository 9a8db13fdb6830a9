"""`dtwin monitor LOG --arm NAME`: the first fault of any arm in its own log."""

from __future__ import annotations

import math
from pathlib import Path

from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ParameterError, RecordingError
from dtwin.monitoring.chain.finding import hidden_in_words
from dtwin.monitoring.chain.learning import acquainted
from dtwin.monitoring.chain.record import judged, read_arm_record
from dtwin.monitoring.settings import LEAST_HEALTHY
from dtwin.run.arm_log import read_arm_log
from dtwin.terminal import print_json, printable


def monitor_arm(log: Path, arm: str, healthy: float, json: bool, commissioned: Path | None = None) -> int:
    """Looks for the first fault after the healthy stretch; returns the exit status, 1 with a finding.

    Args:
        log: log of `dtwin run --arm` or `dtwin up --arm`.
        arm: name of arms/, the arm's file or its model.
        healthy: time from the beginning in which the arm is healthy, s.
        json: print one JSON object.
        commissioned: record of the healthy arm, with which there is no such stretch.

    Raises:
        ParameterError: the healthy stretch is too short.
        RecordingError: the log is too short, or what the arm does in the healthy stretch does not suffice to know it.
        DtwinError: arm, record or log cannot be read.
    """
    if not LEAST_HEALTHY <= healthy < math.inf:
        raise ParameterError(f"--healthy: expected at least {LEAST_HEALTHY:g} s, got {healthy:g}")
    known = arm_of(arm)
    record = None if commissioned is None else read_arm_record(commissioned, known)
    rows = read_arm_log(log, known)
    if record is not None:
        watch = judged(record, known, (rows.t, rows.q, rows.target, rows.effort))
    else:
        try:
            watch = acquainted(known, rows.t, rows.q, rows.target, rows.effort, healthy)
        except RecordingError as error:
            raise RecordingError(f"{log}: {error} (--healthy)") from None
    learned = healthy if record is None else record.seconds
    found, hidden = watch.finding, watch.hidden()
    if json:
        finding = None
        if found is not None:
            finding = {"time": found.time, "cause": found.cause, "size": found.size, "others": found.others}
        print_json(
            {
                "arm": known.name,
                "healthy": learned,
                "judged": float(rows.t[-1] - rows.t[0]),
                "finding": finding,
                "unobservable": {cause: size if math.isfinite(size) else None for cause, size in hidden.items()},
            }
        )
    else:
        said = f"arm {known.name}: learned in {learned:g} s, judged until {rows.t[-1]:g} s"
        print(printable(said))
        print(printable("nothing is wrong" if found is None else found.text(known)))
        if hidden:
            said = "; ".join(hidden_in_words(known, *each) for each in hidden.items())
            print(printable(f"the last seconds that were judged could not have shown: {said}"))
    return int(found is not None)
