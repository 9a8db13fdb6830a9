"""The modes of the monitor, each with just the state that it needs, and the record that tells when it is lost.

    settling     the motion is not known well, or a diagnosis has just ended: nothing is suspected
    watching     the evidence of a sudden change is compared with the threshold
    diagnosing   a sudden change is being isolated
    lost         the arm moves like none that is known; sudden changes lead back to the last arm that was

Settling leads to watching or lost, watching to diagnosing, diagnosing to settling, and lost to settling or watching.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final, NamedTuple

from dtwin.monitoring.diagnosis import Diagnosis
from dtwin.monitoring.estimator import Estimator
from dtwin.monitoring.verdict import Finding

LOST: Final = 5
"""diagnoses within LOST_WITHIN that show that none of them was right"""
LOST_WITHIN: Final = 600
"""samples"""


@dataclass(frozen=True, slots=True)
class Watching:
    """Waits for evidence of a sudden change."""


@dataclass(frozen=True, slots=True)
class Lost:
    """Waits until the arm as believed explains the motion again; `sound` is the last estimator that did."""

    sound: Estimator


@dataclass(frozen=True, slots=True)
class Settling:
    """Waits until the estimate has settled.

    Attributes:
        left: samples until then.
        known: the value of `left` from which on the speeds are known, so that samples are evidence.
        begun: whether the motion is estimated anew, so that a fault may have come meanwhile and evidence is gathered.
        then: the mode that follows.
    """

    left: int
    known: int
    begun: bool
    then: Watching | Lost


@dataclass(frozen=True, slots=True)
class Diagnosing:
    """Isolates a sudden change; `pending` is the finding so far, None until it is certain that something failed."""

    diagnosis: Diagnosis
    pending: Finding | None = None


Mode = Settling | Watching | Diagnosing | Lost


class Turn(NamedTuple):
    """A diagnosis that was settled, and what was believed before.

    Attributes:
        sample: number of the sample at which it was settled.
        detected: plant time at which the change had been noticed, s.
        estimator: the arm as believed before the change.
        findings: the findings by parameter that stood before.
    """

    sample: int
    detected: float
    estimator: Estimator
    findings: dict[str, Finding]


class Turns:
    """The last diagnoses that were settled."""

    def __init__(self) -> None:
        self._turns: deque[Turn] = deque(maxlen=LOST)

    def enter(self, turn: Turn) -> None:
        """Notes a diagnosis."""
        self._turns.append(turn)

    def astray(self, sample: int) -> Turn | None:
        """The first of so many diagnoses up to a sample that none can have been right, which are forgotten then; None
        if there were not so many."""
        if len(self._turns) < LOST or self._turns[0].sample <= sample - LOST_WITHIN:
            return None
        first = self._turns[0]
        self._turns.clear()
        return first
