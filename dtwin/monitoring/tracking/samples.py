"""Many samples, and what a monitor made of every one: columns with a row a sample."""

from __future__ import annotations

from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from dtwin.monitoring.kinds import JUMPS

Array = NDArray[np.float64]


class Samples(NamedTuple):
    """What sensors and commands said in N samples.

    Attributes:
        sample: (N,), their numbers.
        measured: (N, 3), readings of the encoders, rad.
        volts: (N, 4), commands that answered them, that of the gripper last, V.
        gripped: (N,), whether the command holds a box.
        jaw: (N,), readings of the gripper's encoder, rad; not a number where there is none.
    """

    sample: NDArray[np.int64]
    measured: Array
    volts: Array
    gripped: NDArray[np.bool_]
    jaw: Array

    def part(self, rows: slice) -> Samples:
        """Some of them."""
        sample, measured, volts, gripped, jaw = self
        return Samples(sample[rows], measured[rows], volts[rows], gripped[rows], jaw[rows])

    def row(self, number: int) -> tuple[int, Array, Array, bool, float]:
        """One of them."""
        sample, measured, volts, gripped, jaw = (column[number] for column in self)
        return int(sample), measured, volts, bool(gripped), float(jaw)


class Tape(NamedTuple):
    """What was made of N samples; without rows nothing is kept.

    Attributes:
        innovation: (N, 3), reading minus prediction, rad.
        variance: (N, 3), variance of the innovations, rad^2.
        score: (N, 3), the innovations as they count, 1/rad.
        information: (N, 3), variance of the scores, 1/rad^2.
        used: (N, 3), which readings were taken in.
        statistic: (N,), the strongest evidence of a sudden change beyond what is allowed for.
        statistics: (N, 18), the strongest evidence of each of JUMPS.
    """

    innovation: Array
    variance: Array
    score: Array
    information: Array
    used: NDArray[np.bool_]
    statistic: Array
    statistics: Array

    @classmethod
    def of(cls, count: int) -> Self:
        """Room for so many samples."""
        innovation, variance, score, information = np.zeros((4, count, 3))
        used = np.zeros((count, 3), dtype=bool)
        return cls(innovation, variance, score, information, used, np.zeros(count), np.zeros((count, len(JUMPS))))

    def part(self, start: int, stop: int) -> Self:
        """Rows start to stop - 1."""
        rows = slice(start, stop)
        return type(self)(
            self.innovation[rows],
            self.variance[rows],
            self.score[rows],
            self.information[rows],
            self.used[rows],
            self.statistic[rows],
            self.statistics[rows],
        )


NO_TAPE: Final = Tape.of(0)
