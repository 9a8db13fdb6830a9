"""The monitor over a log: the same code as online, fed with what sensors and commands said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtwin.errors import ParameterError
from dtwin.monitoring.monitor import Monitor
from dtwin.parameters import PERIOD
from dtwin.recording import Log

Array = NDArray[np.float64]

CHUNK = 100
"""ticks between two calls of `between`"""


@dataclass(frozen=True, slots=True, eq=False)
class Stream:
    """What a monitor may see of a log.

    Attributes:
        sample: (N,), tick numbers.
        measured: (N, 3), rad.
        volts: (N, 3), V.
        gripped: (N,) bool.
    """

    sample: NDArray[np.int64]
    measured: Array
    volts: Array
    gripped: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.sample)


def stream(log: Log) -> Stream:
    """The readings and commands of a log; no truth, no masses.

    Raises:
        ParameterError: the log is empty or its rows are no ticks.
    """
    if not len(log):
        raise ParameterError("the log is empty: expected at least one tick to monitor")
    sample = np.round(log.columns["t"] / PERIOD).astype(np.int64)
    if not np.allclose(sample * PERIOD, log.columns["t"], atol=1e-6):
        raise ParameterError(f"the log's times are no multiples of {PERIOD} s: expected one row a tick")
    return Stream(sample, log.stack("measured"), log.stack("volts")[:, :3].copy(), log.columns["box_gripped"])


def follow(monitor: Monitor, seen: Stream, between: Callable[[int], bool] | None = None) -> None:
    """Feeds a monitor; `between`, told the rows done once a second of plant time, ends it by returning False."""
    measured, volts = seen.measured, seen.volts
    for k, (sample, gripped) in enumerate(zip(seen.sample.tolist(), seen.gripped.tolist(), strict=True)):
        monitor.update(sample, measured[k], volts[k], gripped)
        if between is not None and k % CHUNK == 0 and not between(k):
            return
