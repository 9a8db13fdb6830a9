"""Other arms while they are healthy, and the first fault in their logs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dtwin.api.arguments import AnyPath, checked
from dtwin.arm.chain import Arm
from dtwin.emulation.chain.arms import arm_of
from dtwin.errors import ParameterError, RecordingError
from dtwin.files import ensure_writable
from dtwin.monitoring.chain.finding import ChainFinding
from dtwin.monitoring.chain.learning import acquainted
from dtwin.monitoring.chain.record import ArmRecord, judged, read_arm_record, record_of, write_arm_record
from dtwin.monitoring.chain.sequential import HEALTHY
from dtwin.monitoring.settings import LEAST_HEALTHY
from dtwin.run.arm_log import read_arm_log


@dataclass(frozen=True, slots=True, eq=False)
class ArmMonitored:
    """What the monitor made of a log of any serial arm.

    Attributes:
        arm: the arm.
        learned: time in which it was learned, s: at the beginning of the log, or when it was commissioned.
        judged: length of the log, s.
        end: time of its last row, s.
        finding: the first fault: time (s), cause, size, what else could have been; None if nothing is wrong.
        hidden: least size of each cause that the last seconds could have shown; inf where they show none.
    """

    arm: Arm
    learned: float
    judged: float
    end: float
    finding: ChainFinding | None
    hidden: Mapping[str, float]


@checked
def monitor_arm(
    log: AnyPath, arm: AnyPath, *, healthy: float = HEALTHY, commissioned: AnyPath | None = None
) -> ArmMonitored:
    """Looks for the first fault of any serial arm in its log, as `dtwin monitor LOG --arm` does.

    Args:
        log: Parquet log of `dtwin run --arm` or `dtwin up --arm`.
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        healthy: time from the beginning in which the arm is healthy and is learned, s, without that in which its
            gripper is closed.
        commissioned: record of `commission_arm`, with which nothing is learned at the beginning.

    Raises:
        ParameterError: the healthy stretch is too short.
        RecordingError: the log is too short, or what the arm does in the healthy stretch does not suffice to know it.
        DtwinError: arm, record or log cannot be read.
    """
    if not LEAST_HEALTHY <= healthy < math.inf:
        raise ParameterError(f"healthy: expected at least {LEAST_HEALTHY:g} s, got {healthy:g}")
    known = arm_of(str(arm))
    record = None if commissioned is None else read_arm_record(Path(commissioned), known)
    samples = read_arm_log(Path(log), known)
    if record is not None:
        watch = judged(record, known, samples)
    else:
        try:
            watch = acquainted(known, samples, healthy)
        except RecordingError as error:
            raise RecordingError(f"{log}: {error} (healthy)") from None
    learned = healthy if record is None else record.seconds
    begin, end = float(samples.t[0]), float(samples.t[-1])
    return ArmMonitored(known, learned, end - begin, end, watch.finding, watch.hidden())


@checked
def commission_arm(log: AnyPath, arm: AnyPath, *, out: AnyPath | None = None) -> ArmRecord:
    """Learns what the drives and encoders of any serial arm show at its healthy work, as `commission LOG --arm` does.

    Args:
        log: Parquet log of `dtwin run --arm` or `dtwin up --arm`.
        arm: a name of arms/, an arm's file (*.toml) or a model (*.urdf, *.xml).
        out: file that the record is written to, *.json, for `monitor_arm` and `dtwin up --arm`.

    Raises:
        RecordingError: the log is too short, its first half does not foretell its second one, or the record cannot be
            written.
        DtwinError: arm or log cannot be read.
    """
    if out is not None:
        ensure_writable(Path(out), ".json")
    known = arm_of(str(arm))
    samples = read_arm_log(Path(log), known)
    seconds = float(samples.t[-1] - samples.t[0])
    try:
        healthy = (int(np.isfinite(samples.effort[:, 0]).sum()) - 1.5) * known.period  # all of it but the last sample
        watch = acquainted(known, samples, healthy)
    except RecordingError as error:
        raise RecordingError(f"{log}: {error}") from None
    record = record_of(watch, known, round(seconds, 6))
    if out is not None:
        write_arm_record(record, Path(out))
    return record
